"""A floor map in parts, as phones fetch it: what did not change is not fetched again.

Numbers lie in tiles of 8 m, features (nine tenths of the bytes) in stretches of 256 spots along a
walk: those stay the same where a map grows, is bent, or its spots fade. All is little-endian.
A tile: the number of spots n, their walks (n) and their order along them (n) as uint32; float32
blocks of places (n, 2), headings (n), covariances (n, 3: xx, xy, yy) and weights (n).
A stretch: n and the order of its spots (n) as uint32; float16 features (n, 128).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ELF_SIZE, FloorMap, Payload

TILE_M, STRETCH_SPOTS = 8.0, 256
WHOLE, NUMBERS, VECTORS = np.dtype("<u4"), np.dtype("<f4"), np.dtype("<f2")
COLUMNS = (2, 1, 3, 1)
"""How many numbers a spot has of each: place, heading, covariance, weight."""


@dataclass(frozen=True)
class Tile:
    """Numbers of the spots of one square: x in [8 i, 8 i + 8) and y in [8 j, 8 j + 8)."""

    square: tuple[int, int]
    spots: int
    content: bytes


@dataclass(frozen=True)
class Stretch:
    """Features of spots that follow each other along a walk."""

    walk: int
    spots: int
    content: bytes


def tiles_of(floor_map: FloorMap) -> list[Tile]:
    """The numbers of a map by squares, these in order; within each the spots keep theirs."""
    squares = np.floor(floor_map.xy_m / TILE_M).astype(np.int64)
    flat = floor_map.covariance_m2.reshape(-1, 4)[:, [0, 1, 3]]
    blocks = (floor_map.xy_m, floor_map.heading_rad, flat, floor_map.weight)
    order = _orders(floor_map)
    return [
        Tile(
            (int(square[0]), int(square[1])),
            len(rows),
            _whole(len(rows), floor_map.walk[rows], order[rows])
            + b"".join(block[rows].astype(NUMBERS).tobytes() for block in blocks),
        )
        for square, rows in _grouped(squares)
    ]


def stretches_of(floor_map: FloorMap) -> list[Stretch]:
    """The features of a map by walks and along them.

    Raises InputError where the map has no ELFs of the usual size.
    """
    vectors, order = _elfs(floor_map).vectors, _orders(floor_map)
    keys = np.column_stack([floor_map.walk, order // STRETCH_SPOTS])
    return [
        Stretch(
            int(key[0]),
            len(rows),
            _whole(len(rows), order[rows]) + vectors[rows].astype(VECTORS).tobytes(),
        )
        for key, rows in _grouped(keys)
    ]


def features_of(stretch: bytes) -> F32:
    """The features (n, 128) of a stretch. Raises InputError for one that is cut off."""
    count = spots_in(stretch, WHOLE.itemsize + ELF_SIZE * VECTORS.itemsize)
    halves = np.frombuffer(stretch, VECTORS, offset=(1 + count) * WHOLE.itemsize)
    return np.asarray(halves.reshape(count, ELF_SIZE).astype(np.float32))


def encoder_identity(floor_map: FloorMap) -> str:
    """What made the features of a map. Raises InputError where it has no ELFs."""
    return _elfs(floor_map).encoder


def _elfs(floor_map: FloorMap) -> Payload:
    for item in floor_map.payloads:
        if item.kind == "elf" and len(item.vectors) > 0 and item.vectors.shape[1] == ELF_SIZE:
            return item
    raise InputError(
        f"map: phones locate by ELFs of {ELF_SIZE} numbers, which it has not; "
        "map the place by its echoes, with a learnt encoder"
    )


def _orders(floor_map: FloorMap) -> I64:
    """The order of spots along their walks, or, where that does not tell them apart, their row."""
    unique = len(np.unique(keys_of(floor_map.walk, floor_map.order))) == len(floor_map.walk)
    return floor_map.order if unique else np.arange(len(floor_map.walk))


def keys_of(walk: I64, order: I64) -> I64:
    """One number for each walk and order along it."""
    return np.asarray((walk.astype(np.int64) << 32) + order, dtype=np.int64)


def _grouped(keys: I64) -> Iterator[tuple[I64, I64]]:
    """Each different row of keys (n, 2), in order, and where it stands."""
    known, group = np.unique(keys, axis=0, return_inverse=True)
    for k, key in enumerate(known):
        yield key, np.flatnonzero(group.reshape(-1) == k)


def _whole(count: int, *columns: I64) -> bytes:
    return np.concatenate([[count], *columns]).astype(WHOLE).tobytes()


def spots_in(content: bytes, spot_bytes: int) -> int:
    """How many spots a part has, if it is as long as they are. Raises InputError."""
    start = content[: WHOLE.itemsize]
    count = int(np.frombuffer(start.ljust(WHOLE.itemsize, b"\xff"), WHOLE)[0])
    if len(content) != WHOLE.itemsize + count * spot_bytes:
        raise InputError(
            f"map: a part of {count} spots has {len(content)} bytes, wanted "
            f"{WHOLE.itemsize + count * spot_bytes}; fetch it again"
        )
    return count
