"""A floor map in tiles of 8 m, as phones fetch it: what changed in one corner is fetched alone.

A tile is little-endian: the number of spots n (uint32); float32 blocks of places (n, 2), headings
(n), covariances (n, 3: xx, xy, yy) and weights (n); float16 features (n, 128).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.values import ELF_SIZE, FloorMap, Payload
from elfslam.line.feature import BINS, MEAN_LOG_SPECTRUM, PHONE

TILE_M = 8.0
COUNT, NUMBERS, VECTORS = np.dtype("<u4"), np.dtype("<f4"), np.dtype("<f2")
COLUMNS = (2, 1, 3, 1)
"""How many numbers a spot has of each: place, heading, covariance, weight."""


@dataclass(frozen=True)
class Tile:
    """The spots of one square: those with x in [8 i, 8 i + 8) and y in [8 j, 8 j + 8)."""

    square: tuple[int, int]
    spots: int
    content: bytes


def tiles_of(floor_map: FloorMap) -> list[Tile]:
    """The map by squares, these in order; within each the spots keep theirs.

    Raises InputError where the map has no ELFs of the usual size.
    """
    vectors = _elfs(floor_map).vectors
    squares = np.floor(floor_map.xy_m / TILE_M).astype(np.int64)
    table = _table(floor_map)
    known, tile = np.unique(squares, axis=0, return_inverse=True)
    return [
        Tile((int(i), int(j)), int(rows.sum()), _packed(table[rows], vectors[rows]))
        for k, (i, j) in enumerate(known)
        for rows in [tile.reshape(-1) == k]
    ]


def map_of_tiles(
    contents: Sequence[bytes], *, encoder: str, phone: F32 | None, source: str
) -> FloorMap:
    """The map that a phone holds: all spots, tile after tile, as one walk.

    `encoder` is the identity of what made the features, `phone` (12) as whom others are to be
    heard. Raises InputError for a tile that is cut off.
    """
    tables, vectors = zip(*map(_unpacked, contents), strict=True)
    place, heading, flat, weight = _columns(np.concatenate(tables).astype(np.float64))
    count = len(place)
    payloads = [Payload("elf", encoder, np.concatenate(vectors))]
    if phone is not None:
        payloads.append(Payload(PHONE, MEAN_LOG_SPECTRUM, np.tile(phone, (count, 1))))
    return FloorMap(
        xy_m=place,
        heading_rad=heading[:, 0],
        walk=np.zeros(count, dtype=np.int64),
        order=np.arange(count),
        covariance_m2=flat[:, [0, 1, 1, 2]].reshape(-1, 2, 2),
        payloads=tuple(payloads),
        parameters_digest="",
        sources=(source,),
        weight=weight[:, 0],
    )


def encoder_identity(floor_map: FloorMap) -> str:
    """What made the features of a map. Raises InputError where it has no ELFs."""
    return _elfs(floor_map).encoder


def phone_of(floor_map: FloorMap) -> F32 | None:
    """As whom other phones are to be heard in a map (12); None where it does not matter."""
    for item in floor_map.payloads:
        if item.kind == PHONE and len(item.vectors) > 0 and item.vectors.shape[1] == BINS:
            return np.asarray(item.vectors[0], dtype=np.float32)
    return None


def _elfs(floor_map: FloorMap) -> Payload:
    for item in floor_map.payloads:
        if item.kind == "elf" and len(item.vectors) > 0 and item.vectors.shape[1] == ELF_SIZE:
            return item
    raise InputError(
        f"map: phones locate by ELFs of {ELF_SIZE} numbers, which it has not; "
        "map the place by its echoes, with a learnt encoder"
    )


def _table(floor_map: FloorMap) -> F32:
    """All numbers of each spot but its features (m, 7)."""
    flat = floor_map.covariance_m2.reshape(-1, 4)[:, [0, 1, 3]]
    columns = (floor_map.xy_m, floor_map.heading_rad, flat, floor_map.weight)
    return np.column_stack(columns).astype(np.float32)


def _columns(table: np.ndarray) -> list[np.ndarray]:
    return np.split(table, np.cumsum(COLUMNS)[:-1], axis=1)


def _packed(table: F32, vectors: F32) -> bytes:
    blocks = [block.astype(NUMBERS).tobytes() for block in _columns(table)]
    return b"".join([COUNT.type(len(table)).tobytes(), *blocks, vectors.astype(VECTORS).tobytes()])


def _unpacked(content: bytes) -> tuple[F32, F32]:
    """Numbers (n, 7) and features (n, 128) of a tile. Raises InputError."""
    count = int(np.frombuffer(content[: COUNT.itemsize].ljust(COUNT.itemsize), COUNT)[0])
    numbers = count * sum(COLUMNS)
    start, middle = COUNT.itemsize, COUNT.itemsize + numbers * NUMBERS.itemsize
    wanted = middle + count * ELF_SIZE * VECTORS.itemsize
    if len(content) != wanted:
        raise InputError(f"tile: wanted {wanted} bytes, got {len(content)}; fetch it again")
    flat = np.frombuffer(content[start:middle], NUMBERS)
    ends = np.cumsum(np.multiply(COLUMNS, count))[:-1]
    blocks = [
        part.reshape(count, width)
        for part, width in zip(np.split(flat, ends), COLUMNS, strict=True)
    ]
    vectors = np.frombuffer(content[middle:], VECTORS).reshape(count, ELF_SIZE)
    return np.hstack(blocks), vectors.astype(np.float32)
