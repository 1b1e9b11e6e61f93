"""MATLAB files of version 5 to 7, as far as plain arrays go, and only where they are small enough.

What is packed in one is unpacked first, for its length alone: no header in it is believed before.
Format: MathWorks, "MAT-File Format".
"""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.io

from elfslam.base.bounds import MEBIBYTE, most_bytes
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes

MAT_START = b"MATLAB 5.0 MAT-file"
"""So begin those of version 5 to 7."""
START_BYTES, TAG = 128, {b"IM": "<II", b"MI": ">II"}
"""Of the header, which ends in two letters that say how numbers are written."""
PACKED = 15
WHOLE_KINDS = (f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
KINDS = ("double", "single", *WHOLE_KINDS)
NUMBER_BYTES = 8


def read_mat(file: Path, names: Collection[str]) -> dict[str, npt.NDArray[Any]]:
    """The arrays of these names, as far as they are there. Raises InputError."""
    content = read_bytes(file)
    with _refusing(file):
        _check_claims(content, names)
        found = scipy.io.loadmat(BytesIO(content), variable_names=list(names))
    return {name: np.atleast_2d(found[name]) for name in names if name in found}


def names_in_mat(content: bytes, source: Path) -> set[str]:
    """The names of the arrays in the bytes of a file. Raises InputError, naming `source`."""
    with _refusing(source):
        _check_claims(content, ())
        return {name for name, _, _ in scipy.io.whosmat(BytesIO(content))}


@contextmanager
def _refusing(file: Path) -> Iterator[None]:
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    except Exception as cause:  # scipy raises whatever the damaged bytes led to
        raise InputError(
            f"{file}: cannot be read as a .mat file ({cause!s:.120}); copy it again"
        ) from cause


def _check_claims(content: bytes, names: Collection[str]) -> None:
    """Raise ValueError where the file is, or says it is, larger than can be believed."""
    most = most_bytes(len(content))
    if sum(_unpacked_bytes(content)) > most:
        raise ValueError("it unpacks to more than can be believed")
    for name, shape, kind in scipy.io.whosmat(BytesIO(content)):
        if name in names and (kind not in KINDS or math.prod(shape) * NUMBER_BYTES > most):
            raise ValueError(f"{name} is {kind} of {shape!s:.40}, wanted numbers, and fewer")


def _unpacked_bytes(content: bytes) -> Iterator[int]:
    """How many bytes each packed element holds, in pieces."""
    order = TAG[content[START_BYTES - 2 : START_BYTES]]
    at = START_BYTES
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(order, content, at)
        at += 8
        if kind == PACKED:
            unpacking, left = zlib.decompressobj(), content[at : at + size]
            while left and not unpacking.eof:
                yield len(unpacking.decompress(left, MEBIBYTE))
                left = unpacking.unconsumed_tail
        at += size
