"""Whatever is done to a log, it is read or refused in one line."""

from __future__ import annotations

import io
import random
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.data.importing import Imported, LogFormat, read_logs
from elfslam.data.recordings import read_recording, write_recording

T_S = np.arange(80) * 0.02
ROUNDS = 60
NASTY = (
    b"NaN",
    b"1e999",
    b"-",
    b"\x00",
    b"\xff\xfe",
    b'"',
    b";;",
    b"\n\n",
    b",",
    b"\t",
    b"9" * 400,
)


def rows(values: str, separator: str, unit: float = 1.0, decimals: int = 6) -> str:
    return "\n".join(f"{t_s * unit:.{decimals}f}{separator}{values}" for t_s in T_S) + "\n"


def phyphox() -> dict[str, str]:
    head = '"Time (s)","X ({0})","Y ({0})","Z ({0})"\n'
    return {
        "Accelerometer.csv": head.format("m/s^2") + rows("0.1,0.2,9.8", ","),
        "Gyroscope.csv": head.format("rad/s") + rows("0.1,0.2,0.3", ","),
        "Magnetometer.csv": head.format("µT") + rows("1E1,2E1,-3E1", ","),
        "Sound.csv": '"Sound"\n' + "0.5\n-0.5\n" * 40_000,
        "Sound rate.csv": '"Sound rate (Hz)"\n48000\n',
        "meta/device.csv": '"property","value"\n"deviceModel","Pixel"\n',
        "meta/time.csv": '"event","experiment time"\n"START",0\n"PAUSE",1.6\n',
    }


def sensorlogger() -> dict[str, str]:
    head = "seconds_elapsed,z,y,x\n"
    networks = "seconds_elapsed,ssid,bssid,level\n0.5,home,aa,-50\n0.5,,bb,-60\n"
    return {
        "Metadata.csv": "device name,platform,standardisation\niPhone,ios,false\n",
        "Accelerometer.csv": head + rows("0.1,0.2,0.3", ","),
        "Gravity.csv": head + rows("-9.8,0,0", ","),
        "Gyroscope.csv": head + rows("0.1,0.2,0.3", ","),
        "Magnetometer.csv": head + rows("10,20,30", ","),
        "Orientation.csv": "seconds_elapsed,qx,qy,qz,qw\n" + rows("0,0,0,1", ","),
        "WiFi.csv": networks,
    }


def ronin() -> dict[str, str]:
    return {
        "acce.txt": "# Created\n" + rows("0.1 0.2 9.8", " ", 1e9, 0),
        "gyro.txt": "# Created\n" + rows("0.1 0.2 0.3", " ", 1e9, 0),
        "magnet.txt": rows("10 20 30", " ", 1e9, 0),
        "rv.txt": rows("0 0 0 1", " ", 1e9, 0),
        "info.json": '{"device": "asus4"}',
    }


def getsensordata() -> dict[str, str]:
    kinds = {"ACCE": "0.1;0.2;9.8;3", "GYRO": "0.1;0.2;0.3;3", "AHRS": "0;0;0;0;0;0;3"}
    lines = [f"{kind};{t:.3f};{t + 7:.3f};{cells}" for kind, cells in kinds.items() for t in T_S]
    places = ["POSI;0.5;1;40.1;-3.5;1;1", "POSI;1.5;2;40.1001;-3.5;1;1"]
    networks = ["WIFI;0.5;1;home;00:0b:86:27:36:c1;2412;-70"]
    return {"walk.txt": "\n".join(["% Model: Pixel", *lines, *places, *networks]) + "\n"}


LOGS: dict[LogFormat, Callable[[], dict[str, str]]] = {
    LogFormat.PHYPHOX: phyphox,
    LogFormat.SENSORLOGGER: sensorlogger,
    LogFormat.RONIN: ronin,
    LogFormat.GETSENSORDATA: getsensordata,
}


def packed(files: dict[str, bytes], *, alone: bool) -> bytes:
    if alone:
        return b"".join(files.values())
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Cut off, overwritten, with something nasty put in, a stretch lost, or told twice."""
    first, last = sorted(chance.randrange(len(content) + 1) for _ in range(2))
    last = min(last, first + 200)
    return chance.choice(
        [
            content[:first],
            content[:first] + chance.choice(NASTY) + content[first:],
            content[:first] + chance.choice(NASTY) + content[last:],
            content[:first] + content[last:],
            content[:first] + chance.randbytes(last - first) + content[last:],
            content[:last] + content[first:],
            b"",
        ]
    )


def imported(log_format: LogFormat, path: Path) -> Imported:
    (item,) = read_logs(log_format, path, np.random.default_rng(0))
    assert isinstance(item, Imported)
    return item


def refusal_of(log_format: LogFormat, path: Path) -> bool:
    """Whether it is refused, and then in one line that names the log."""
    try:
        recording = imported(log_format, path).recording
    except InputError as cause:
        said = str(cause)
    else:
        assert np.isfinite(recording.imu.accel_mps2).all()
        return False
    assert said.startswith(str(path))
    assert "\n" not in said
    return True


def log_in(folder: Path, log_format: LogFormat) -> Path:
    return folder / ("walk.txt" if log_format is LogFormat.GETSENSORDATA else "walk.zip")


@pytest.mark.parametrize("log_format", LOGS)
def test_a_whole_log_becomes_a_recording_that_is_read_back(
    tmp_path: Path, log_format: LogFormat
) -> None:
    path = log_in(tmp_path, log_format)
    whole = {name: text.encode() for name, text in LOGS[log_format]().items()}
    path.write_bytes(packed(whole, alone=path.suffix == ".txt"))
    item = imported(log_format, path)
    write_recording(item.recording, tmp_path / "walk", truth=item.truth)
    again = read_recording(tmp_path / "walk")
    np.testing.assert_allclose(again.imu.t_s, T_S, atol=2e-6)
    np.testing.assert_allclose(again.imu.accel_mps2, item.recording.imu.accel_mps2, atol=1e-6)
    assert (again.audio is not None) == (log_format is LogFormat.PHYPHOX)
    assert (tmp_path / "walk" / "waypoints.csv").is_file() == (
        log_format is LogFormat.GETSENSORDATA
    )
    assert item.damaged_lines == 0


@pytest.mark.parametrize("inside", [True, False], ids=["a file of it", "the whole"])
@pytest.mark.parametrize("log_format", LOGS)
def test_a_damaged_log_is_read_or_refused_in_one_line(
    tmp_path: Path, log_format: LogFormat, inside: bool
) -> None:
    path, chance = log_in(tmp_path, log_format), random.Random(7)
    alone = path.suffix == ".txt"
    whole = {name: text.encode() for name, text in LOGS[log_format]().items()}
    refusals = 0
    for _ in range(ROUNDS):
        name = chance.choice(sorted(whole))
        files = {**whole, name: damaged(whole[name], chance)} if inside else whole
        content = packed(files, alone=alone)
        path.write_bytes(content if inside else damaged(content, chance))
        refusals += refusal_of(log_format, path)
    assert refusals or alone, "some of it must have been noticed"
