"""Superimposition in miniature: a few spots and short walks, hardly learnt."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.values import Echoes, silent
from elfslam.stages.feature import load_encoder, walk_vectors
from studies import opposite_ways
from studies.floor_spots import (
    DIRECTIONS_RAD,
    MEAN_M,
    OVER_1_M,
    SUPERIMPOSED,
    TOGETHER,
    Spots,
    error_numbers,
    fixes_m,
    floor_of,
    heard,
    quantile_numbers,
)
from studies.opposite_ways import PLACED, Mapped, Ways, mapped
from studies.study import StudyContext
from studies.superimposition import measure_superimposition

FEW = Spots(spots=9, traces=16, supervised_traces=8, queries=6)
SHORT = Ways(world="studio", seed=100, rounds=1, steps=1)


def test_what_was_learnt_is_kept_and_gives_the_same_again(tmp_path: Path) -> None:
    records = measure_superimposition(
        StudyContext(kept=tmp_path / "kept"), floors=[FEW], ways=[SHORT]
    )
    asked = {(each.method, each.condition) for each in records}
    assert (SUPERIMPOSED, "in between, from 6") in asked
    assert {("opposite direction", placed) for placed in PLACED} <= asked
    assert sum(each.metric == "ELF" for each in records) == 2 * 4 * 128
    papers = {each.paper for each in records} - {None}
    assert papers == {3.2, 0.24, 0.56, 0.34, 0.76, 0.1, 3.8}
    file = tmp_path / "superimposition" / "hall-9-16-0.onnx"
    content = file.read_bytes()
    again = measure_superimposition(StudyContext(kept=tmp_path / "other"), floors=[FEW], ways=[])
    assert file.read_bytes() == content
    assert again == [each for each in records if each.world == "hall"]


def test_spots_are_neighbours_on_the_grid() -> None:
    spots_m = floor_of(FEW).spots_m
    apart_m = np.linalg.norm(spots_m[:, None] - spots_m, axis=2)[np.triu_indices(9, 1)]
    assert apart_m.min() == pytest.approx(0.1)
    assert apart_m.max() < 0.5
    assert len(floor_of(Spots()).spots_m) == 4000


def test_traces_of_one_direction_resemble_each_other_more_than_those_of_others() -> None:
    floor, generator = floor_of(FEW), np.random.default_rng(0)
    place_m = np.repeat(floor.spots_m[:1], 8, axis=0)
    rows = heard(floor, place_m, np.repeat(DIRECTIONS_RAD[[0, 2]], 4), generator)
    assert rows.shape == (8, 2352)
    level = np.abs(np.fft.rfft(rows, axis=1))[:, 800:1100]
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    alike = level @ level.T
    assert alike[:4, :4].mean() > alike[:4, 4:].mean()


def test_a_fix_lies_between_the_spots_that_sound_alike() -> None:
    spots_m = np.array([[0.0, 0.0], [0.2, 0.0], [9.0, 0.0]])
    spots = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], dtype=np.float32)
    vectors = np.repeat(np.array([[1.0, 0.0], [0.0, 1.0]], dtype=np.float32), TOGETHER, axis=0)
    np.testing.assert_allclose(fixes_m(vectors, TOGETHER, spots, spots_m), [[0.1, 0], [9, 0]])
    vectors[1:TOGETHER] = [0.0, 3.0]
    alone, all_six = (fixes_m(vectors, k, spots, spots_m)[0] for k in (1, TOGETHER))
    np.testing.assert_allclose([alone, all_six], [[0.1, 0], [9, 0]])


def test_errors_have_a_share_of_gross_ones() -> None:
    found_m, truth_m = np.array([[0.0, 0.0], [3.0, 4.0]]), np.zeros((2, 2))
    errors = error_numbers(found_m, truth_m)
    assert (errors[MEAN_M], errors[OVER_1_M]) == (2.5, 0.5)
    quantiles = quantile_numbers(found_m, truth_m)
    assert (quantiles["50 %"], next(iter(quantiles))) == (2.5, "10 %")


def test_maps_of_both_ways_lie_in_one_frame() -> None:
    there, back = (mapped(SHORT, 100, reverse=way) for way in (False, True))
    for walk in (there, back):
        off_m = np.linalg.norm((walk.poses - walk.truth)[:, :2], axis=1)
        assert np.median(off_m) < 0.6
    ahead = np.unwrap(there.poses[:, 2])[-1] - there.poses[0, 2]
    behind = np.unwrap(back.poses[:, 2])[-1] - back.poses[0, 2]
    assert ahead * behind < 0, "the one turns left, the other right"


def test_who_asks_and_who_maps_lose_what_their_echoes_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator, shipped = np.random.default_rng(0), load_encoder("compact")
    sounds = generator.normal(0, 1e-3, (3, 60, 2352)).astype(np.float32)
    poses = np.column_stack([np.linspace(0, 5, 60), np.zeros((60, 2))])
    walks = iter(
        [
            Mapped(Echoes(np.arange(60.0), each, np.empty((0, 2))), poses, poses)
            for each in sounds[:2]
        ]
    )
    asked, spots = [], []

    def found(vectors: F32, together: int, known: F32, xy_m: F64) -> F64:
        asked.append(vectors)
        spots.append(known)
        return np.zeros((10, 2))

    monkeypatch.setattr(opposite_ways, "mapped", lambda *_, **__: next(walks))
    monkeypatch.setattr(opposite_ways, "_asked", lambda task: (np.zeros((10, 2)), sounds[2]))
    monkeypatch.setattr(opposite_ways, "_learnt", lambda *_: shipped)
    monkeypatch.setattr(opposite_ways, "fixes_m", found)
    opposite_ways.measure_ways(SHORT, tmp_path, silent)
    heard = walk_vectors(sounds[2], shipped)
    assert all(np.array_equal(vectors, heard) for vectors in asked)
    both = np.vstack([walk_vectors(each, shipped) for each in sounds[:2]])
    assert any(np.array_equal(known, both) for known in spots)
