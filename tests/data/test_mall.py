"""Walks of the mall data set: planted values, damaged lines, and the real archives."""

import itertools
import tarfile
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.data.mall import read_walk, walks_in

START_MS = 1574559495255
HEADER = [f"#\tstartTime:{START_MS}", "#\tBrand:OPPO\tModel:PBCM10\tAndroidName:8.1.0"]


def record(after_ms: int, kind: str, *fields: object) -> str:
    return "\t".join([str(START_MS + after_ms), f"TYPE_{kind}", *map(str, fields)])


def network(after_ms: int, bssid: str, rssi: int, age_ms: int, name: str = "shop") -> str:
    seen_ms = START_MS + after_ms - age_ms
    return record(after_ms, "WIFI", name, bssid, rssi, 2437, seen_ms)


BODY = [
    record(5, "WAYPOINT", 10.5, 20.25),
    record(100, "ACCELEROMETER", 0.1, 0.2, 9.8, 3),
    record(100, "GYROSCOPE", 1.0, 0.0, 0.0, 3),
    record(100, "MAGNETIC_FIELD", 10.0, 20.0, -30.0, 3),
    record(100, "ROTATION_VECTOR", 0.0, 0.0, 0.6, 3),
    record(100, "MAGNETIC_FIELD_UNCALIBRATED", 1, 2, 3, 4, 5, 6, 3),
    record(120, "ACCELEROMETER", 0.3, 0.2, 9.7, 3),
    record(120, "GYROSCOPE", 2.0, 0.0, 0.0, 3),
    record(140, "ACCELEROMETER", 0.5, 0.2, 9.6, 3),
    record(140, "GYROSCOPE", 3.0, 0.0, 0.0, 3),
    network(1900, "aa:bb", -50, 400),
    network(1900, "cc:dd", -60, 7000, name="tab\tin name"),
    network(3900, "aa:bb", -55, 0),
    record(4000, "WAYPOINT", 13.5, 24.25),
]


def walk_file(folder: Path, body: list[str], header: list[str] = HEADER) -> Path:
    file = folder / "5dda02239191710006b57118.txt"
    file.write_text("\n".join([*header, *body]) + "\n", encoding="utf-8")
    return file


def test_planted_values_are_read(tmp_path: Path) -> None:
    walk = read_walk(walk_file(tmp_path, BODY))
    recording = walk.recording
    assert walk.damaged_lines == 0
    assert (recording.name, recording.device) == ("5dda02239191710006b57118", "OPPO PBCM10")
    np.testing.assert_allclose(recording.imu.t_s, [0.1, 0.12, 0.14])
    np.testing.assert_allclose(recording.imu.accel_mps2[:, 0], [0.1, 0.3, 0.5])
    np.testing.assert_allclose(recording.imu.gyro_radps[:, 0], [1, 2, 3])
    assert recording.magnetometer.field_ut.tolist() == [[10, 20, -30]]
    np.testing.assert_allclose(recording.orientation.world_from_phone, [[0, 0, 0.6, 0.8]])
    np.testing.assert_allclose(walk.truth.t_s, [0.005, 4.0])
    poses = [[10.5, 20.25, np.nan], [13.5, 24.25, np.nan]]
    np.testing.assert_array_equal(walk.truth.world_from_body, poses)
    wifi = recording.wifi
    assert wifi.bssids == ("aa:bb", "cc:dd")
    assert wifi.t_s.tolist() == [1.9, 3.9]
    np.testing.assert_array_equal(wifi.rssi_dbm, [[-50, -60], [-55, np.nan]])
    np.testing.assert_allclose(wifi.age_s, [[0.4, 7.0], [0.0, np.nan]])


@pytest.mark.parametrize("k", range(len(BODY) - 1))
def test_two_records_run_together_are_both_recovered(tmp_path: Path, k: int) -> None:
    whole = read_walk(walk_file(tmp_path, BODY))
    glued = [*BODY[:k], BODY[k] + BODY[k + 1], *BODY[k + 2 :]]
    walk = read_walk(walk_file(tmp_path, glued))
    assert walk.damaged_lines == 1
    imu, wanted = walk.recording.imu, whole.recording.imu
    np.testing.assert_array_equal(imu.accel_mps2, wanted.accel_mps2)
    np.testing.assert_array_equal(imu.gyro_radps, wanted.gyro_radps)
    np.testing.assert_array_equal(walk.truth.world_from_body, whole.truth.world_from_body)
    np.testing.assert_array_equal(walk.recording.wifi.rssi_dbm, whole.recording.wifi.rssi_dbm)
    np.testing.assert_array_equal(walk.recording.wifi.age_s, whole.recording.wifi.age_s)


DAMAGED = {
    record(130, "ACCELEROMETER", 7.7, 0.2): "a record cut off",
    record(130, "ACCELEROMETER", 7.7, "x", 0, 3): "a word for a number",
    record(130, "ACCELEROMETER", 7.7, 1, 2, 3, 4): "too many fields",
    record(130, "ACCELEROMETER", 7.7, 0.2) + BODY[7]: "cut off, then the next record",
    record(10**12, "ACCELEROMETER", 7.7, 0, 0, 3): "a time years later",
    "4559495455\tTYPE_ACCEL": "the tail of something",
    record(130, "ACCELEROMETER", 1e300, 0, 0, 3): "an acceleration beyond belief",
    record(130, "MAGNETIC_FIELD", 0, 5001, 0, 3): "a field beyond belief",
    record(130, "ROTATION_VECTOR", 0, 7, 0, 3): "no rotation",
    record(130, "WAYPOINT", 1e300, 0): "a waypoint beyond belief",
    network(1900, "ee:ff", -300, 0): "a signal beyond belief",
    record(5_130, "ACCELEROMETER", 7.7, 0, 0, 3): "a time seconds later",
    record(80, "ACCELEROMETER", 7.7, 0, 0, 3): "a time before",
    record(5_130, "GYROSCOPE", 7.7, 0, 0, 3): "the other sensor seconds later",
    "\ufffd\ufffd": "bytes that are no text",
}


@pytest.mark.parametrize("line", DAMAGED, ids=DAMAGED.get)
def test_what_cannot_be_read_is_counted_and_left_out(tmp_path: Path, line: str) -> None:
    kept = BODY if BODY[7] not in line else [each for each in BODY if each != BODY[7]]
    walk = read_walk(walk_file(tmp_path, [*kept[:7], line, *kept[7:]]))
    assert walk.damaged_lines == 1
    np.testing.assert_allclose(walk.recording.imu.accel_mps2[:, 0], [0.1, 0.3, 0.5])
    np.testing.assert_allclose(walk.recording.imu.gyro_radps[:, 0], [1, 2, 3])


def test_without_start_time_the_first_record_is_zero(tmp_path: Path) -> None:
    walk = read_walk(walk_file(tmp_path, BODY, header=["#\tBrand:OPPO"]))
    np.testing.assert_allclose(walk.truth.t_s, [0, 3.995])


def test_a_walk_may_lack_waypoints_and_wifi(tmp_path: Path) -> None:
    walk = read_walk(walk_file(tmp_path, BODY[1:10]))
    assert walk.truth is None
    assert walk.recording.wifi is None


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_bytes(b"some notes\n\xff\xfe\n")
    with pytest.raises(InputError, match=r"notes\.txt: has no TYPE_ACCELEROMETER records"):
        read_walk(tmp_path / "notes.txt")
    with pytest.raises(InputError, match="cannot be read"):
        read_walk(tmp_path / "missing.txt")


def test_walks_are_found_in_folders_and_archives(tmp_path: Path) -> None:
    data = tmp_path / "site" / "F1"
    data.mkdir(parents=True)
    file = walk_file(data, BODY)
    (data / "floor_info.json").write_text("{}")
    assert list(walks_in(file)) == [file]
    assert list(walks_in(tmp_path)) == [file]
    archive = tmp_path / "site-F1.tar.xz"
    with tarfile.open(archive, "w:xz") as made:
        made.add(tmp_path / "site", "site")
    file.unlink()
    names = [read_walk(path).recording.name for path in walks_in(tmp_path)]
    assert names == [file.stem]
    archive.write_bytes(archive.read_bytes()[:200])
    walk_file(data, BODY)
    for path in (archive, tmp_path):
        with pytest.raises(InputError, match="is a broken archive"):
            next(walks_in(path))


@pytest.mark.parametrize("name", ["...txt", "..txt", ".txt"])
def test_a_walk_is_not_called_like_another_folder(tmp_path: Path, name: str) -> None:
    walk_file(tmp_path, BODY).rename(tmp_path / name)
    assert read_walk(tmp_path / name).recording.name in ("walk", "txt")


def test_nothing_to_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no walk"):
        list(walks_in(tmp_path))
    with pytest.raises(InputError, match="does not exist"):
        list(walks_in(tmp_path / "none"))


def test_real_walks_are_whole_and_plausible(shared_data: Path, tmp_path: Path) -> None:
    """The first three of a floor."""
    with tarfile.open(shared_data / "mall_walks" / "site1-F1.tar.xz") as archive:
        texts = (each for each in archive if each.name.endswith(".txt"))
        archive.extractall(tmp_path, itertools.islice(texts, 3), filter="data")
    paths = list(walks_in(tmp_path))
    assert len(paths) == 3
    for path in paths:
        walk = read_walk(path)
        recording = walk.recording
        assert walk.damaged_lines == 0
        assert recording.device == "OPPO PBCM10"
        imu, attitude = recording.imu, recording.orientation
        assert abs(np.median(np.diff(imu.t_s)) - 0.02) < 0.002
        # The phone's attitude turns the mean acceleration into gravity, straight up.
        up = rotation_from_quaternion(attitude.world_from_phone[: len(imu.t_s)])
        world = np.einsum("nij,nj->ni", up, imu.accel_mps2[: len(up)]).mean(axis=0)
        assert abs(world[2] - 9.81) < 0.4
        assert np.linalg.norm(world[:2]) < 0.5
        legs_m = np.linalg.norm(np.diff(walk.truth.world_from_body[:, :2], axis=0), axis=1)
        speed = legs_m / np.diff(walk.truth.t_s)
        assert (speed < 3).all()
        assert len(legs_m) > 0
        assert walk.truth.t_s[-1] <= imu.t_s[-1] + 1
        assert np.nanmin(recording.wifi.age_s) >= 0
