"""Arrays in .npz files, without pickles."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.errors import StoreError


def write_npz(file: Path, arrays: Mapping[str, npt.ArrayLike]) -> None:
    """The arrays, compressed; equal arrays give equal bytes."""
    made = {name: np.asarray(given) for name, given in arrays.items()}
    with file.open("wb") as stream:
        np.savez_compressed(stream, **made)  # type: ignore[arg-type]


def read_npz(file: Path, names: Sequence[str]) -> dict[str, npt.NDArray[Any]]:
    """All arrays of a file. Raises StoreError where it is damaged or lacks one of `names`."""
    try:
        with file.open("rb") as stream:
            stored = np.load(stream, allow_pickle=False)
            # A file of a single array has no names: all of them will be missing.
            arrays = {name: stored[name] for name in getattr(stored, "files", ())}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as cause:
        reason = str(cause).splitlines()[0] if str(cause) else type(cause).__name__
        raise StoreError(f"{file}: is missing or damaged ({reason}); make it again") from cause
    missing = [name for name in names if name not in arrays]
    if missing:
        raise StoreError(f"{file}: lacks the array {missing[0]}; make it again")
    return arrays
