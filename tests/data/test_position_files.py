"""Fixes as CSV."""

from pathlib import Path

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from elfslam.base.errors import InputError
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Fixes, FixStatus
from elfslam.data.position_files import read_fixes, read_tum, write_fixes, write_tum


def fixes() -> Fixes:
    nan = np.nan
    covariance = np.array([np.diag([0.04, 0.14]), np.full((2, 2), nan)])
    status = [FixStatus.OK, FixStatus.UNKNOWN_PLACE]
    return Fixes([0.3, 0.9], [[1.5, -2], [nan, nan]], [0.5, nan], covariance, [0.8, 0.1], status)


def test_cells_are_empty_where_there_is_no_position(tmp_path: Path) -> None:
    write_fixes(fixes(), tmp_path / "fixes.csv")
    assert (tmp_path / "fixes.csv").read_text().splitlines() == [
        "t_s,x_m,y_m,heading_rad,sigma_m,status",
        "0.300000,1.500000,-2.000000,0.500000,0.300000,OK",
        "0.900000,,,,,UNKNOWN_PLACE",
    ]


def test_round_trip(tmp_path: Path) -> None:
    write_fixes(fixes(), tmp_path / "fixes.csv")
    read = read_fixes(tmp_path / "fixes.csv")
    for name in ("t_s", "xy_m", "heading_rad", "status"):
        np.testing.assert_array_equal(getattr(read, name), getattr(fixes(), name))
    np.testing.assert_allclose(read.covariance_m2[0], 0.09 * np.eye(2))
    assert np.isnan(read.covariance_m2[1].diagonal()).all()


def test_a_position_may_lack_its_heading_and_not_the_other_way_round(tmp_path: Path) -> None:
    unheaded = Fixes([1.0], [[2.0, 3.0]], [np.nan], [0.04 * np.eye(2)], [1.0], [0])
    write_fixes(unheaded, tmp_path / "fixes.csv")
    read = read_fixes(tmp_path / "fixes.csv")
    np.testing.assert_array_equal(read.xy_m, unheaded.xy_m)
    assert np.isnan(read.heading_rad).all()


def test_no_fixes_round_trip(tmp_path: Path) -> None:
    none = Fixes([], np.empty((0, 2)), [], np.empty((0, 2, 2)), [], [])
    write_fixes(none, tmp_path / "fixes.csv")
    assert len(read_fixes(tmp_path / "fixes.csv").t_s) == 0


HEADER = "t_s,x_m,y_m,heading_rad,sigma_m,status\n"
DAMAGES = {
    "t_s,x_m,y_m\n": "column heading_rad is missing",
    HEADER + "0,1,2,0,0.1,GOOD\n": "row 2 is no fix",
    HEADER + "0,1,2,0,0.1\n": "row 2 is no fix",
    HEADER + "0,one,2,0,0.1,OK\n": "row 2 is no fix",
    HEADER + "0,,,,,OK\n": "row 2 lacks its time or position",
    HEADER + "0,,,0,,UNKNOWN_PLACE\n": "row 2 lacks its time or position",
    HEADER + "0,1,,0,0.1,AMBIGUOUS\n": "row 2 lacks its time or position",
    HEADER + "0,inf,inf,inf,inf,NO_ECHO\n": "row 2 lacks .* or is beyond belief",
    HEADER + "0,1,2,0,1e200,OK\n": "row 2 lacks .* or is beyond belief",
    HEADER + "1,1,2,0,0.1,OK\n0,1,2,0,0.1,OK\n": "runs backward at row 3",
}


@pytest.mark.parametrize("text", DAMAGES)
def test_damaged_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "fixes.csv").write_text(text)
    with pytest.raises(InputError, match=DAMAGES[text]):
        read_fixes(tmp_path / "fixes.csv")


@settings(max_examples=40, deadline=None)
@given(
    poses=arrays(float, st.tuples(st.integers(1, 20), st.just(3)), elements=st.floats(-1000, 1000))
)
def test_round_trip_of_tum(tmp_path_factory: pytest.TempPathFactory, poses: np.ndarray) -> None:
    file = tmp_path_factory.mktemp("tum") / "trajectory.tum"
    t_s = np.arange(len(poses)) * 0.5
    write_tum(file, t_s, poses)
    read_t_s, read = read_tum(file)
    np.testing.assert_allclose(read_t_s, t_s)
    np.testing.assert_allclose(read[:, :2], poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angle(read[:, 2] - poses[:, 2]), 0, atol=4e-9)


def test_evo_reads_the_same_poses(tmp_path: Path) -> None:
    poses = np.array([[1.0, 2.0, 0.3], [3.0, -4.0, -2.5]])
    write_tum(tmp_path / "a.tum", np.array([0.0, 1.0]), poses)
    trajectory = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    for pose, matrix in zip(poses, trajectory.poses_se3, strict=True):
        np.testing.assert_allclose(matrix[:2, 3], pose[:2])
        np.testing.assert_allclose(np.arctan2(matrix[1, 0], matrix[0, 0]), pose[2], atol=1e-8)


def test_heading_of_a_tilted_pose_is_its_turn_about_z(tmp_path: Path) -> None:
    # A yaw of 90 degrees, then a roll of 60 degrees about the new x.
    half, roll = np.sqrt(0.5), np.pi / 6
    w, x, y, z = half * np.cos(roll), half * np.sin(roll), half * np.sin(roll), half * np.cos(roll)
    (tmp_path / "a.tum").write_text(f"0 1 2 3 {x} {y} {z} {w}\n")
    _, poses = read_tum(tmp_path / "a.tum")
    np.testing.assert_allclose(poses, [[1, 2, np.pi / 2]])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0\n", "row 2 has 7 cells"),
        ("0 0 0 0 0 0 0 x\n", "row 1 has 'x'"),
        ("1 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "runs backward at row 2"),
        ("\n", "is empty"),
    ],
)
def test_damaged_files_are_refused_of_tum(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(InputError, match=says):
        read_tum(tmp_path / "a.tum")
