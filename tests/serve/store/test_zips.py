"""Zips from outside: recordings are taken out of them, tricks are not."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.settings import Limits
from elfslam.serve.store.zips import packed, unpack_recording

SMALL = Limits(file_bytes=10_000, recording_bytes=15_000, free_bytes=0)


def zipped(path: Path, entries: list[tuple[str | zipfile.ZipInfo, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


def unpacked(path: Path, folder: Path, limits: Limits = SMALL) -> dict[str, bytes]:
    folder.mkdir()
    unpack_recording(path, folder, limits)
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("folder", ["", "walk/", "./walk/"])
def test_a_recording_is_taken_out(tmp_path: Path, folder: str) -> None:
    entries: list[tuple[str | zipfile.ZipInfo, bytes]] = [
        (f"{folder}recording.json", b"{}"),
        (f"{folder}wifi.csv", b"t_s"),
        (f"{folder}notes.txt", b"not ours"),
        ("__MACOSX/walk/recording.json", b"not ours either"),
    ]
    found = unpacked(zipped(tmp_path / "w.zip", entries), tmp_path / "out")
    assert found == {"recording.json": b"{}", "wifi.csv": b"t_s"}


def test_hostile_zips_are_refused(tmp_path: Path) -> None:
    """That they are, and how, is told of every zip."""
    path = zipped(tmp_path / "w.zip", [("../recording.json", b"x")])
    with pytest.raises(InputError, match="leads out"):
        unpacked(path, tmp_path / "out")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["out", "w.zip"]


def test_bombs_are_refused_before_they_go_off(tmp_path: Path) -> None:
    large = zipped(tmp_path / "large.zip", [("wifi.csv", bytes(10_001))])
    with pytest.raises(InputError, match="unpacks to more than 10000"):
        unpacked(large, tmp_path / "one")
    two = [("wifi.csv", bytes(9_000)), ("emr.csv", bytes(9_000))]
    with pytest.raises(InputError, match="unpacks to more than 15000"):
        unpacked(zipped(tmp_path / "two.zip", two), tmp_path / "two")
    assert not any((tmp_path / "one").iterdir())


@pytest.mark.parametrize(
    "names",
    [["a/recording.json", "b/wifi.csv"], ["recording.json", "a/recording.json"], ["a/b/wifi.csv"]],
)
def test_several_recordings_are_refused(tmp_path: Path, names: list[str]) -> None:
    path = zipped(tmp_path / "w.zip", [(name, b"{}") for name in names])
    with pytest.raises(InputError, match="pack one recording alone"):
        unpacked(path, tmp_path / "out")


def test_every_cut_is_refused_in_words(tmp_path: Path) -> None:
    whole = zipped(tmp_path / "w.zip", [("recording.json", b"{}" * 50)]).read_bytes()
    for length in range(0, len(whole), 7):
        (tmp_path / "cut.zip").write_bytes(whole[:length])
        with pytest.raises(InputError, match="not whole"):
            unpacked(tmp_path / "cut.zip", tmp_path / f"out{length}")


def test_what_is_packed_unpacks(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"chirp" * 100_000)
    (tmp_path / "b").write_bytes(b"")
    files = {"audio.flac": tmp_path / "a", "recording.json": tmp_path / "b"}
    sent = b"".join(packed(files))
    assert sent == b"".join(packed(files))
    with zipfile.ZipFile(io.BytesIO(sent)) as archive:
        assert archive.testzip() is None
        assert archive.read("audio.flac") == b"chirp" * 100_000


def test_what_is_deleted_meanwhile_is_still_sent(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"chirp")
    pieces = packed({"audio.flac": tmp_path / "a"})
    (tmp_path / "a").unlink()
    with zipfile.ZipFile(io.BytesIO(b"".join(pieces))) as archive:
        assert archive.read("audio.flac") == b"chirp"
    with pytest.raises(FileNotFoundError):
        packed({"audio.flac": tmp_path / "a"})
