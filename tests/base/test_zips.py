"""Zips from outside: what is whole comes out, what is not is refused in one line."""

import resource
import stat
import struct
import tracemalloc
import zipfile
from pathlib import Path
from shutil import rmtree

import pytest

from elfslam.base.bounds import FREE_BYTES
from elfslam.base.errors import InputError
from elfslam.base.zips import MOST_AT_ONCE, MOST_ENTRIES, opened_zip, unpack_zip

Entry = tuple[str | zipfile.ZipInfo, bytes]


def zipped(path: Path, *entries: Entry, method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


def unpacked(path: Path, folder: Path) -> dict[str, bytes]:
    unpack_zip(path, folder)
    files = [file for file in folder.rglob("*") if file.is_file()]
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def refusal(path: Path) -> str:
    out = path.parent / "out"
    with pytest.raises(InputError) as refused:
        unpack_zip(path, out)
    said = str(refused.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    rmtree(out, ignore_errors=True)
    return said


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_files_come_out_as_they_went_in(tmp_path: Path, method: int) -> None:
    files = {"a.txt": b"x" * 700_000, "deep/er/größe.csv": b"", "deep/b": bytes(range(256))}
    path = zipped(tmp_path / "a.zip", ("deep/", b""), *files.items(), method=method)
    assert unpacked(path, tmp_path / "out") == files
    with opened_zip(path) as packed:
        for name, entry in packed.entries.items():
            assert packed.content(entry) == files[str(name)]


def test_folders_parted_as_windows_does_come_out_as_folders(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", ("b\\", b""), ("b\\c d\\e.csv", b"x"), ("f.csv", b"y"))
    assert unpacked(path, tmp_path / "out") == {"b/c d/e.csv": b"x", "f.csv": b"y"}
    assert "twice" in refusal(zipped(tmp_path / "b.zip", ("b\\c", b"x"), ("b/c", b"y")))


def test_an_overwritten_zip_is_refused_whatever_byte_it_was(tmp_path: Path) -> None:
    """The name as the archive's index says it is not the name beside the file's own bytes."""
    path = zipped(tmp_path / "a.zip", ("größe.txt", b"x" * 50), method=zipfile.ZIP_STORED)
    whole = path.read_bytes()
    refused = set()
    for at in range(len(whole)):
        for byte in (0, 0xF6, 0xFF):
            (tmp_path / "a.zip").write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
            try:
                unpack_zip(tmp_path / "a.zip", tmp_path / "out")
            except InputError:
                refused.add(at)
            rmtree(tmp_path / "out", ignore_errors=True)
    content = range(whole.index(b"x" * 50), whole.index(b"x" * 50) + 50)
    assert refused.issuperset(content), "the checksum notices"
    assert len(refused) < len(whole), "not every byte matters"


def test_a_zip_that_was_cut_off_or_is_none_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", ("a", b"x" * 1000), ("b", b"y" * 1000))
    whole = path.read_bytes()
    for length in range(0, len(whole), 11):
        path.write_bytes(whole[:length])
        assert "not whole" in refusal(path)
    assert "is no file" in refusal(tmp_path / "absent.zip")
    (tmp_path / "folder.zip").mkdir()
    assert "is no file" in refusal(tmp_path / "folder.zip")


@pytest.mark.parametrize(
    "name", ["../a", "/a", "a/../../b", "..\\a", "a\\..\\..\\b", "\\a", "C:/a", "C:\\a", "", "./"]
)
def test_names_that_lead_out_are_refused(tmp_path: Path, name: str) -> None:
    path = zipped(tmp_path / "w.zip", ("good", b"x"), (name or zipfile.ZipInfo(""), b"x"))
    assert "leads out" in refusal(path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["w.zip"]


@pytest.mark.parametrize(
    "names", [["n" * 300], ["a", "a/b"], ["a/b", "a"], ["/".join("a" * 10_000)]]
)
def test_names_that_no_file_can_have_are_refused(tmp_path: Path, names: list[str]) -> None:
    path = zipped(tmp_path / "w.zip", *[(name, b"x") for name in names])
    assert refusal(path).endswith(("rename it", "pack it flat"))


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR, stat.S_IFBLK])
def test_what_is_no_plain_file_is_refused(tmp_path: Path, kind: int) -> None:
    entry = zipfile.ZipInfo("wifi.csv")
    entry.external_attr = (kind | 0o777) << 16
    assert "link" in refusal(zipped(tmp_path / "w.zip", (entry, b"/etc/passwd")))


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_file_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    assert "twice" in refusal(zipped(tmp_path / "w.zip", ("a/b", b"x"), ("a//b", b"y")))
    assert "twice" in refusal(zipped(tmp_path / "w.zip", ("a", b"x"), ("a", b"y")))


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_unusual_methods_are_refused_before_they_run(tmp_path: Path, method: int) -> None:
    path = zipped(tmp_path / "w.zip", ("a", b"x" * 1000), method=method)
    assert "ordinary zip" in refusal(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:40] + bytes([whole[40] ^ 1]) + whole[41:])
    assert "ordinary zip" in refusal(path)


def test_a_password_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "w.zip", ("a", b"x"))
    with path.open("r+b") as stream:
        at = path.read_bytes().index(b"PK\x01\x02")
        stream.seek(at + 8)
        stream.write(b"\x01\x00")
    assert "password" in refusal(path)


def test_a_bomb_is_refused_before_it_goes_off(tmp_path: Path) -> None:
    entries = [(f"{k}", bytes(FREE_BYTES // 4)) for k in range(6)]
    path = zipped(tmp_path / "w.zip", *entries)
    assert path.stat().st_size < 200_000
    assert "claims" in refusal(path)
    assert [file.name for file in tmp_path.iterdir()] == ["w.zip"]


def test_a_size_that_lies_is_found_out(tmp_path: Path) -> None:
    """The directory says 100 bytes or 9,999, the entry holds 9,000."""
    for claimed in (100, 9_999):
        path = zipped(tmp_path / "w.zip", ("a", bytes(9_000)))
        data = path.read_bytes().replace(struct.pack("<L", 9_000), struct.pack("<L", claimed))
        path.write_bytes(data)
        assert "not whole" in refusal(path)
        with opened_zip(path) as packed, pytest.raises(InputError, match="not whole"):
            packed.content(*packed.entries.values())


def test_many_entries_are_refused_without_being_parsed(tmp_path: Path) -> None:
    few = [(str(k), b"") for k in range(MOST_ENTRIES)]
    unpack_zip(zipped(tmp_path / "w.zip", *few), tmp_path / "few")
    assert "entries" in refusal(zipped(tmp_path / "w.zip", *few, ("one more", b"")))
    entry = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", *[0] * 16) + b""
    count = 40 * MOST_AT_ONCE // len(entry)
    counts = (count & 0xFFFF, count & 0xFFFF, count * len(entry))
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, *counts, 0, 0)
    (tmp_path / "w.zip").write_bytes(entry * count + end)
    tracemalloc.start()
    try:
        assert "directory is too large" in refusal(tmp_path / "w.zip")
        assert tracemalloc.get_traced_memory()[1] < 4 * MOST_AT_ONCE
    finally:
        tracemalloc.stop()


def test_a_disk_that_takes_no_more_is_not_the_zips_fault(tmp_path: Path) -> None:
    path = zipped(tmp_path / "w.zip", ("a", b"x" * 10_000))
    known = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, known[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            unpack_zip(path, tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, known)


def test_what_the_user_of_a_zip_raises_is_theirs(tmp_path: Path) -> None:
    path = zipped(tmp_path / "w.zip", ("a", b"x"))
    with pytest.raises(ValueError, match="mine"), opened_zip(path):
        raise ValueError("mine")
