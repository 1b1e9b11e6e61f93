"""Spots as unit rows in half precision: checked, written to files and read by mapping them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import F32, I64
from elfslam.base.errors import InputError, StoreError

Rows = npt.NDArray[Any]
BLOCK_ROWS = 65_536
LENGTH_TOLERANCE = 5e-3
"""Half precision moves the length of a row by less."""


def check_rows(rows: Rows, size: int | None, name: str) -> Rows:
    """The same rows (n, size). Raises InputError for another shape, NaN and rows not of length 1.

    `size` None takes any width.
    """
    wanted = "n" if size is None else str(size)
    if rows.ndim != 2 or rows.dtype.kind != "f" or (size is not None and rows.shape[1] != size):
        raise InputError(
            f"{name}: wanted numbers (n, {wanted}), got {rows.dtype} {rows.shape}; "
            "use the encoder that the index was made with"
        )
    for first in range(0, len(rows), BLOCK_ROWS):
        length = np.linalg.norm(rows[first : first + BLOCK_ROWS].astype(np.float32), axis=1)
        bad = ~(np.abs(length - 1.0) <= LENGTH_TOLERANCE)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{name}: wanted rows of length 1, got {length[row]:.3g} in row {first + row}; "
                "normalise the rows and drop those without echoes"
            )
    return rows


def read_rows(file: Path) -> Rows:
    """The rows of a .npy file, mapped. Raises StoreError where it is missing or cut off."""
    try:
        return np.asarray(np.load(file, mmap_mode="r", allow_pickle=False))
    except (OSError, ValueError, EOFError) as cause:
        reason = str(cause).splitlines()[0]
        raise StoreError(f"{file}: cannot be read ({reason}); copy or build it again") from cause


def write_rows(file: Path, rows: Rows) -> None:
    """The rows in half precision, flushed to the disk."""
    with file.open("wb") as stream:
        np.save(stream, rows.astype(np.float16, copy=False))
        stream.flush()
        os.fsync(stream.fileno())


def place_rows(given: Rows | Path, file: Path) -> None:
    """A shard put into a folder: rows are written, a file is linked or copied."""
    if not isinstance(given, Path):
        write_rows(file, given)
    elif read_rows(given).dtype != np.float16:
        write_rows(file, read_rows(given))
    else:
        try:
            os.link(given.resolve(), file)
        except OSError:
            shutil.copyfile(given, file)


def loaded(given: Rows | Path) -> Rows:
    """A shard as rows: given as they are, or in a file."""
    return read_rows(given) if isinstance(given, Path) else np.asarray(given)


def blocks(shards: Sequence[Rows], size: int = BLOCK_ROWS) -> Iterator[tuple[int, F32]]:
    """The number of the first row, and the rows, of block after block of all shards."""
    offset = 0
    for shard in shards:
        for first in range(0, len(shard), size):
            yield offset + first, np.asarray(shard[first : first + size], dtype=np.float32)
        offset += len(shard)


def take(shards: Sequence[Rows], ids: I64) -> F32:
    """The rows (n, size) with these numbers."""
    ends = np.cumsum([len(shard) for shard in shards])
    which = np.searchsorted(ends, ids, side="right")
    found = np.empty((len(ids), shards[0].shape[1]), dtype=np.float32)
    for k in np.unique(which):
        here = which == k
        found[here] = shards[k][ids[here] - (ends[k] - len(shards[k]))]
    return found
