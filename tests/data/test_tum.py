"""TUM files: round trip, and an independent reader agrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from elfslam.base.errors import InputError
from elfslam.base.geometry import wrap_angle
from elfslam.data.tum import read_tum, write_tum


@settings(max_examples=40, deadline=None)
@given(
    poses=arrays(float, st.tuples(st.integers(1, 20), st.just(3)), elements=st.floats(-1000, 1000))
)
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, poses: np.ndarray) -> None:
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
def test_damaged_files_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(InputError, match=says):
        read_tum(tmp_path / "a.tum")
