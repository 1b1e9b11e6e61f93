"""Arrays of MATLAB files come back; what claims to be larger than it can be is refused."""

from __future__ import annotations

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from elfslam.base.bounds import FREE_BYTES
from elfslam.base.errors import InputError
from elfslam.data.magnetic import read_mat

MATRIX, PACKED, DOUBLE = 14, 15, 9


@pytest.mark.parametrize("compressed", [True, False])
def test_arrays_come_back(tmp_path: Path, compressed: bool) -> None:
    made = {"m": np.arange(6.0).reshape(2, 3), "t": np.arange(4, dtype=np.int32)[:, None]}
    scipy.io.savemat(tmp_path / "a.mat", made, do_compression=compressed)
    found = read_mat(tmp_path / "a.mat", ["m", "t", "absent"])
    assert set(found) == {"m", "t"}
    for name, array in made.items():
        np.testing.assert_array_equal(found[name], array)


def element(kind: int, content: bytes, size: int | None = None) -> bytes:
    return struct.pack("<II", kind, len(content) if size is None else size) + content


def matrix(shape: tuple[int, int], content: bytes, flags: int = 6) -> bytes:
    parts = [
        element(6, struct.pack("<II", flags, 0)),
        element(5, struct.pack("<ii", *shape)),
        element(1, b"m" + bytes(7), 1),
        content,
    ]
    return element(MATRIX, b"".join(parts))


def stored(folder: Path, *elements: bytes) -> Path:
    head = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
    (folder / "a.mat").write_bytes(head + b"".join(elements))
    return folder / "a.mat"


def refused(path: Path) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=r"cannot be read as a \.mat file") as refusal:
            read_mat(path, ["m"])
    return "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "content",
    [
        matrix((10**6, 10**6), element(DOUBLE, bytes(8))),
        matrix((2, 2), element(DOUBLE, bytes(8), 2**32 - 1)),
        matrix((10**4, 10**4), b"", flags=1),
        matrix((2, 2), b"", flags=2),
        matrix((10**9, 1), element(16, b""), flags=4),
        element(PACKED, b"not packed at all"),
        element(77, bytes(40)),
    ],
    ids=["shape", "size", "cells", "structures", "letters", "packing", "kind"],
)
def test_claims_are_refused(tmp_path: Path, content: bytes) -> None:
    assert refused(stored(tmp_path, content))


def test_a_bomb_is_refused(tmp_path: Path) -> None:
    large = matrix((1, FREE_BYTES // 2), element(DOUBLE, bytes(4 * FREE_BYTES)))
    path = stored(tmp_path, element(PACKED, zlib.compress(large, 1)))
    assert path.stat().st_size < FREE_BYTES / 50
    assert refused(path)


def test_other_versions_are_refused(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"m": np.zeros((2, 2))}, format="4")
    assert refused(tmp_path / "a.mat")
    (tmp_path / "a.mat").write_bytes(b"")
    assert refused(tmp_path / "a.mat")
