"""Files and folders that appear whole or not at all, last, and have one writer at a time.

Beside a result NAME lie, while it is written, `.NAME.lock` and `.NAME.partial`, and while it takes
the place of an older one `.NAME.replaced`. What a kill leaves of them the next writer finishes,
puts back or removes.
"""

import errno
import fcntl
import hashlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from elfslam.base.errors import StoreError

LOCK, PARTIAL, REPLACED = "lock", "partial", "replaced"
UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
"""Errors of writing alone; who copies a file may name the source."""
MARKERS = {
    "recording.json": "a recording",
    "run.json": "a run",
    "merge.json": "a merged map",
    "building.json": "a building",
    "anchor.json": "a map on a plan",
    "followed.tum": "a map on a plan",
}
"""What lies in a folder whose files are not to be replaced one by one."""
SERVER = "store.json"
"""What lies in a server's data folder, all of which is the server's."""


@contextmanager
def new_folder(folder: Path, *, replaces: str | None = None) -> Iterator[Path]:
    """A hidden sibling to fill, renamed to `folder` at the end, removed if anything fails.

    A folder with content is only replaced where it holds a file called `replaces`, so that
    a mistyped path never costs anything else. Raises StoreError, also where somebody else is
    writing there or came first.
    """
    with _alone(folder, place_of(folder)) as place:
        refuse_occupied(folder, replaces)
        partial = _beside(place, PARTIAL)
        partial.mkdir()
        yield partial
        _sync_all(partial)
        sync(place.parent)
        if not _is_free(place):
            _put_aside(place, replaces)
        partial.rename(place)
        sync(place.parent)


@contextmanager
def new_file(
    file: Path, *, overwrite: bool = False, reads: Iterable[Path | str] = ()
) -> Iterator[Path]:
    """A hidden sibling to fill, renamed to `file` at the end, removed if anything fails.

    Put around the whole work it refuses before it: an older file is only replaced with
    `overwrite`, and never one that the work `reads` or that belongs to a recording, a run, a map
    or a server. Raises StoreError, also where somebody else is writing there or came first.
    """
    inputs = tuple(reads)

    def refuse() -> None:
        _refuse_file(file, inputs, overwrite=overwrite)

    with _alone(file, place_of(file)) as place:
        refuse()
        partial = _beside(place, PARTIAL)
        yield partial
        sync(partial)
        _put(partial, place, refuse)
        sync(place.parent)


@contextmanager
def replaced_file(file: Path) -> Iterator[Path]:
    """As `new_file`, for what a program keeps in a folder of its own: an older one is replaced.

    A link in its place gives way itself, so that nothing is written outside the folder.
    """
    with _alone(file, Path(os.path.realpath(file.parent), file.name)) as place:
        if place.exists() and not place.is_file():
            raise StoreError(f"{file}: is no file that could be replaced; choose another place")
        partial = _beside(place, PARTIAL)
        yield partial
        sync(partial)
        partial.replace(place)
        sync(place.parent)


def place_of(path: Path) -> Path:
    """Where a result called `path` really comes to lie.

    Raises StoreError where that is the current folder or one above it, which an empty name means
    as well.
    """
    place, here = Path(os.path.realpath(path)), Path.cwd()
    if path.name == ".." or place == here or place in here.parents:
        raise StoreError(
            f"{str(path)!r}: is the current folder or one above it; name a new place inside"
        )
    return place


def refuse_read(path: Path, reads: Iterable[Path | str]) -> None:
    """Raise StoreError where a result at `path` would take the place of anything that is read.

    That is the same file, by whatever name; a file in a folder that is read; and a recording, run
    or map that holds what is read.
    """
    place = Path(os.path.realpath(path))
    for read in reads if os.path.exists(place) else ():
        source = Path(os.path.realpath(read))
        if os.path.exists(source) and (
            place.samefile(source)
            or (place.is_file() and source in place.parents)
            or (place in source.parents and _marker_in(place))
        ):
            raise StoreError(f"{path}: {read} is read from there; choose another place")


def refuse_occupied(folder: Path, replaces: str | None) -> None:
    """Raise StoreError where `new_folder` would, but for somebody who comes later.

    It is an StoreError where an older result might be replaced.
    """
    place_of(folder)
    if _is_free(settled(folder)):
        return
    if replaces is None:
        raise StoreError(
            f"{folder}: already exists; choose another folder or delete it", argument="overwrite"
        )
    if not (folder / replaces).is_file():
        raise StoreError(f"{folder}: holds no {replaces}, so it is kept; choose another folder")


def settled(folder: Path) -> Path:
    """The folder, once a replacement of it that was killed half-way has been finished."""
    place = Path(os.path.realpath(folder))
    if _beside(place, REPLACED).exists():
        with suppress(OSError), _locked(place):
            _settle(place)
    return folder


def _refuse_file(file: Path, reads: Iterable[Path | str], *, overwrite: bool) -> None:
    place = Path(os.path.realpath(file))
    if not place.exists():
        return
    if not place.is_file():
        raise StoreError(f"{file}: is no file that could be replaced; choose another place")
    refuse_read(file, reads)
    server = next((str(each) for each in place.parents if (each / SERVER).exists()), None)
    owner = f"the server's data in {server}" if server else MARKERS.get(_marker_in(place.parent))
    if owner:
        raise StoreError(f"{file}: belongs to {owner}; choose another place")
    if not overwrite:
        raise StoreError(
            f"{file}: already exists; choose another name or delete it", argument="overwrite"
        )


def _marker_in(folder: Path) -> str:
    return next((name for name in MARKERS if (folder / name).exists()), "")


def _put(partial: Path, place: Path, refuse: Callable[[], None]) -> None:
    """Give a file its name, unless somebody has taken that meanwhile and would be refused."""
    try:
        os.link(partial, place)
    except OSError:  # the name is taken, or the file system has no links
        refuse()
        partial.replace(place)
    else:
        partial.unlink()


@contextmanager
def _alone(path: Path, place: Path) -> Iterator[Path]:
    """The place of `path`, for one writer at a time; nothing but `path` is there after it."""
    missing = [folder for folder in place.parents if not os.path.exists(folder)]
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with _locked(place):
            _settle(place)
            try:
                yield place
            finally:
                _settle(place)
        for folder in missing:
            sync(folder.parent)
    except BlockingIOError as cause:
        raise StoreError(
            f"{path}: somebody else is writing there; wait for them or choose another place"
        ) from cause
    except OSError as cause:
        if not _is_of(cause, place):
            raise
        reason = cause.strerror or cause
        raise StoreError(f"{path}: cannot be written ({reason}); choose another place") from cause
    finally:
        for folder in [] if os.path.exists(place) else missing:
            with suppress(OSError):
                folder.rmdir()


def _is_of(error: OSError, place: Path) -> bool:
    """Whether an error came of writing there, and not of another file that the work touched."""
    if error.filename is None or error.errno in UNWRITABLE:
        return True
    named = Path(os.fsdecode(error.filename))
    return named in place.parents or str(named).startswith(str(_beside(place, "")))


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Raises BlockingIOError where somebody else is in here; a process that dies leaves it."""
    lock = _beside(path, LOCK)
    descriptor = _lock(lock)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(descriptor)


def _lock(lock: Path) -> int:
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise
        if _is_open_at(lock, descriptor):
            return descriptor
        os.close(descriptor)


def _is_open_at(path: Path, descriptor: int) -> bool:
    """Whether a file was not removed, or made anew, while it was opened."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _put_aside(folder: Path, replaces: str | None) -> None:
    """Make room for what is whole by now; what is not to be replaced comes back."""
    refuse_occupied(folder, replaces)
    folder.rename(_beside(folder, REPLACED))


def _settle(path: Path) -> None:
    """Finish a replacement that was cut short, and remove what was not to last.

    An older result is only put aside once the new one is whole.
    """
    partial, replaced = _beside(path, PARTIAL), _beside(path, REPLACED)
    if replaced.exists():
        for whole in (partial, replaced):
            if _is_free(path) and whole.exists():
                with suppress(OSError):
                    whole.rename(path)
        sync(path.parent)
    if replaced.exists() and not _is_free(path):
        _remove(partial)
        replaced.rename(partial)  # a kill may not leave half of it under a name that comes back
    _remove(partial)


def _is_free(folder: Path) -> bool:
    return not folder.exists() or (folder.is_dir() and not any(folder.iterdir()))


def _beside(path: Path, what: str) -> Path:
    return path.parent / f".{path.name}.{what}"


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _sync_all(folder: Path) -> None:
    for place, _, names in os.walk(folder):
        for path in [*(Path(place, name) for name in names), Path(place)]:
            sync(path)


def sync(path: Path) -> None:
    """Have a file, or a folder's names, written to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sha256_of(file: Path) -> str:
    """The SHA-256 of a file's content, in hexadecimal."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
