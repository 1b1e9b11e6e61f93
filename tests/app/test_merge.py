"""`elfslam merge` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.app.merge import merge_into
from elfslam.base.errors import InputError, NoAnswerError, StoreError
from elfslam.base.values import PointKind, PointOfInterest, Run
from elfslam.data.map_files import read_map
from elfslam.data.merged_maps import walk_in
from elfslam.data.points_of_interest_files import read_points
from elfslam.data.runs import read_run, write_run
from elfslam.slam.merging import MergeParameters
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import load_encoder
from elfslam.world.simulate import load_world, simulate

KNOWN = MergeParameters()
WORLDS = {
    "one": ("studio", 107),
    "two": ("studio", 111),
    "three": ("studio", 114),
    "away": ("hall", 100),
}
Command = Callable[..., tuple[int, str]]


def ignore(what: str, share: float | None) -> None:
    """Nobody watches."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of mapped walks: three of the studio, one of the hall."""
    folder, encoder = tmp_path_factory.mktemp("runs"), load_encoder("compact")
    for name, (world, seed) in WORLDS.items():
        recording, _ = simulate(load_world(world), seed, rounds=2)
        run: Run = map_by_echoes(recording, encoder, Parameters())
        x_m, y_m = run.trajectory.world_from_body[0, :2].tolist()
        named = (PointOfInterest(f"Start of {name}", PointKind.OTHER, x_m, y_m),)
        bare = replace(run, echoes=None, points_of_interest=named)
        write_run(bare, folder / name, facts={}, encoder=b"an encoder")
    return folder


def test_walks_are_merged_into_a_map_and_one_more_is_added(
    runs: Path, tmp_path: Path, elfslam: Command
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    code, said = elfslam("merge", runs / "one", runs / "two", runs / "away", first)
    assert code == 0
    assert "not merged: away" in said
    made = read_map(first)
    assert made.sources == ("one", "two")
    assert (first / "encoder.onnx").read_bytes() == b"an encoder"
    assert 10_000 < (first / "report.html").stat().st_size < 500_000
    named = {each.name: (each.x_m, each.y_m) for each in read_points(first)}
    starts = {f"Start of {name}": walk_in(first, name)[1][0, :2] for name in made.sources}
    assert named.keys() == starts.keys(), "who stays out names nothing"
    for name, xy_m in starts.items():
        npt.assert_allclose(named[name], xy_m, atol=2e-3)
    facts = json.loads((first / "merge.json").read_text())
    assert [pair["outcome"] == "merged" for pair in facts["pairs"]] == [True, False, False]
    code, said = elfslam("merge", first, runs / "three", runs / "away", second)
    assert code == 0
    grown = read_map(second)
    assert grown.sources == ("one", "two", "three")
    npt.assert_array_equal(grown.xy_m[grown.walk < 2], made.xy_m)
    assert [each.name for each in read_points(second)] == [*named, "Start of three"]
    assert elfslam("show", second, tmp_path / "map.html")[0] == 0
    assert sorted(file.stem for file in (second / "trajectories").iterdir()) == ["three"]


def test_nothing_to_merge_is_exit_code_1_and_writes_nothing(
    runs: Path, tmp_path: Path, elfslam: Command
) -> None:
    code, said = elfslam("merge", runs / "one", runs / "away", tmp_path / "out")
    assert (code, said.count("\n")) == (1, 1)
    assert "no two walks could be merged" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (("one",), "wanted two walks"),
        (("one", "one"), "name each run once"),
        (("one", "nowhere"), "nowhere"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    runs: Path, tmp_path: Path, elfslam: Command, names: tuple[str, ...], reason: str
) -> None:
    code, said = elfslam("merge", *(runs / name for name in names), tmp_path / "out")
    assert (code, said.count("\n")) == (2, 1)
    assert reason in said


def test_a_map_takes_no_walk_twice_and_no_second_map(runs: Path, tmp_path: Path) -> None:
    merge_into(tmp_path / "map", [runs / "one", runs / "two"], KNOWN, ignore)
    with pytest.raises(InputError, match="one is in the map already"):
        merge_into(tmp_path / "out", [tmp_path / "map", runs / "one"], KNOWN, ignore)
    with pytest.raises(InputError, match="one map at most"):
        merge_into(tmp_path / "out", [tmp_path / "map"] * 2, KNOWN, ignore)
    with pytest.raises(InputError, match="got none"):
        merge_into(tmp_path / "out", [tmp_path / "map"], KNOWN, ignore)
    with pytest.raises(NoAnswerError, match="no walk could be added; away with the map: "):
        merge_into(tmp_path / "out", [tmp_path / "map", runs / "away"], KNOWN, ignore)


def test_only_an_older_map_gives_way(runs: Path, tmp_path: Path) -> None:
    walks = [runs / "one", runs / "two"]
    merge_into(tmp_path / "map", walks, KNOWN, ignore)
    (tmp_path / "map" / "old.txt").write_text("of the older map")
    with pytest.raises(StoreError, match="already exists"):
        merge_into(tmp_path / "map", walks, KNOWN, ignore)
    merge_into(tmp_path / "map", walks, KNOWN, ignore, overwrite=True)
    assert not (tmp_path / "map" / "old.txt").exists()
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("dear")
    with pytest.raises(StoreError, match=r"holds no merge\.json"):
        merge_into(tmp_path / "letters", walks, KNOWN, ignore, overwrite=True)


def test_known_starts_put_all_walks_in_one_frame(runs: Path, tmp_path: Path) -> None:
    paths = [runs / "one", runs / "away"]
    made = merge_into(tmp_path / "map", paths, KNOWN, ignore, known_starts=True)
    assert made.floor_map.sources == ("one", "away")
    starts = [walk.world_from_body[0] for walk in made.trajectories.values()]
    assert np.linalg.norm(starts[1] - starts[0]) < 3 * KNOWN.merging.start_sigma_m


def test_known_starts_lay_a_walk_in_the_frame_of_a_map(runs: Path, tmp_path: Path) -> None:
    base = tmp_path / "map"
    merge_into(base, [runs / "one", runs / "two"], KNOWN, ignore)
    made = merge_into(tmp_path / "more", [base, runs / "away"], KNOWN, ignore, known_starts=True)
    assert (made.pairs, made.refused) == ([], {})
    assert made.floor_map.sources == ("one", "two", "away")
    began = read_run(runs / "away").odometry.world_from_body[0]
    off_m = np.linalg.norm((made.trajectories["away"].world_from_body[0] - began)[:2])
    assert off_m < 3 * KNOWN.merging.start_sigma_m
