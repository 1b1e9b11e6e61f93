"""Superimposed maps: one feature per spot for all orientations (paper, map superimposition)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from elfslam.base.arrays import F32, F64, I64, Value, array
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, FloorMap, Payload

SECTORS = 8
"""Of headings, averaged one by one before a spot's ELF: how often each was walked drops out."""


@dataclass(frozen=True, eq=False)
class SpotEchoes(Value):
    """Echo traces of a floor, and the pose at which each was heard, in the frame of the floor."""

    samples: F32 = array("n", ECHO_SAMPLES, dtype=np.float32)
    xy_m: F64 = array("n", 2)
    heading_rad: F64 = array("n")


def floor_spots(xy_m: F64, spacing_m: float) -> F64:
    """The spots (m, 2) of a floor: the middle of what was heard in each square that was entered."""
    squares = np.floor(xy_m / spacing_m).astype(np.int64)
    _, square = np.unique(squares, axis=0, return_inverse=True)
    square = square.reshape(-1)
    count = np.bincount(square)
    middle = [np.bincount(square, weights=column) / count for column in xy_m.T]
    return np.column_stack(middle)


def spot_means(spots_m: F64, heard: Iterable[tuple[F64, F64, F32]]) -> F32:
    """Features (m, 128) of spots (m, 2): the mean over headings of what is nearest to each.

    What was `heard` comes as positions (n, 2), headings (n) and features (n, 128). Each of eight
    sectors of heading is averaged by itself, then those that were heard; a spot that nobody heard
    has zeros. The mean is not normalised: a spot whose orientations still differ is the less sure.
    """
    tree, cells = KDTree(spots_m), len(spots_m) * SECTORS
    sums, counts = np.zeros((cells, ELF_SIZE)), np.zeros(cells)
    for xy_m, heading_rad, vectors in heard:
        cell = tree.query(xy_m)[1] * SECTORS + _sector(heading_rad)
        np.add.at(sums, cell, vectors)
        counts += np.bincount(cell, minlength=cells)
    means = (sums / np.maximum(counts, 1)[:, None]).reshape(len(spots_m), SECTORS, -1)
    sectors = np.maximum((counts.reshape(-1, SECTORS) > 0).sum(axis=1), 1)
    return np.asarray(means.sum(axis=1) / sectors[:, None], dtype=np.float32)


def superimposed(floor_map: FloorMap, elfs: Payload, spacing_m: float) -> FloorMap:
    """A map of many walks with its spots put together, and the mean of their `elfs` in each."""
    spots_m = floor_spots(floor_map.xy_m, spacing_m)
    vectors = spot_means(spots_m, [(floor_map.xy_m, floor_map.heading_rad, elfs.vectors)])
    return superimposed_map(
        spots_m, vectors, elfs.encoder, spacing_m=spacing_m, sources=floor_map.sources,
        covariance_m2=nearest_covariance(floor_map, spots_m),
    )  # fmt: skip


def superimposed_map(
    spots_m: F64,
    vectors: F32,
    encoder: str,
    *,
    spacing_m: float,
    sources: tuple[str, ...],
    covariance_m2: F64 | float = 0.0,
) -> FloorMap:
    """One spot for all orientations as a floor map; its headings say nothing and are zero.

    A spot is as sure as its square is wide, and less by `covariance_m2` (m, 2, 2), that of the
    walks. `encoder` is the identity of what made the `vectors`.
    """
    count = len(spots_m)
    square_m2 = np.tile(np.eye(2) * spacing_m**2 / 12, (count, 1, 1))
    return FloorMap(
        xy_m=spots_m,
        heading_rad=np.zeros(count),
        walk=np.zeros(count, dtype=np.int64),
        order=np.arange(count),
        covariance_m2=square_m2 + covariance_m2,
        payloads=(Payload("elf", encoder, vectors),),
        parameters_digest="",
        sources=sources,
    )


def nearest_covariance(floor_map: FloorMap, spots_m: F64) -> F64:
    """How sure (m, 2, 2) the walks of a map are of where spots (m, 2) lie: that of the nearest."""
    nearest = KDTree(floor_map.xy_m).query(spots_m)[1]
    return np.asarray(floor_map.covariance_m2[nearest])


def _sector(heading_rad: F64) -> I64:
    """Which of the sectors a heading lies in; the four quarters are in the middle of theirs."""
    return np.rint(heading_rad / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
