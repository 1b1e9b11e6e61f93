"""Arrays in .npz files, without pickles, and only of the size that the file has for them.

Format of the arrays: NEP 1, "A simple file format for NumPy arrays", as numpy writes it.
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import LARGEST
from elfslam.base.bounds import MEBIBYTE, check_claim
from elfslam.base.errors import InputError, StoreError
from elfslam.base.zips import opened_zip

SUFFIX = ".npy"
START_BYTES = {b"\x93NUMPY\x01\x00": 10, b"\x93NUMPY\x02\x00": 12}
"""Where the header begins, by what stands before it: a magic string and the version."""
HEADER = re.compile(
    rb"\{'descr': '([<>|][biufU]\d{1,9})', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,18}(?:, ?|(?=\)))){0,8})\), \} *\n"
)
"""Truth values, numbers and texts; no objects."""
MOST_TEXT_BYTES = 16 * MEBIBYTE
LAST_LETTER, HALVES = 0x10FFFF, (0xD800, 0xE000)
"""Of Unicode; the surrogates are no letters."""


def write_npz(file: Path, arrays: Mapping[str, npt.ArrayLike]) -> None:
    """The arrays, compressed; equal arrays give equal bytes."""
    made = {name: np.asarray(given) for name, given in arrays.items()}
    with file.open("wb") as stream:
        np.savez_compressed(stream, **made)  # type: ignore[arg-type]


def read_npz(file: Path, names: Sequence[str]) -> dict[str, npt.NDArray[Any]]:
    """All arrays of a file. Raises StoreError where it is damaged or lacks one of `names`."""
    try:
        with opened_zip(file) as packed:
            arrays = {
                str(name).removesuffix(SUFFIX): _array(str(name), packed.content(entry))
                for name, entry in packed.entries.items()
            }
    except InputError as cause:
        reason = str(cause).removeprefix(f"{file}: ")
        raise StoreError(f"{file}: is missing or damaged ({reason}); make it again") from cause
    missing = [name for name in names if name not in arrays]
    if missing:
        raise StoreError(f"{file}: lacks the array {missing[0]}; make it again")
    return arrays


def _array(name: str, content: bytearray) -> npt.NDArray[Any]:
    begins = START_BYTES.get(bytes(content[:8]), 0)
    told = HEADER.fullmatch(content, begins, begins + _header_bytes(content, begins))
    if told is None:
        raise InputError(f"{name:.60} is no array of numbers or texts")
    shape = tuple(int(size) for size in re.findall(rb"\d+", told[3]))
    dtype = _dtype(name, told[1].decode())
    # An empty array may still have an axis that no memory holds.
    claimed = math.prod(max(size, 1) for size in shape) * dtype.itemsize
    check_claim(f"{name:.60}", "its header", claimed, len(content))
    held = len(content) - told.end()
    if dtype.itemsize == 0 or math.prod(shape) * dtype.itemsize != held:
        raise InputError(f"{name:.60} says {shape} of {dtype} and has {held} bytes")
    flat = np.frombuffer(content, dtype, offset=told.end())
    # NaN passes: some tables have gaps.
    if dtype.kind in "iuf" and ((flat > LARGEST) | (flat < -LARGEST)).any():
        raise InputError(f"{name:.60} holds a number beyond {LARGEST:g}")
    made = flat.reshape(shape, order="F" if told[2] == b"True" else "C")
    return _checked_texts(name, made) if dtype.kind == "U" else made


def _header_bytes(content: bytearray, begins: int) -> int:
    """How long the header says it is; its length is all that lies between version and header."""
    return int.from_bytes(content[8:begins], "little")


def _dtype(name: str, told: str) -> np.dtype[Any]:
    try:
        return np.dtype(told)
    except TypeError as cause:
        raise InputError(f"{name:.60} is of type {told:.20}, which is none") from cause


def _checked_texts(name: str, texts: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Refuse texts that are none; numpy does not look, and Python cannot hold them."""
    if texts.nbytes > MOST_TEXT_BYTES:
        raise InputError(f"{name:.60} has texts of {texts.nbytes} bytes, wanted {MOST_TEXT_BYTES}")
    letters = np.frombuffer(texts.tobytes(), np.dtype("u4").newbyteorder(texts.dtype.byteorder))
    if ((letters > LAST_LETTER) | ((letters >= HALVES[0]) & (letters < HALVES[1]))).any():
        raise InputError(f"{name:.60} holds a text that is none")
    return texts
