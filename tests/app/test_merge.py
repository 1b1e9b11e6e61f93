"""`elfslam merge` as a user meets it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.app.merge import drawn, merge_into
from elfslam.base.errors import InputError, NoAnswerError, StoreError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import ECHO_SAMPLES, FixStatus, PointKind, PointOfInterest, Run
from elfslam.cli.app import run
from elfslam.data.map_files import read_map, walk_in
from elfslam.data.named_places import read_points, write_points
from elfslam.data.position_files import read_fixes
from elfslam.data.recordings import write_recording
from elfslam.data.runs import read_run, write_run
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.scoring.truth import read_truth
from elfslam.slam.merging import MergeParameters
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import OnnxEncoder, load_encoder
from elfslam.stages.floormap import SpotEchoes
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
    with pytest.raises(NoAnswerError, match="no walk could be added; away: with the map: "):
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


DOOR = (PointOfInterest("Door", PointKind.DOOR, 1.0, 2.0),)
FEW = ("--set", "floor_level.steps=4", "--set", "floor_level.opening_batches=1")


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the runs of a walk there and one back, their map, and a recording."""
    folder, encoder = tmp_path_factory.mktemp("floor"), load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    for name, seed in (("there", 100), ("back", 101)):
        recording, truth = simulate(load_world("studio"), seed, rounds=2, reverse=name == "back")
        x_m, y_m, heading_rad = truth.world_from_body[0].tolist()
        started = replace(recording, start_pose=(x_m, y_m, heading_rad))
        made = map_by_echoes(started, encoder, Parameters())
        write_run(replace(made, name=name), folder / name, facts={}, encoder=encoder.content)
    recording, truth = simulate(load_world("studio"), 102, rounds=1)
    write_recording(recording, folder / "asks", truth=truth)
    merged = ["merge", "--known-starts", folder / "there", folder / "back", folder / "map"]
    assert run(list(map(str, merged))) == 0
    return folder


def test_a_map_of_means_locates_without_headings_and_with_its_own_encoder(
    floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    out, fixes = tmp_path / "out", tmp_path / "fixes.csv"
    write_points(DOOR, floor / "map")
    code, said = elfslam("superimpose", floor / "map", out)
    assert (code, "spots for all headings" in said) == (0, True)
    before, made = read_map(floor / "map"), read_map(out)
    assert len(made.xy_m) < 0.8 * len(before.xy_m)
    assert read_points(out) == DOOR
    assert made.sources == before.sources == ("there", "back")
    assert (out / "encoder.onnx").read_bytes() == (floor / "map" / "encoder.onnx").read_bytes()
    assert 10_000 < (out / "report.html").stat().st_size < 500_000
    assert elfslam("locate", floor / "asks", out, fixes)[0] == 0
    found, truth = read_fixes(fixes), read_truth(floor / "asks")
    sure = found.status == FixStatus.OK
    true_m = interpolate_poses(truth.t_s, truth.world_from_body, found.t_s[sure])[:, :2]
    assert sure.mean() > 0.3
    assert np.median(np.linalg.norm(found.xy_m[sure] - true_m, axis=1)) < 0.4
    assert np.isnan(found.heading_rad).all()


def test_an_encoder_learns_from_the_walks_of_the_map(
    floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    learn = ("--learn", floor / "there", "--learn", floor / "back", *FEW)
    for out in (one, two):
        assert elfslam("superimpose", floor / "map", out, *learn)[0] == 0
    content = (one / "encoder.onnx").read_bytes()
    assert content == (two / "encoder.onnx").read_bytes(), "same seed, same bytes"
    card = OnnxEncoder(content, "learned").card
    assert card is not None
    assert card.finetunings[-1].outcome.startswith("floor level")
    assert read_map(one).payloads[0].encoder == OnnxEncoder(content, "learned").identity
    assert json.loads((one / "merge.json").read_text())["learned_from"] == ["there", "back"]
    assert not list(tmp_path.glob("*.checkpoint"))


def test_what_needs_headings_is_refused_in_one_line(
    floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    out = tmp_path / "out"
    assert elfslam("superimpose", floor / "map", out)[0] == 0
    fixes = tmp_path / "fixes.csv"
    for mode in ("track", "trajectory"):
        code, said = elfslam("locate", floor / "asks", out, fixes, "--mode", mode)
        assert (code, said.count("\n"), "is superimposed" in said) == (2, 1, True)
    for verb in (
        ("superimpose", out, tmp_path / "again"),
        ("merge", out, floor / "there", tmp_path / "again"),
    ):
        code, said = elfslam(*verb)
        assert (code, said.count("\n"), "superimposed" in said) == (2, 1, True)
    assert not fixes.exists()
    assert not (tmp_path / "again").exists()


def test_walks_that_the_map_or_the_run_lacks_are_refused(
    floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    stranger, out = tmp_path / "stranger", tmp_path / "out"
    shutil.copytree(floor / "there", stranger)
    code, said = elfslam("superimpose", floor / "map", out, "--learn", stranger)
    assert (code, "has no trajectory of stranger" in said) == (2, True)
    silent = tmp_path / "there"
    shutil.copytree(floor / "there", silent)
    (silent / "echoes.npz").unlink()
    code, said = elfslam("superimpose", floor / "map", out, "--learn", silent)
    assert (code, "holds no echoes" in said) == (2, True)
    assert not out.exists()


def test_a_batch_holds_as_many_echoes_of_each_walk_and_is_the_same_for_a_step() -> None:
    many = SpotEchoes(np.zeros((50, ECHO_SAMPLES), np.float32), np.zeros((50, 2)), np.zeros(50))
    few = SpotEchoes(np.zeros((5, ECHO_SAMPLES), np.float32), np.ones((5, 2)), np.zeros(5))
    batches = [drawn([many, few], FloorLevelParameters(batch=20), 0, step) for step in (3, 3, 4)]
    assert [batch.xy_m[:, 0].sum() for batch in batches] == [10, 10, 10]
    again = drawn([few], FloorLevelParameters(batch=20), 0, 3)
    assert len(again.samples) == 20
