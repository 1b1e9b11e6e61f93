"""Archives (.tar.xz) of texts: read one after the other, and never more than can be believed."""

from __future__ import annotations

import io
import lzma
import struct
import tarfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from elfslam.base.bounds import FREE_BYTES, RATIO, check_claim
from elfslam.base.errors import InputError

ENDING = ".txt"
MOST_MEMBERS = 100_000
BROKEN = (
    tarfile.TarError,
    lzma.LZMAError,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    OverflowError,
    LookupError,
)
"""What tarfile and lzma let through of an archive that was cut off, overwritten or made up."""


def check_archive(path: Path) -> None:
    """Raises InputError where an archive is broken, holds no text or what is no plain file."""
    if sum(1 for _ in texts_in(path)) == 0:
        raise InputError(f"{path}: holds no walk; wanted {ENDING} files")


def texts_in(path: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each text in an archive, in its order. Raises InputError."""
    file_bytes = path.stat().st_size
    try:
        with (
            lzma.open(path) as unpacked,
            tarfile.open(
                fileobj=_Bounded(unpacked, FREE_BYTES + RATIO * file_bytes), mode="r|"
            ) as archive,
        ):
            for count, member in enumerate(archive):
                _check_member(path, member, count, file_bytes)
                content = archive.extractfile(member) if member.name.endswith(ENDING) else None
                if content is not None:
                    yield PurePosixPath(member.name).name, content.read()
    except BROKEN as cause:
        raise InputError(f"{path}: is a broken archive ({cause!s:.120}); copy it again") from cause


class _Bounded(io.RawIOBase):
    """A stream that ends in an error once more came out of it than was allowed."""

    def __init__(self, stream: IO[bytes], left_bytes: int) -> None:
        self._stream, self._left_bytes = stream, left_bytes

    def read(self, size: int = -1, /) -> bytes:
        piece = self._stream.read(size)
        self._left_bytes -= len(piece)
        if self._left_bytes < 0:
            raise tarfile.ReadError("unpacks to more than can be believed")
        return piece


def _check_member(path: Path, member: tarfile.TarInfo, count: int, file_bytes: int) -> None:
    if count >= MOST_MEMBERS:
        raise InputError(f"{path}: has more than {MOST_MEMBERS} entries; cut it in parts")
    if member.issparse() or not (member.isfile() or member.isdir()):
        raise InputError(f"{path}: holds {member.name!r:.60}, which is no plain file; pack files")
    check_claim(path, f"{member.name!r:.60}", member.size, file_bytes)
