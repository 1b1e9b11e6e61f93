"""Logs of the RoNIN recorder: one text file per sensor."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.data.ronin import read_ronin

T_S = np.arange(100) * 0.005
BOOT_NS = 1_718_030_736_872_695_300
TILT = 0.4
UP = np.array([0.0, np.sin(TILT), np.cos(TILT)])
WORLD_FROM_PHONE = np.array([np.sin(TILT / 2), 0, 0, np.cos(TILT / 2)])


def text(values: np.ndarray, *, tabs: bool = False, late_s: float = 0.0) -> str:
    gap = "\t" if tabs else " "
    ns = BOOT_NS + np.round((T_S + late_s) * 1e9).astype(int)
    rows = [gap.join([str(at), *(f"{cell:.9f}" for cell in values)]) for at in ns]
    return "\n".join(["# Created at Sat Nov 21 2020", *rows]) + "\n"


FILES = {
    "acce.txt": text(9.81 * UP),
    "gyro.txt": text(np.array([0.1, -0.2, 0.3]), tabs=True),
    "magnet.txt": text(np.array([10.0, 20.0, -30.0]), late_s=0.001),
    "rv.txt": text(WORLD_FROM_PHONE),
    "info.json": '{"type": "annotated", "device": "asus4", "length": 0.5}',
}


def folder_of(root: Path, files: dict[str, str]) -> Path:
    folder = root / "a001_1"
    folder.mkdir(exist_ok=True)
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8")
    return folder


def test_sensors_are_read_on_one_clock(tmp_path: Path) -> None:
    recording = read_ronin(folder_of(tmp_path, FILES)).recording
    assert (recording.name, recording.device) == ("a001_1", "asus4")
    np.testing.assert_allclose(recording.imu.t_s, T_S, atol=1e-6)
    np.testing.assert_allclose(recording.imu.accel_mps2[7], 9.81 * UP, atol=1e-8)
    np.testing.assert_allclose(recording.imu.gyro_radps[7], [0.1, -0.2, 0.3])
    np.testing.assert_allclose(recording.magnetometer.t_s, T_S + 0.001, atol=1e-6)
    np.testing.assert_allclose(recording.magnetometer.field_ut[7], [10, 20, -30])


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 0, 1, 2]], ids=["w last", "w first"])
def test_gravity_decides_where_the_w_stands(tmp_path: Path, order: list[int]) -> None:
    files = {**FILES, "rv.txt": text(WORLD_FROM_PHONE[order])}
    attitude = read_ronin(folder_of(tmp_path, files)).recording.orientation.world_from_phone
    np.testing.assert_allclose(rotation_from_quaternion(attitude[0]) @ UP, [0, 0, 1], atol=1e-6)


def test_a_zip_is_read_like_its_folder(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        for name, content in FILES.items():
            archive.writestr(f"a001_1/{name}", content)
    recording = read_ronin(tmp_path / "walk.zip").recording
    assert (recording.name, recording.device) == ("walk", "asus4")
    np.testing.assert_allclose(recording.imu.t_s, T_S, atol=1e-6)


def test_only_motion_is_needed(tmp_path: Path) -> None:
    files = {name: FILES[name].split("\n", 1)[1] for name in ("acce.txt", "gyro.txt")}
    recording = read_ronin(folder_of(tmp_path, files)).recording
    assert recording.device == "unknown"
    assert recording.magnetometer is None
    assert recording.orientation is None


def in_seconds(content: str) -> str:
    lines = content.splitlines()[1:]
    return "\n".join(f"{float(row.split()[0]) / 1e9:.6f} {row.split(None, 1)[1]}" for row in lines)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"acce.txt": None}, "holds no acce.txt"),
        ({"gyro.txt": None}, "with gyro.txt beside it"),
        ({"acce.txt": FILES["acce.txt"][:-20]}, r"acce\.txt: row 101 has 3 cells"),
        ({"acce.txt": "# Created\n"}, "has comments and no rows"),
        ({"acce.txt": ""}, "is empty"),
        (
            {"gyro.txt": FILES["gyro.txt"].replace("0.3", "x", 1)},
            r"gyro\.txt: row 2 has 'x00000000'",
        ),
        ({"gyro.txt": FILES["gyro.txt"].replace("0.300000000", "3e9", 1)}, "wanted at most 100"),
        ({"acce.txt": in_seconds(FILES["acce.txt"])}, "times step by .*, wanted nanoseconds"),
        ({"acce.txt": text(0.01 * UP)}, "with gravity left in"),
        ({"info.json": "{"}, None),
    ],
)
def test_what_is_missing_or_damaged_is_named(
    tmp_path: Path, change: dict[str, str | None], says: str | None
) -> None:
    files = {name: content for name, content in {**FILES, **change}.items() if content is not None}
    folder = folder_of(tmp_path, files)
    if says is None:
        assert read_ronin(folder).recording.device == "unknown"
        return
    with pytest.raises(InputError, match=says):
        read_ronin(folder)
