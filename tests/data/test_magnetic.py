"""The magnetic walks: what the drift does, and whether the frames were understood."""

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from elfslam.base import bounds
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, rotation_from_quaternion, wrap_angle
from elfslam.data.magnetic import read_magnetic, read_mat

HALF = np.sqrt(0.5)


def planted(rows: int = 200) -> dict[str, np.ndarray]:
    """A straight walk along y at 1 m/s, the camera level and looking along y.

    Then camera x is world x, camera y (the device's x) is up and camera z is -y; the field of
    20 microtesla along y and -40 up is (-40, 0, -20) in the device's axes.
    """
    t_s = np.arange(rows)[:, None] * 0.1
    return {
        "t": t_s + 5.0,
        "tm": t_s + 5.002,
        "quat": np.tile([HALF, HALF, 0, 0], (rows, 1)),
        "m": np.tile([-40.0, 0.0, -20.0], (rows, 1)),
        "dPos": np.tile([0.0, 0.1, 0.0], (rows - 1, 1)),
    }


def mat_file(folder: Path, data: dict[str, np.ndarray], name: str = "straight") -> Path:
    scipy.io.savemat(folder / f"{name}.mat", data)
    return folder / f"{name}.mat"


def test_truth_of_a_planted_walk(tmp_path: Path) -> None:
    recording, truth = read_magnetic(mat_file(tmp_path, planted()), np.random.default_rng(0))
    along = np.arange(200) * 0.1
    poses = np.column_stack([0 * along, along, np.full(200, np.pi / 2)])
    np.testing.assert_allclose(truth.world_from_body, poses, atol=1e-12)
    np.testing.assert_allclose(truth.t_s, along)
    np.testing.assert_allclose(recording.magnetometer.t_s, along + 0.002)


def test_the_attitude_levels_the_field_and_its_yaw_drifts_with_the_odometry(tmp_path: Path) -> None:
    recording, truth = read_magnetic(mat_file(tmp_path, planted()), np.random.default_rng(0))
    turn = rotation_from_quaternion(recording.orientation.world_from_phone)
    field = np.einsum("nij,nj->ni", turn, recording.magnetometer.field_ut)
    error = recording.odometry.world_from_body[:, 2] - truth.world_from_body[:, 2]
    np.testing.assert_allclose(field[:, 2], -40)
    drifted = np.column_stack([-20 * np.sin(error), 20 * np.cos(error)])
    np.testing.assert_allclose(field[:, :2], drifted, atol=1e-9)
    assert abs(wrap_angle(error[-1])) > 0.02


def test_drift_has_the_stated_size(tmp_path: Path) -> None:
    file = mat_file(tmp_path, planted(2000))
    biases, scales = [], []
    for seed in range(20):
        recording, _ = read_magnetic(file, np.random.default_rng(seed))
        moves = between(*(recording.odometry.world_from_body[k:][:1999] for k in (0, 1)))
        assert abs(moves[:, 2].std() - 0.01) < 0.001
        assert abs(moves[:, 1].std() - 0.01) < 0.001
        biases.append(moves[:, 2].mean() / 0.1)
        scales.append(moves[:, 0].mean() / 0.1)
    # 0.01 rad a sample leaves 0.0022 rad/s of uncertainty in the mean of 1999 samples.
    assert abs(np.abs(biases).mean() - 0.005) < 0.002
    assert min(biases) < 0 < max(biases)
    assert 0.015 < np.std(scales) < 0.05
    assert abs(np.mean(scales) - 1) < 0.03


def test_drift_follows_the_generator(tmp_path: Path) -> None:
    file = mat_file(tmp_path, planted())
    first, again, other = (
        read_magnetic(file, np.random.default_rng(seed))[0].odometry.world_from_body
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.01


def test_lead_in_of_library_is_dropped(tmp_path: Path) -> None:
    file = mat_file(tmp_path, planted(), name="library")
    recording, truth = read_magnetic(file, np.random.default_rng(0))
    assert len(truth.t_s) == 51 == len(recording.odometry.t_s)
    np.testing.assert_allclose(truth.world_from_body[[0, -1], 1], [0, 5.0])
    assert truth.t_s[0] == 0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"quat": np.zeros((200, 3))}, r"quat has shape \(200, 3\)"),
        ({"dPos": np.zeros((200, 3))}, r"dPos has shape \(200, 3\), wanted \(199, 3\)"),
        ({"m": np.zeros((0, 3))}, "has shape"),
        ({"tm": planted()["tm"] * 1000}, "tm steps by 100 to 100 s"),
        ({"t": planted()["t"] * 1000, "tm": planted()["tm"] * 1000}, "t steps by 100 to 100 s"),
        ({"tm": planted()["tm"][::-1]}, "tm steps by -0.1"),
        ({"tm": np.full((200, 1), 5.0)}, "tm steps by 0"),
        ({"tm": planted()["tm"] + 60}, "tm is up to 60"),
        ({"tm": planted()["tm"] * 1.2}, "tm is up to"),
        ({"m": np.full((200, 3), 1e160)}, "m reaches 1e.160, wanted at most 5000"),
    ],
)
def test_other_shapes_are_refused(tmp_path: Path, change: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_magnetic(mat_file(tmp_path, {**planted(), **change}), np.random.default_rng(0))


def test_missing_and_damaged_files_are_refused(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    with pytest.raises(InputError, match="No such file"):
        read_magnetic(tmp_path / "none.mat", generator)
    file = mat_file(tmp_path, planted())
    for content in (b"", b"not a mat file" * 20, file.read_bytes()[:700]):
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"straight\.mat: "):
            read_magnetic(file, generator)


@pytest.mark.parametrize(
    ("name", "length_m", "rows"), [("eight", 47, 466), ("library", 166, 1436), ("square", 85, 747)]
)
def test_real_walks_are_read(shared_data: Path, name: str, length_m: float, rows: int) -> None:
    file = shared_data / "magnetic" / f"{name}.mat"
    recording, truth = read_magnetic(file, np.random.default_rng(0))
    moves = np.diff(truth.world_from_body[:, :2], axis=0)
    steps_m = np.linalg.norm(moves, axis=1)
    assert len(truth.t_s) == rows
    assert abs(steps_m.sum() - length_m) < 2
    # The truth's heading is the direction of travel.
    walking = steps_m > 0.05
    travel = np.arctan2(moves[:, 1], moves[:, 0]) - truth.world_from_body[:-1, 2]
    mean = np.exp(1j * travel[walking]).mean()
    assert abs(mean) > 0.97
    assert abs(np.angle(mean)) < 0.1
    # Levelled, the field points steadily down and is 40 to 60 microtesla.
    turn = rotation_from_quaternion(recording.orientation.world_from_phone)
    vertical = np.einsum("nij,nj->ni", turn, recording.magnetometer.field_ut)[:, 2]
    assert -55 < vertical.mean() < -38
    assert vertical.std() < 8
    assert vertical.max() < 0
    # The odometry is off by metres at its worst, not by centimetres and not by tens.
    error_m = recording.odometry.world_from_body[:, :2] - truth.world_from_body[:, :2]
    assert 0.2 < np.linalg.norm(error_m, axis=1).max() < 30


MATRIX, PACKED, DOUBLE = 14, 15, 9


@pytest.mark.parametrize("compressed", [True, False])
def test_arrays_come_back(tmp_path: Path, compressed: bool) -> None:
    made = {"m": np.arange(6.0).reshape(2, 3), "t": np.arange(4, dtype=np.int32)[:, None]}
    scipy.io.savemat(tmp_path / "a.mat", made, do_compression=compressed)
    found = read_mat(tmp_path / "a.mat", ["m", "t", "absent"])
    assert set(found) == {"m", "t"}
    for name, array in made.items():
        np.testing.assert_array_equal(found[name], array)


def element(kind: int, content: bytes, size: int | None = None) -> bytes:
    return struct.pack("<II", kind, len(content) if size is None else size) + content


def matrix(shape: tuple[int, int], content: bytes, flags: int = 6) -> bytes:
    parts = [
        element(6, struct.pack("<II", flags, 0)),
        element(5, struct.pack("<ii", *shape)),
        element(1, b"m" + bytes(7), 1),
        content,
    ]
    return element(MATRIX, b"".join(parts))


def stored(folder: Path, *elements: bytes) -> Path:
    head = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
    (folder / "a.mat").write_bytes(head + b"".join(elements))
    return folder / "a.mat"


def refused(path: Path) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=r"cannot be read as a \.mat file") as refusal:
            read_mat(path, ["m"])
    return "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "content",
    [
        matrix((10**6, 10**6), element(DOUBLE, bytes(8))),
        matrix((2, 2), element(DOUBLE, bytes(8), 2**32 - 1)),
        matrix((10**4, 10**4), b"", flags=1),
        matrix((2, 2), b"", flags=2),
        matrix((10**9, 1), element(16, b""), flags=4),
        element(PACKED, b"not packed at all"),
        element(77, bytes(40)),
    ],
    ids=["shape", "size", "cells", "structures", "letters", "packing", "kind"],
)
def test_claims_are_refused(tmp_path: Path, content: bytes) -> None:
    assert refused(stored(tmp_path, content))


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free_bytes = 2**20
    monkeypatch.setattr(bounds, "FREE_BYTES", free_bytes)
    large = matrix((1, free_bytes // 2), element(DOUBLE, bytes(4 * free_bytes)))
    path = stored(tmp_path, element(PACKED, zlib.compress(large, 1)))
    assert path.stat().st_size < free_bytes / 50
    assert refused(path)


def test_other_versions_are_refused(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"m": np.zeros((2, 2))}, format="4")
    assert refused(tmp_path / "a.mat")
    (tmp_path / "a.mat").write_bytes(b"")
    assert refused(tmp_path / "a.mat")
