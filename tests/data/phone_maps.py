"""A map as a phone puts it together from its parts; the pages do the same in JavaScript."""

from collections.abc import Sequence

import numpy as np

from elfslam.base.arrays import F32, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ELF_SIZE, FloorMap, Payload
from elfslam.data.tiles import COLUMNS, NUMBERS, VECTORS, WHOLE, features_of, keys_of, spots_in


def map_of_parts(
    tiles: Sequence[bytes],
    stretches: Sequence[tuple[int, bytes]],
    *,
    encoder: str,
    sources: tuple[str, ...],
) -> FloorMap:
    """The map that a phone holds: its spots tile after tile; `stretches` with their walks.

    `encoder` is the identity of what made the features. Raises InputError for a part that is cut
    off, and where features are missing.
    """
    parts = [_tile(content) for content in tiles]
    walk, order = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    place, heading, flat, weight = np.split(
        np.concatenate([part[2] for part in parts]).astype(np.float64),
        np.cumsum(COLUMNS)[:-1],
        axis=1,
    )
    elfs = Payload("elf", encoder, _features(stretches, keys_of(walk, order)))
    return FloorMap(
        xy_m=place,
        heading_rad=heading[:, 0],
        walk=walk.astype(np.int64),
        order=order.astype(np.int64),
        covariance_m2=flat[:, [0, 1, 1, 2]].reshape(-1, 2, 2),
        payloads=(elfs,),
        parameters_digest="",
        sources=sources,
        weight=weight[:, 0],
    )


def _tile(content: bytes) -> tuple[I64, I64, F32]:
    count = spots_in(content, 2 * WHOLE.itemsize + sum(COLUMNS) * NUMBERS.itemsize)
    walk, order = np.frombuffer(content, WHOLE, 2 * count, WHOLE.itemsize).reshape(2, count)
    flat = np.frombuffer(content, NUMBERS, offset=(1 + 2 * count) * WHOLE.itemsize)
    ends = np.cumsum(np.multiply(COLUMNS, count))[:-1]
    blocks = zip(np.split(flat, ends), COLUMNS, strict=True)
    numbers = np.hstack([block.reshape(count, width) for block, width in blocks])
    return walk.astype(np.int64), order.astype(np.int64), numbers


def _features(stretches: Sequence[tuple[int, bytes]], wanted: I64) -> F32:
    keys, vectors = [np.empty(0, dtype=np.int64)], [np.empty((0, ELF_SIZE), dtype=np.float32)]
    for walk, content in stretches:
        count = spots_in(content, WHOLE.itemsize + ELF_SIZE * VECTORS.itemsize)
        order = np.frombuffer(content, WHOLE, count, WHOLE.itemsize).astype(np.int64)
        keys.append(keys_of(np.full(count, walk), order))
        vectors.append(features_of(content))
    known = np.concatenate(keys)
    sort = np.argsort(known)
    found = np.searchsorted(known[sort], wanted)
    if (found == len(known)).any() or (known[sort][found] != wanted).any():
        raise InputError("map: spots of its tiles have no features; fetch it again")
    return np.asarray(np.concatenate(vectors)[sort[found]])
