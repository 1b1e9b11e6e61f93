"""`elfslam merge` and `elfslam locate` by Wi-Fi and magnetic field, on a few real walks."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.enums import Mode
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Checkpoints, FixStatus
from elfslam.data.importing import declared_start
from elfslam.data.log_files import Imported
from elfslam.data.mall import read_walk, walks_in
from elfslam.data.map_files import read_map
from elfslam.data.named_places import read_points
from elfslam.data.position_files import read_fixes
from elfslam.data.recordings import read_recording, write_recording
from elfslam.scoring.truth import read_truth

Command = Callable[..., tuple[int, str]]
COUNT = 8


@pytest.fixture(scope="module")
def walks(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of real walks with declared starts, and beside it one that is asked for."""
    folder = tmp_path_factory.mktemp("floor")
    files = walks_in(shared_data / "mall_walks" / "site1-F1.tar.xz")
    for number, file in enumerate(islice(files, COUNT + 1)):
        walk = read_walk(file)
        item = Imported(walk.recording, walk.truth, walk.damaged_lines)
        place = folder / "asked" if number == COUNT else folder / "walks" / f"walk{number}"
        write_recording(declared_start(item), place, truth=walk.truth)
    return folder


@pytest.fixture
def floor(walks: Path, tmp_path: Path, elfslam: Command) -> Path:
    code, said = elfslam("merge", "--by", "wifi,magnetic", walks / "walks", tmp_path / "floor")
    assert code == 0, said
    assert f"{COUNT} walks in one map" in said
    return tmp_path / "floor"


def test_walks_become_a_map_with_angle_and_declared_starts(walks: Path, floor: Path) -> None:
    made = read_map(floor)
    assert [item.kind for item in made.payloads] == ["wifi", "magnetic"]
    assert made.sources == tuple(f"walk{k}" for k in range(COUNT))
    facts = json.loads((floor / "merge.json").read_text())
    assert facts["magnetic_north_rad"] == pytest.approx(np.pi / 2, abs=0.3)
    for number in range(COUNT):
        declared = read_recording(walks / "walks" / f"walk{number}").start_pose
        first = made.xy_m[(made.walk == number) & (made.order == 0)][0]
        assert np.linalg.norm(first - declared[:2]) < 3.0
        assert np.isnan(declared[2])
    assert (floor / "report.html").is_file()


def test_a_place_a_walker_named_is_mapped(walks: Path, tmp_path: Path, elfslam: Command) -> None:
    for number in range(2):
        place = tmp_path / "walks" / f"walk{number}"
        shutil.copytree(walks / "walks" / f"walk{number}", place)
    recording = read_recording(tmp_path / "walks" / "walk1")
    named = Checkpoints(recording.imu.t_s[-1:], ("Way out",))
    shutil.rmtree(tmp_path / "walks" / "walk1")
    write_recording(replace(recording, checkpoints=named), tmp_path / "walks" / "walk1")
    code, said = elfslam("merge", "--by", "wifi", tmp_path / "walks", tmp_path / "floor")
    assert code == 0, said
    (point,) = read_points(tmp_path / "floor")
    assert point.name == "Way out"
    walked = np.loadtxt(tmp_path / "floor" / "trajectories" / "walk1.tum")
    np.testing.assert_allclose((point.x_m, point.y_m), walked[-1, 1:3], atol=1e-3)


@pytest.mark.parametrize("mode", list(Mode))
def test_a_stranger_is_located_without_a_start(
    walks: Path, floor: Path, tmp_path: Path, elfslam: Command, mode: Mode
) -> None:
    asked, fixes = walks / "asked", tmp_path / "fixes.csv"
    code, said = elfslam("locate", "--by", "wifi", asked, floor, fixes, "--mode", mode)
    assert code == 0, said
    fixes, truth = read_fixes(tmp_path / "fixes.csv"), read_truth(walks / "asked")
    known = fixes.status == FixStatus.OK
    assert known.mean() > 0.5
    true_m = interpolate_poses(truth.t_s, np.nan_to_num(truth.world_from_body), fixes.t_s[known])
    off_m = np.linalg.norm(fixes.xy_m[known] - true_m[:, :2], axis=1)
    assert np.median(off_m) < 40.0
    code, said = elfslam("locate", walks / "asked", floor, tmp_path / "same.csv", "--mode", mode)
    assert code == 0, said
    assert (tmp_path / "same.csv").read_bytes() == (tmp_path / "fixes.csv").read_bytes()


def test_where_the_asked_walk_is_said_to_begin_makes_no_difference(
    walks: Path, floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    lied = tmp_path / "lied"
    shutil.copytree(walks / "asked", lied)
    facts = json.loads((lied / "recording.json").read_text())
    facts["start_pose"] = [1000.0, -1000.0, 2.0]
    (lied / "recording.json").write_text(json.dumps(facts))
    for walk in (walks / "asked", lied):
        elfslam("locate", walk, floor, tmp_path / f"{walk.name}.csv", "--mode", "trajectory")
    assert (tmp_path / "lied.csv").read_bytes() == (tmp_path / "asked.csv").read_bytes()


def test_the_field_changes_where_a_whole_walk_lies(
    walks: Path, floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    for name in ("wifi", "wifi,magnetic"):
        out = tmp_path / f"{name}.csv"
        assert elfslam("locate", "--by", name, walks / "asked", floor, out, "--mode", "trajectory")
    one, other = (read_fixes(tmp_path / f"{name}.csv") for name in ("wifi", "wifi,magnetic"))
    assert np.abs(one.xy_m - other.xy_m).max() > 0.01


def test_what_cannot_be_merged_says_why(walks: Path, tmp_path: Path, elfslam: Command) -> None:
    for name in ("lost", "deaf"):
        shutil.copytree(walks / "walks" / "walk0", tmp_path / "given" / name)
    manifest = tmp_path / "given" / "lost" / "recording.json"
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "start_pose": None}))
    (tmp_path / "given" / "deaf" / "wifi.csv").unlink()
    several = [walks / "walks" / "walk1", tmp_path / "given"]
    code, said = elfslam("merge", "--by", "wifi", *several, tmp_path / "floor")
    assert code == 0
    assert "not merged: lost: nobody says where it began; give start_pose" in said
    assert "not merged: deaf: has no Wi-Fi scan" in said
    assert read_map(tmp_path / "floor").sources == ("walk1",)


def test_a_walk_alone_needs_no_start(walks: Path, tmp_path: Path, elfslam: Command) -> None:
    alone = tmp_path / "alone"
    shutil.copytree(walks / "walks" / "walk0", alone)
    manifest = alone / "recording.json"
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "start_pose": None}))
    code, said = elfslam("merge", "--by", "wifi", alone, tmp_path / "floor")
    assert code == 0
    assert "no two walks tell the angle of the floor" in said


def test_bad_requests_are_refused_in_a_line_and_write_nothing(
    walks: Path, floor: Path, tmp_path: Path, elfslam: Command
) -> None:
    out, several = tmp_path / "out", walks / "walks"
    for by, why in {"emr": "wanted wifi, magnetic or both", "radio": "wanted elf, wifi"}.items():
        code, said = elfslam("merge", "--by", by, several, out)
        assert (code, why in said, out.exists()) == (2, True, False), said
    code, said = elfslam("merge", "--by", "wifi", several, several, out)
    assert "two recordings have the same name" in said
    code, said = elfslam("merge", "--by", "wifi", tmp_path / "nothing", out)
    assert "no walk could be merged; nothing" in said
    assert not out.exists()
    code, said = elfslam("merge", "--by", "wifi", several, floor)
    assert "already exists" in said
    fixes = tmp_path / "fixes.csv"
    code, said = elfslam("locate", "--by", "magnetic", walks / "asked", floor, fixes)
    assert "the field alone tells no place" in said
    code, said = elfslam("locate", "--by", "elf,wifi", walks / "asked", floor, fixes)
    assert "wanted wifi, magnetic or both, got elf" in said
    assert not fixes.exists()
