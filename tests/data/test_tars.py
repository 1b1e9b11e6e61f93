"""Archives from outside: texts come out, what is hostile is refused before any does."""

from __future__ import annotations

import io
import lzma
import tarfile
from pathlib import Path

import pytest

from elfslam.base.bounds import FREE_BYTES
from elfslam.base.errors import InputError
from elfslam.data.log_files import check_archive, texts_in


def entry(name: str, kind: bytes = tarfile.REGTYPE, **more: object) -> tarfile.TarInfo:
    made = tarfile.TarInfo(name)
    made.type = kind
    for key, value in more.items():
        setattr(made, key, value)
    return made


def packed(folder: Path, *entries: tuple[tarfile.TarInfo, bytes]) -> Path:
    path = folder / "a.tar.xz"
    with tarfile.open(path, "w:xz") as archive:
        for info, content in entries:
            info.size = info.size or len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


def test_texts_come_out_in_their_order(tmp_path: Path) -> None:
    path = packed(
        tmp_path,
        (entry("site", tarfile.DIRTYPE), b""),
        (entry("site/b.txt"), b"two"),
        (entry("site/info.json"), b"{}"),
        (entry("../a.txt"), b"one"),
    )
    check_archive(path)
    assert list(texts_in(path)) == [("b.txt", b"two"), ("a.txt", b"one")]


KINDS = {
    "device": (tarfile.CHRTYPE, {"devmajor": 1, "devminor": 5}),
    "disk": (tarfile.BLKTYPE, {"devmajor": 8}),
    "pipe": (tarfile.FIFOTYPE, {}),
    "link": (tarfile.SYMTYPE, {"linkname": "/etc/passwd"}),
    "hard link": (tarfile.LNKTYPE, {"linkname": "b.txt"}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_plain_file_is_refused(tmp_path: Path, kind: str) -> None:
    told, more = KINDS[kind]
    path = packed(tmp_path, (entry("b.txt"), b"x"), (entry("a.txt", told, **more), b""))
    with pytest.raises(InputError, match="no plain file"):
        check_archive(path)


def test_an_archive_without_texts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no walk"):
        check_archive(packed(tmp_path, (entry("a.json"), b"{}")))
    with pytest.raises(InputError, match="holds no walk"):
        check_archive(packed(tmp_path))


def test_bombs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="claims"):
        check_archive(packed(tmp_path, (entry("a.txt"), bytes(FREE_BYTES * 2))))
    several = [(entry(f"{k}.txt"), bytes(FREE_BYTES // 2)) for k in range(4)]
    with pytest.raises(InputError, match="more than can be believed"):
        check_archive(packed(tmp_path, *several))
    head = entry("a.txt", tarfile.XHDTYPE, size=4 * FREE_BYTES).tobuf(tarfile.USTAR_FORMAT)
    (tmp_path / "a.tar.xz").write_bytes(lzma.compress(head + bytes(4 * FREE_BYTES), preset=0))
    with pytest.raises(InputError, match="more than can be believed"):
        check_archive(tmp_path / "a.tar.xz")


def test_countless_entries_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("elfslam.data.log_files.MOST_MEMBERS", 3)
    path = packed(tmp_path, *[(entry(f"{k}.txt"), b"x") for k in range(4)])
    with pytest.raises(InputError, match="more than 3 entries"):
        check_archive(path)


def test_every_byte_may_be_wrong(tmp_path: Path) -> None:
    """In the archive itself: what xz packs has a checksum of its own."""
    whole = lzma.decompress(
        packed(tmp_path, (entry("a.txt"), b"one"), (entry("b.txt"), b"two")).read_bytes()
    )
    refused = 0
    for at in [*range(0, 520, 3), *range(1024, 1540, 5)]:
        for byte in (0, 0xFF):
            damaged = whole[:at] + bytes([byte]) + whole[at + 1 :]
            (tmp_path / "a.tar.xz").write_bytes(lzma.compress(damaged, preset=0))
            try:
                check_archive(tmp_path / "a.tar.xz")
            except InputError as cause:
                refused += 1
                message = str(cause)
                if "\n" in message:
                    raise AssertionError(message) from cause
    assert refused > 100
