"""`elfslam superimpose`: one feature per spot for all headings, of walks there and back."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.app.superimpose import drawn
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import ECHO_SAMPLES, FixStatus, PointKind, PointOfInterest
from elfslam.cli.app import run
from elfslam.data.fixes_files import read_fixes
from elfslam.data.map_files import read_map
from elfslam.data.points_of_interest_files import read_points, write_points
from elfslam.data.recordings import write_recording
from elfslam.data.runs import write_run
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.scoring.truth import read_truth
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import OnnxEncoder, load_encoder
from elfslam.stages.floormap import SpotEchoes
from elfslam.world.simulate import load_world, simulate

DOOR = (PointOfInterest("Door", PointKind.DOOR, 1.0, 2.0),)
Command = Callable[..., tuple[int, str]]
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
