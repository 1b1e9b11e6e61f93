"""Whole recordings as zips: the server never opens one, and what is hostile is refused in words."""

from __future__ import annotations

import base64
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from elfslam.serve.problems import Problem
from elfslam.serve.receiving.reading import read_apart
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}


def zipped(path: Path, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("recording.json", b'{"format_version": 1, "device": "phone"}')
        archive.writestr("wifi.csv", b"t_s,bssid,rssi_dbm,frequency_mhz,age_s\n" + b"0,a,-50,,0\n")
    return path.read_bytes()


def lzma_with_changed_bytes(path: Path) -> bytes:
    whole = zipped(path, zipfile.ZIP_LZMA)
    return whole[:60] + bytes([whole[60] ^ 0xFF]) + whole[61:]


def a_directory_of_a_million(path: Path) -> bytes:
    """It costs its sender 47 MB; here a tenth is enough to be over the limit."""
    count = 100_000
    entry = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", *[0] * 16)
    size = count * len(entry)
    ends = (b"PK\x05\x06", 0, 0, count & 0xFFFF, count & 0xFFFF, size, 0, 0)
    return entry * count + struct.pack("<4s4H2LH", *ends)


def a_size_that_lies(path: Path) -> bytes:
    size = struct.pack("<L", len(b'{"format_version": 1, "device": "phone"}'))
    return zipped(path).replace(size, struct.pack("<L", 9_999_999))


def half(path: Path) -> bytes:
    return zipped(path)[:150]


@pytest.mark.parametrize(
    "damage", [lzma_with_changed_bytes, a_directory_of_a_million, a_size_that_lies, half]
)
def test_a_hostile_zip_becomes_a_refused_recording(
    owner: TestClient, services: Services, tmp_path: Path, damage: Callable[[Path], bytes]
) -> None:
    data = damage(tmp_path / "walk.zip")
    name = base64.b64encode(b"walk.zip").decode()
    told = {"Upload-Metadata": f"filename {name}", "Upload-Length": str(len(data))}
    made = owner.post("/api/uploads", headers={**PIECE, **told}, content=data)
    assert made.status_code == 201
    for _ in range(2):
        head = owner.head(made.headers["location"], headers=TUS)
        assert head.status_code in (200, 204)
    kept = owner.get(f"/api/recordings/{head.headers['elfslam-recording']}").json()
    assert (kept["state"], kept["files"]) == ("refused", [])
    assert kept["refusal"].startswith("the .zip")
    assert str(services.settings.data_folder) not in kept["refusal"]
    assert list(services.settings.work_folder.iterdir()) == []
    assert list(services.settings.blobs_folder.glob("*/*")) == []


def test_what_is_in_a_zip_is_read_where_it_was_unpacked(tmp_path: Path) -> None:
    zipped(tmp_path / "walk.zip")
    (tmp_path / "out").mkdir()
    found = read_apart(tmp_path / "out", Limits(free_bytes=0), tmp_path / "walk.zip")
    assert (found.refusal, found.facts["device"], found.facts["sensors"]) == (
        None,
        "phone",
        ["wifi"],
    )
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"recording.json", "wifi.csv"}


def test_a_disk_without_room_is_no_refusal(tmp_path: Path) -> None:
    zipped(tmp_path / "walk.zip")
    (tmp_path / "out").mkdir()
    with pytest.raises(Problem) as full:
        read_apart(tmp_path / "out", Limits(free_bytes=2**62), tmp_path / "walk.zip")
    assert full.value.status_code == 507


def test_a_zip_that_is_cut_off_while_unpacking_leaves_no_file(tmp_path: Path) -> None:
    """Its second file is damaged: the first is none of the recording's either."""
    whole = zipped(tmp_path / "walk.zip")
    at = whole.index(b"wifi.csv") + 12
    (tmp_path / "walk.zip").write_bytes(whole[:at] + b"\xff\xff\xff" + whole[at + 3 :])
    (tmp_path / "out").mkdir()
    found = read_apart(tmp_path / "out", Limits(free_bytes=0), tmp_path / "walk.zip")
    assert "not whole" in str(found.refusal)
    assert [file for file in (tmp_path / "out").iterdir() if file.is_file()] == []
