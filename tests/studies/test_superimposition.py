"""Superimposition in miniature: a few spots and short walks, hardly learnt."""

from pathlib import Path

import numpy as np
import pytest

from studies.floor_spots import (
    SUPERIMPOSED,
    TOGETHER,
    Spots,
    fixes_m,
    floor_of,
)
from studies.opposite_ways import PLACED, Ways
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


def test_a_fix_lies_between_the_spots_that_sound_alike() -> None:
    spots_m = np.array([[0.0, 0.0], [0.2, 0.0], [9.0, 0.0]])
    spots = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], dtype=np.float32)
    vectors = np.repeat(np.array([[1.0, 0.0], [0.0, 1.0]], dtype=np.float32), TOGETHER, axis=0)
    np.testing.assert_allclose(fixes_m(vectors, spots, spots_m), [[0.1, 0], [9, 0]])
    vectors[1:TOGETHER] = [0.0, 3.0]
    np.testing.assert_allclose(fixes_m(vectors, spots, spots_m)[0], [9, 0])
