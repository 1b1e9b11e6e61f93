"""Nearest spots of a few simulated maps: material that is kept, what is found, votes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.scoring.page import Page
from elfslam.serve.nearest import open_index
from studies.elf_spots import OneThread, make_lookups, make_map, make_spots, places_of
from studies.finding import Finding, Given
from studies.nearest_maps import measure_nearest_map
from studies.nearest_material import Extent
from studies.nearest_spots import measure_nearest
from studies.nearest_times import measure_nearest_times
from studies.simulated_buildings import beside, floor_rooms, walk_in

SMALL = Extent(maps=(2, 6), spots=150, walks=2, kinds=("flat", "ivf-flat"))


def quiet(text: str, share: float | None) -> None:
    """Nobody hears of progress."""


def test_a_map_is_the_same_whenever_it_is_made() -> None:
    encoder = OneThread()
    first, again, other = (make_map(number, 60, encoder) for number in (3, 3, 4))
    assert (first.vectors == again.vectors).all()
    assert first.vectors.shape == (60, 128)
    assert not (first.vectors == other.vectors).all()
    lengths = np.linalg.norm(first.vectors.astype(np.float32), axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=2e-3)


def test_floors_of_a_building_are_alike_and_buildings_are_not() -> None:
    below, above, elsewhere = floor_rooms(5, 0), floor_rooms(5, 1), floor_rooms(6, 0)
    for one, two in zip(below, above, strict=True):
        assert (one.outline_m == two.outline_m).all()
    assert any(one.walls != two.walls for one, two in zip(below, above, strict=True))
    assert below[0].size_m[0] != elsewhere[0].size_m[0]


def test_walks_are_steady_within_a_leg_and_beside_follows_them() -> None:
    generator, room = np.random.default_rng(1), floor_rooms(0, 0)[0]
    walk = walk_in(generator, room, 400)
    same = np.diff(walk.leg) == 0
    steps = np.linalg.norm(np.diff(walk.xy_m, axis=0), axis=1)
    np.testing.assert_allclose(steps[same], 0.12, atol=1e-9)
    assert same.mean() > 0.8
    again = beside(generator, walk, 50, 96)
    gaps = np.linalg.norm(again.xy_m[:, None] - walk.xy_m[None], axis=2).min(axis=1)
    assert gaps.max() < 0.6


def test_shards_that_lie_there_are_left_as_they_are(tmp_path: Path) -> None:
    shards = make_spots(tmp_path, 3, quiet, spots=40, shard_maps=2)
    kept, made = shards[0].read_bytes(), shards[1].read_bytes()
    shards[1].unlink()
    shards[0].touch()
    before = shards[0].stat().st_mtime_ns
    assert make_spots(tmp_path, 3, quiet, spots=40, shard_maps=2) == shards
    assert shards[0].stat().st_mtime_ns == before
    assert (shards[0].read_bytes(), shards[1].read_bytes()) == (kept, made)
    assert np.load(places_of(shards[0])).shape == (80, 4)


def test_another_phone_walks_another_way_the_same_phone_does_not_differ_in_place() -> None:
    same = make_lookups([0], 1, other_phone=False, spots=200)
    assert same.vectors.shape == (1, 16, 128)
    assert (make_lookups([0], 1, other_phone=False, spots=200).vectors == same.vectors).all()
    assert not np.allclose(make_lookups([0], 1, other_phone=True, spots=200).vectors, same.vectors)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which all three studies work."""
    pytest.importorskip("faiss", reason="the extra buildings is not installed")
    return tmp_path_factory.mktemp("nearest")


def test_recall_sizes_and_random_vectors(out: Path) -> None:
    finding = measure_nearest(Given(kept=out / "nearest.partial"), extent=SMALL, random_spots=2000)
    assert isinstance(finding.page, Page)
    by_way = {
        (row["vectors"], row["spots"], row["way"], row["effort"]): row for row in finding.rows
    }
    flat = by_way["ELFs", 900, "flat", 1]
    assert flat["recall at 1"] == flat["in 10"] == 1.0
    assert flat["bytes per spot"] == pytest.approx(256, abs=1)
    assert by_way["ELFs", 300, "ivf-flat", 64]["recall at 1"] == 1.0
    few, many = (by_way["random vectors", 2000, "ivf-flat", effort] for effort in (1, 64))
    assert float(str(few["recall at 1"])) < float(str(many["recall at 1"])) == 1.0
    assert open_index(out / "nearest.material" / "index-900-ivf-flat").meta.count == 900
    assert all(row.keys() == finding.rows[0].keys() for row in finding.rows)


def test_votes_name_the_map_and_strangers_are_mostly_none_of_them(out: Path) -> None:
    finding = measure_nearest_map(Given(kept=out / "nearest-map.partial"), extent=SMALL)
    assert isinstance(finding, Finding)
    for row in finding.rows:
        ends = [float(str(row[name])) for name in ("right", "wrong", "ambiguous", "unknown")]
        assert sum(ends) == pytest.approx(1.0, abs=0.01)
        if row["visitor"] == "stranger":
            assert row["right map"] == row["right"] == 0
        elif row["footsteps"] == 16:
            assert float(str(row["right building"])) == 1.0


def test_times_leave_the_indexes_as_they_were(out: Path) -> None:
    rows = measure_nearest_times(Given(kept=out / "nearest-times.partial"), extent=SMALL, single=3)
    assert [row["way"] for row in rows] == ["flat", "ivf-flat"] * 2
    assert all(float(str(row["median (ms)"])) > 0 for row in rows)
    assert not list((out / "nearest.material").glob("*copy"))
    assert open_index(out / "nearest.material" / "index-900-flat").meta.revision == 1
