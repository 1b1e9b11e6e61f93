"""Logs on disk as their readers want them: the folder of one, or file after file of many."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from elfslam.base.errors import InputError
from elfslam.base.text_files import readable
from elfslam.base.values import Recording, Truth
from elfslam.base.zips import opened_zip, unpack_zip

ZIP_START, XZ_START = b"PK", b"\xfd7zXZ\x00"
MACOSX = "__MACOSX"


@dataclass(frozen=True, eq=False)
class Imported:
    """One recording, its truth where the log has it, and how many lines were damaged."""

    recording: Recording
    truth: Truth | None = None
    damaged_lines: int = 0


def starts_with(path: Path, start: bytes) -> bool:
    """Whether a file begins with these bytes; false of what is no file."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(len(start)) == start


def is_zip(path: Path) -> bool:
    """Whether a file is a .zip, whatever it is called."""
    return starts_with(path, ZIP_START)


def is_clutter(name: PurePosixPath) -> bool:
    """Whether that is a file which systems put beside others: hidden, or of the Mac's zips."""
    return MACOSX in name.parts or name.name.startswith(".")


def name_of(path: Path) -> str:
    """What the recording of a log is called: as its folder or its file, without the ending."""
    return readable(path.name if path.is_dir() else path.stem)


def one_of_each(folder: Path, endings: Collection[str]) -> dict[str, Path]:
    """The files of these endings in the folder of one log, by their names in small letters.

    Programs write a file per sensor, whatever folders are packed around them: two of one name
    are of two recordings. Raises InputError then.
    """
    found: dict[str, Path] = {}
    for file in sorted(folder.rglob("*")):
        name, inside = file.name.lower(), PurePosixPath(file.relative_to(folder))
        if file.suffix.lower() not in endings or is_clutter(inside) or not file.is_file():
            continue
        if name in found:
            twice = [f"{each!s:.60}" for each in (found[name].relative_to(folder), inside)]
            raise InputError(
                f"{folder}: holds several recordings ({', '.join(twice)}), wanted one; give each "
                "alone"
            )
        found[name] = file
    return found


@contextmanager
def log_folder(path: Path) -> Iterator[Path]:
    """The folder of a log: `path` itself, or its .zip unpacked for a moment.

    An InputError from inside names `path`, and no folder that is gone by then.
    """
    if path.is_dir():
        yield path
        return
    with tempfile.TemporaryDirectory() as name:
        unpack_zip(path, Path(name))
        try:
            yield Path(name)
        except InputError as cause:
            raise InputError(str(cause).replace(name, str(path))) from None


def files_in(path: Path, ending: str) -> Iterator[Path]:
    """The files of that ending in a folder or a .zip, by name, or else the file `path` itself.

    One from a .zip is unpacked for a moment: its path is good until the next is asked for.
    Raises InputError where there is none.
    """
    if path.is_dir():
        inside = sorted(file for file in path.rglob("*") if _is_wanted(file, ending))
        if not inside:
            raise InputError(f"{path}: holds no {ending} file; give the folder of the logs")
        yield from inside
    elif is_zip(path):
        yield from _unpacked(path, ending)
    else:
        yield path


def _is_wanted(name: Path | PurePosixPath, ending: str) -> bool:
    return name.suffix.lower() == ending and not is_clutter(PurePosixPath(name))


def _unpacked(path: Path, ending: str) -> Iterator[Path]:
    with opened_zip(path) as packed, tempfile.TemporaryDirectory() as folder:
        wanted = sorted(name for name in packed.entries if _is_wanted(name, ending))
        if not wanted:
            raise InputError(f"{path}: holds no {ending} file; pack the logs themselves")
        for name in wanted:
            file = Path(folder) / name.name
            packed.unpack(packed.entries[name], file)
            yield file
            file.unlink()
