"""A map is kept alive: what newer walks pass fades, and what they find changed fades faster."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import FloorMap, Payload
from elfslam.merging.parameters import MergeParameters

PASS_SPOTS = 50
"""Spots this far apart along a walk (some seconds) belong to different passes of a place."""
BLOCK_PAIRS = 100_000
"""Pairs of spots that are compared at a time."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Rows of a map's spots that a newer walk passes, and how alike both are there (k)."""

    rows: I64
    resemblance: F64


def renewed(floor_map: FloorMap, newer: FloorMap, parameters: MergeParameters) -> FloorMap:
    """The map with the spots of a newer walk of the same frame; older ones fade and may leave."""
    known = parameters.merging
    seen = seen_again(floor_map, newer, parameters)
    changed = changed_rows(floor_map, newer, seen, parameters)
    weight = np.array(floor_map.weight)
    weight[seen.rows] *= np.where(changed, known.fade_changed, known.fade)
    marked = np.array(floor_map.changed)
    marked[seen.rows] |= changed
    kept = weight >= known.forget_below
    return stacked(chosen_spots(replace(floor_map, weight=weight, changed=marked), kept), newer)


def seen_again(floor_map: FloorMap, newer: FloorMap, parameters: MergeParameters) -> Seen:
    """Spots that the newer walk passes in the same direction, with their mean likeness to it."""
    alike = _likeness(floor_map, newer, parameters, own=False)
    rows = np.flatnonzero(np.isfinite(alike))
    return Seen(rows, alike[rows])


def changed_rows(
    floor_map: FloorMap, newer: FloorMap, seen: Seen, parameters: MergeParameters
) -> Bool:
    """Which seen spots (k) lie where the newer walk does not know the place again.

    Judged by the square metre, against how alike the map's own passes are there, and relative to
    the rest of the walk: another phone is less alike everywhere.
    """
    known = parameters.merging
    own = _likeness(floor_map, floor_map, parameters, own=True)[seen.rows]
    judged = np.isfinite(own)
    if not judged.any():
        return np.zeros(len(seen.rows), dtype=bool)
    cell, passes = _cells(floor_map.xy_m[seen.rows], newer)
    found, wanted = (
        np.bincount(cell[judged], values[judged], minlength=len(passes))
        for values in (seen.resemblance, own)
    )
    kept = found / np.where(wanted > 0, wanted, np.nan)
    unlike = kept < known.changed_below * np.nanmedian(kept)
    return np.asarray((unlike & (passes >= known.passes))[cell])


def _likeness(
    floor_map: FloorMap, newer: FloorMap, parameters: MergeParameters, *, own: bool
) -> F64:
    """How alike each spot (m) and those of the other map near it are, on average; NaN without any.

    Of its `own` map, those of the same pass do not count.
    """
    known = parameters.alignment
    old, new = _elf(floor_map), _elf(newer)
    total, count = np.zeros(len(old)), np.zeros(len(old), dtype=np.int64)
    pairs = cKDTree(floor_map.xy_m).sparse_distance_matrix(
        cKDTree(newer.xy_m), known.near_m, output_type="coo_matrix"
    )
    i, j = pairs.row, pairs.col
    turn_rad = np.abs(wrap_angle(newer.heading_rad[j] - floor_map.heading_rad[i]))
    near = turn_rad < known.turn_rad
    if own:
        other_walk = floor_map.walk[i] != floor_map.walk[j]
        near &= other_walk | (np.abs(floor_map.order[i] - floor_map.order[j]) >= PASS_SPOTS)
    i, j = i[near], j[near]
    for first in range(0, len(i), BLOCK_PAIRS):
        some = slice(first, first + BLOCK_PAIRS)
        np.add.at(total, i[some], np.einsum("kd,kd->k", old[i[some]], new[j[some]]))
    np.add.at(count, i, 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def stacked(first: FloorMap, second: FloorMap) -> FloorMap:
    """The spots of two maps of one frame as one map; walks of the second are numbered on."""
    names = [
        item.name for item in fields(FloorMap) if "array" in item.metadata and item.name != "walk"
    ]
    columns = {
        name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in names
    }
    second_kinds = {item.kind: item.vectors for item in second.payloads}
    payloads = tuple(
        Payload(item.kind, item.encoder, np.concatenate([item.vectors, second_kinds[item.kind]]))
        for item in first.payloads
        if item.kind in second_kinds
    )
    return FloorMap(
        **columns,
        walk=np.concatenate([first.walk, second.walk + len(first.sources)]),
        payloads=payloads,
        parameters_digest=first.parameters_digest,
        sources=(*first.sources, *second.sources),
    )


def chosen_spots(floor_map: FloorMap, rows: Bool) -> FloorMap:
    """The map with some of its spots."""
    columns = {
        item.name: getattr(floor_map, item.name)[rows]
        for item in fields(FloorMap)
        if "array" in item.metadata
    }
    payloads = tuple(
        Payload(item.kind, item.encoder, item.vectors[rows]) for item in floor_map.payloads
    )
    return replace(floor_map, **columns, payloads=payloads)


def _cells(xy_m: F64, newer: FloorMap) -> tuple[I64, I64]:
    """The square metre (k) that each position lies in, and how often the walk enters each."""
    corners = np.floor(np.vstack([xy_m, newer.xy_m])).astype(np.int64)
    every = np.asarray(np.unique(corners, axis=0, return_inverse=True)[1]).reshape(-1)
    cell, walked = every[: len(xy_m)], every[len(xy_m) :][np.argsort(newer.order, kind="stable")]
    entered = np.concatenate([[True], walked[1:] != walked[:-1]])
    return cell, np.bincount(walked[entered], minlength=int(cell.max()) + 1)[: int(cell.max()) + 1]


def _elf(floor_map: FloorMap) -> F64:
    vectors = next(item.vectors for item in floor_map.payloads if item.kind == "elf")
    return np.asarray(vectors, dtype=np.float64)
