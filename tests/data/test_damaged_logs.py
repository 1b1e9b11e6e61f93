"""Whatever is done to a log, it is read or refused in one line."""

from __future__ import annotations

import io
import random
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from planted_logs import LOGS, T_S

from elfslam.base.errors import InputError
from elfslam.data.importing import LogFormat, read_logs, recognise
from elfslam.data.log_files import Imported
from elfslam.data.recordings import read_recording, write_recording

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


def damaged_logs(
    log_format: LogFormat, path: Path, chance: random.Random, *, inside: bool
) -> Iterator[Path]:
    """The log at a path, damaged anew each time, as a whole or `inside` one of its files."""
    whole = {name: text.encode() for name, text in LOGS[log_format]().items()}
    for _ in range(ROUNDS):
        name = chance.choice(sorted(whole))
        files = {**whole, name: damaged(whole[name], chance)} if inside else whole
        content = packed(files, alone=log_format is LogFormat.GETSENSORDATA)
        path.write_bytes(content if inside else damaged(content, chance))
        yield path


@pytest.mark.parametrize("inside", [True, False], ids=["a file of it", "the whole"])
@pytest.mark.parametrize("log_format", LOGS)
def test_a_damaged_log_is_read_or_refused_in_one_line(
    tmp_path: Path, log_format: LogFormat, inside: bool
) -> None:
    path = log_in(tmp_path, log_format)
    damages = damaged_logs(log_format, path, random.Random(7), inside=inside)
    refusals = sum(refusal_of(log_format, each) for each in damages)
    assert refusals or path.suffix == ".txt", "some of it must have been noticed"


@pytest.mark.parametrize("inside", [True, False], ids=["a file of it", "the whole"])
@pytest.mark.parametrize("log_format", LOGS)
def test_a_damaged_log_is_never_taken_for_another(
    tmp_path: Path, log_format: LogFormat, inside: bool
) -> None:
    damages = damaged_logs(log_format, tmp_path / "walk", random.Random(11), inside=inside)
    known = [recognised(each) for each in damages]
    assert set(known) <= {log_format, None}
    assert log_format in known or not inside


def recognised(path: Path) -> LogFormat | None:
    """The format; None where it is refused in one line that names the log."""
    try:
        return recognise(path)
    except InputError as cause:
        said = str(cause)
    assert said.startswith(str(path))
    assert "\n" not in said
    return None
