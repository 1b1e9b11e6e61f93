"""Files by their SHA-256: each is kept once, whole, and never changed.

`put`, the commit of the rows that name what was put, and `delete` happen under `locked`, so that
nobody deletes a blob while somebody else begins to name it. A file is linked, not moved: whoever
is killed before the commit still has it.
"""

import contextlib
import errno
import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from elfslam.data.atomic_files import sha256_of, sync

SHA256 = re.compile(r"[0-9a-f]{64}")
LOCK = ".lock"


@dataclass(frozen=True)
class Blob:
    """A file that is kept."""

    sha256: str
    size_bytes: int


@contextmanager
def locked(blobs: Path) -> Iterator[None]:
    """Alone with the blobs, among all threads and processes."""
    with (blobs / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def blob_path(blobs: Path, sha256: str) -> Path:
    """Where a blob lies. Raises ValueError where that is no SHA-256."""
    if not SHA256.fullmatch(sha256):
        raise ValueError(f"{sha256!r:.80} is no SHA-256")
    return blobs / sha256[:2] / sha256


def found_blob(blobs: Path, sha256: str) -> Path:
    """Where a blob lies. Raises FileNotFoundError where it does not, or something else does."""
    return _plain(blob_path(blobs, sha256))


def blob_of(file: Path) -> Blob:
    """What a file would be as a blob."""
    return Blob(sha256_of(file), file.stat().st_size)


def put(blobs: Path, file: Path) -> Blob:
    """Keep a file, which must not change afterwards: it and the blob may be one. Raises OSError."""
    blob = blob_of(file)
    place(blobs, file, blob)
    return blob


def place(blobs: Path, file: Path, blob: Blob) -> None:
    """Keep a file of which it is known what blob it is. Raises OSError."""
    kept = blob_path(blobs, blob.sha256)
    if kept.is_file() and kept.stat().st_size == blob.size_bytes:
        return
    kept.parent.mkdir(exist_ok=True, mode=0o700)
    _link_whole(file, kept)
    sync(kept.parent)
    sync(blobs)


def put_folder(blobs: Path, folder: Path) -> dict[str, Blob]:
    """Keep every file of a folder, by its name within it, "/" between names. Raises OSError."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and not path.is_symlink())
    return {path.relative_to(folder).as_posix(): put(blobs, path) for path in files}


def link_into(folder: Path, blobs: Path, named: Mapping[str, str]) -> None:
    """Lay out blobs (their SHA-256 by name) as the files of a folder, to be read and not written.

    Raises OSError, and ValueError for a name that leads out of the folder.
    """
    for name, sha256 in named.items():
        link_or_copy(blob_path(blobs, sha256), place_in(folder, name))


def place_in(folder: Path, name: str) -> Path:
    """The file of a name, in folders that are made. Raises ValueError where it leads out."""
    target = folder / name
    if not target.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{name!r:.80} leads out of the folder")
    target.parent.mkdir(parents=True, exist_ok=True)
    return target


def delete(blobs: Path, sha256s: Iterable[str]) -> None:
    """Remove blobs; those that are gone already, or are no files, are no error."""
    for sha256 in sha256s:
        remove(blob_path(blobs, sha256))


def remove(file: Path) -> None:
    """Remove a file, if it is there and is one."""
    if file.is_file() or file.is_symlink():
        file.unlink(missing_ok=True)


def link_or_copy(source: Path, target: Path) -> None:
    """A second name of a file, or a copy where the file system has none.

    Raises OSError: FileNotFoundError also for what is no file.
    """
    _plain(source)
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:
        shutil.copyfile(source, target)


def _plain(file: Path) -> Path:
    if not file.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file))
    return file


def put_at(file: Path, kept: Path) -> None:
    """Move a file to where it is kept; a folder that lies there is left to be set aside."""
    if kept.is_dir():
        kept.rename(kept.with_name(f"{secrets.token_hex(8)}.partial"))
    os.replace(file, kept)


def _link_whole(file: Path, kept: Path) -> None:
    partial = kept.parent / f"{secrets.token_hex(8)}.partial"
    try:
        link_or_copy(file, partial)
        sync(partial)
        put_at(partial, kept)
    finally:
        with contextlib.suppress(FileNotFoundError):
            partial.unlink()


FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)


def refuse_full_disk(place: int | Path, size_bytes: int, free_bytes: int) -> None:
    """Raise OSError ENOSPC where writing would leave less than `free_bytes`."""
    disk = os.statvfs(place)
    if disk.f_bavail * disk.f_frsize - size_bytes < free_bytes:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
