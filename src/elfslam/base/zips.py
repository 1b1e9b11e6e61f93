"""Zips from outside: nothing that they say of themselves is believed before it is bounded."""

import errno
import io
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from elfslam.base.bounds import MEBIBYTE, check_claim
from elfslam.base.errors import InputError

MOST_ENTRIES = 1000
MOST_DEPTH = 20
MOST_AT_ONCE = MEBIBYTE
"""zipfile reads a directory in one piece, as large as it says, and parses all of it."""
COPY_BYTES = 2**18
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
KINDS = (0, stat.S_IFREG, stat.S_IFDIR)
"""What an entry may be: of unknown kind, a file or a folder."""
DRIVE = re.compile(r"[A-Za-z]:")
BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OSError,
    EOFError,
    RuntimeError,
    ValueError,
    OverflowError,
    LookupError,
)
"""What zipfile lets through of an archive that was cut off, overwritten or made up."""
BAD_NAMES = (errno.ENAMETOOLONG, errno.EEXIST, errno.ENOTDIR, errno.EISDIR, errno.EILSEQ)
"""Why no file of that name can be made, whatever the disk."""


@dataclass(frozen=True)
class Zip:
    """An opened zip, whose entries were checked: its files by where they lie in it."""

    path: Path
    archive: zipfile.ZipFile
    entries: Mapping[PurePosixPath, zipfile.ZipInfo]

    def content(self, entry: zipfile.ZipInfo) -> bytearray:
        """All that a file holds. Raises InputError where it is damaged."""
        content = bytearray(entry.file_size)
        end = 0
        for piece in self._pieces(entry):
            content[end : end + len(piece)] = piece
            end += len(piece)
        return content

    def start(self, entry: zipfile.ZipInfo, most_bytes: int) -> bytes:
        """The first bytes of a file, at most so many. Raises InputError where it is damaged."""
        with _refusing(self.path), self.archive.open(entry) as stream:
            return stream.read(most_bytes)

    def text(self, entry: zipfile.ZipInfo) -> str:
        """What a file of text says, in UTF-8. Raises InputError where it is damaged or none."""
        try:
            return self.content(entry).decode("utf-8-sig")
        except UnicodeDecodeError as cause:
            raise InputError(
                f"{self.path}: {entry.filename!r:.60} is no text in UTF-8 ({cause}); pack it again"
            ) from cause

    def unpack(self, entry: zipfile.ZipInfo, target: Path) -> None:
        """Put a file where there is none. Raises InputError where it is damaged, OSError ENOSPC."""
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("xb") as stream:
                for piece in self._pieces(entry):
                    stream.write(piece)
        except OSError as cause:
            if cause.errno not in BAD_NAMES:
                raise
            raise InputError(
                f"{self.path}: no file can be called {entry.filename!r:.60}; rename it"
            ) from cause

    def _pieces(self, entry: zipfile.ZipInfo) -> Iterator[bytes]:
        came = 0
        with _refusing(self.path), self.archive.open(entry) as stream:
            while piece := stream.read(COPY_BYTES):
                came += len(piece)
                yield piece
            if came != entry.file_size:
                raise zipfile.BadZipFile(f"{entry.filename!r:.60} is shorter than it says")


@contextmanager
def opened_zip(path: Path) -> Iterator[Zip]:
    """A zip from outside.

    Raises InputError where it is missing or broken, has too many entries or ones that are no
    plain files, are packed unusually, lead out of it, or unpack to more than can be believed.
    """
    with ExitStack() as opened:
        with _refusing(path):
            if not path.is_file():
                raise InputError(f"{path}: is no file; wanted a .zip, check the path")
            stream = opened.enter_context(_InSmallParts(io.FileIO(path)))
            archive = opened.enter_context(zipfile.ZipFile(stream))
        yield Zip(path, archive, _checked(path, archive))


def unpack_zip(path: Path, folder: Path) -> None:
    """The files of a .zip put into `folder`. Raises InputError as `opened_zip`, OSError ENOSPC."""
    with opened_zip(path) as packed:
        for name, entry in packed.entries.items():
            packed.unpack(entry, folder / name)


class _InSmallParts(io.BufferedReader):
    """A file of which nobody reads more than a little at once."""

    def read(self, size: int | None = -1, /) -> bytes:
        everything = size is None or size < 0 or size > MOST_AT_ONCE
        piece = super().read(MOST_AT_ONCE + 1 if everything else size)
        if len(piece) > MOST_AT_ONCE:
            raise zipfile.BadZipFile("its directory is too large")
        return piece


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    try:
        yield
    except BROKEN as cause:
        raise InputError(f"{path}: the .zip is not whole ({cause}); pack it again") from cause


def _checked(path: Path, archive: zipfile.ZipFile) -> dict[PurePosixPath, zipfile.ZipInfo]:
    """The files among the entries, by name. Raises InputError."""
    entries = archive.infolist()
    if len(entries) > MOST_ENTRIES:
        raise InputError(
            f"{path}: the .zip has {len(entries)} entries, wanted at most {MOST_ENTRIES}"
        )
    files: dict[PurePosixPath, zipfile.ZipInfo] = {}
    for entry in entries:
        # Some packers of Windows part folders as their system does.
        written = entry.filename.replace("\\", "/")
        name = PurePosixPath(written)
        _check_entry(path, entry, name)
        if written.endswith("/"):
            continue
        if name in files:
            raise InputError(f"{path}: the .zip holds {entry.filename!r:.60} twice; pack it again")
        files[name] = entry
    check_claim(
        path, "the .zip", sum(entry.file_size for entry in files.values()), path.stat().st_size
    )
    return files


def _check_entry(path: Path, entry: zipfile.ZipInfo, name: PurePosixPath) -> None:
    """Refuse an entry that is a trick, or packed as nobody packs."""
    shown = f"{entry.filename!r:.60}"
    if name.is_absolute() or ".." in name.parts or not name.parts or DRIVE.match(name.parts[0]):
        raise InputError(f"{path}: the .zip holds {shown}, which leads out of it; refused")
    if len(name.parts) > MOST_DEPTH:
        raise InputError(f"{path}: the .zip holds {shown}, folders too deep; pack it flat")
    if stat.S_IFMT(entry.external_attr >> 16) not in KINDS:
        raise InputError(f"{path}: the .zip holds a link, {shown}; pack the file itself")
    if entry.flag_bits & 0x1:
        raise InputError(f"{path}: the .zip has a password; pack it without")
    if entry.compress_type not in METHODS:
        raise InputError(
            f"{path}: the .zip holds {shown}, packed by an unusual method; pack it again as an "
            "ordinary zip"
        )
