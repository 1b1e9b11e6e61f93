"""A map is kept alive: what newer walks pass fades, and what they find changed fades faster."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import FloorMap, Payload
from elfslam.merging.parameters import MergeParameters

NEIGHBOURS = 64
"""Most spots that one is compared with."""


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
    marked[seen.rows] = changed
    kept = weight >= known.forget_below
    return stacked(chosen_spots(replace(floor_map, weight=weight, changed=marked), kept), newer)


def seen_again(floor_map: FloorMap, newer: FloorMap, parameters: MergeParameters) -> Seen:
    """Spots that the newer walk passes in the same direction, with their best resemblance to it."""
    known = parameters.alignment
    count = min(NEIGHBOURS, len(newer.xy_m))
    tree = cKDTree(newer.xy_m)
    _, near = tree.query(
        floor_map.xy_m, k=[*range(1, count + 1)], distance_upper_bound=known.near_m
    )
    inside = near < len(newer.xy_m)
    near = np.where(inside, near, 0)
    turn_rad = np.abs(wrap_angle(newer.heading_rad[near] - floor_map.heading_rad[:, None]))
    inside &= turn_rad < known.turn_rad
    rows = np.flatnonzero(inside.any(axis=1))
    old, new = _elf(floor_map)[rows], _elf(newer)[near[rows]]
    alike = np.where(inside[rows], np.einsum("kd,knd->kn", old, new), -np.inf)
    return Seen(rows, alike.max(axis=1, initial=-np.inf).astype(np.float64))


def changed_rows(
    floor_map: FloorMap, newer: FloorMap, seen: Seen, parameters: MergeParameters
) -> Bool:
    """Which seen spots (k) lie where the newer walk does not know the place again.

    Judged by the square metre, relative to how the walk resembles the rest of the map: a place
    must have been passed several times and be much less alike than others are.
    """
    known = parameters.merging
    if len(seen.rows) == 0:
        return np.zeros(0, dtype=bool)
    cell, passes = _cells(floor_map.xy_m[seen.rows], newer)
    count = np.bincount(cell)
    mean = np.bincount(cell, seen.resemblance) / np.maximum(count, 1)
    usual = float(np.median(mean[count > 0]))
    unlike = (mean < known.changed_below * usual) & (passes >= known.passes)
    return np.asarray(unlike[cell])


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
