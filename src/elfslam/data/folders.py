"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from elfslam.base.errors import StoreError


@contextmanager
def new_folder(folder: Path, *, replaces: str | None = None) -> Iterator[Path]:
    """A temporary sibling to fill, renamed to `folder` at the end, removed if anything fails.

    A folder with content is only replaced where it holds a file called `replaces`, so that
    a mistyped path never costs anything else. Raises StoreError.
    """
    refuse_occupied(folder, replaces)
    partial = _sibling(folder)
    try:
        partial.mkdir(parents=True)
        yield partial
        _swap(partial, folder)
    except OSError as cause:
        raise StoreError(f"{folder}: cannot be written ({cause}); choose another place") from cause
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def new_file(file: Path) -> Iterator[Path]:
    """A temporary sibling to fill, renamed to `file` at the end. Raises StoreError."""
    partial = _sibling(file)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        os.replace(partial, file)
    except OSError as cause:
        raise StoreError(f"{file}: cannot be written ({cause}); choose another place") from cause
    finally:
        partial.unlink(missing_ok=True)


def _sibling(path: Path) -> Path:
    return path.parent / f".{path.name}.{secrets.token_hex(4)}.partial"


def refuse_occupied(folder: Path, replaces: str | None) -> None:
    if folder.is_dir():
        occupied = any(folder.iterdir()) and not (replaces and (folder / replaces).is_file())
    else:
        occupied = folder.exists()
    if occupied and replaces:
        raise StoreError(f"{folder}: holds no {replaces}, so it is kept; choose another folder")
    if occupied:
        raise StoreError(
            f"{folder}: already exists; choose another folder or delete it "
            "(map alone replaces an older run, with --force)"
        )


def _swap(partial: Path, folder: Path) -> None:
    if not folder.exists():
        partial.rename(folder)
        return
    old = _sibling(folder)
    folder.rename(old)
    partial.rename(folder)
    shutil.rmtree(old)
