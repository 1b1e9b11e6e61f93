"""Exponential forgetting and change detection: older spots fade, changed ones faster."""

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import FloorMap, Payload
from elfslam.slam.merging.members import MergeParameters

PASS_SPOTS = 50
"""Spots this far apart along a walk (some seconds) belong to different passes of a place."""
THINNED = 3
"""A spot is compared with every third of another walk: they come a tenth of a second apart."""
BLOCK_PAIRS = 100_000
"""Pairs of spots that are compared at a time."""


@dataclass(frozen=True, eq=False)
class SpotSimilarity:
    """How similar each spot of a map (m) and those of another near it are, on average.

    NaN without any; `passes` counts how often the other walks by.
    """

    mean: F64
    passes: I64


def renewed(floor_map: FloorMap, newer: FloorMap, parameters: MergeParameters) -> FloorMap:
    """The map with the spots of a newer walk of the same frame; older ones fade and may leave."""
    known = parameters.merging
    seen = spot_similarity(floor_map, newer, parameters)
    changed = changed_spots(floor_map, seen, parameters)
    fade = np.where(changed, known.fade_changed, known.fade)
    weight = np.where(seen.passes > 0, floor_map.weight * fade, floor_map.weight)
    kept = weight >= known.forget_below
    aged = replace(floor_map, weight=weight, changed=floor_map.changed | changed)
    return stacked(chosen_spots(aged, kept), newer)


def changed_spots(floor_map: FloorMap, seen: SpotSimilarity, parameters: MergeParameters) -> Bool:
    """Which spots (m) lie where a newer walk, seen from them, does not know the place again.

    Judged by the square metre, against how similar the map's own passes are there, and relative to
    the rest of the walk: another phone is less similar everywhere. One pass is not enough.
    """
    known = parameters.merging
    own = spot_similarity(floor_map, floor_map, parameters, own=True)
    judged = np.isfinite(seen.mean) & np.isfinite(own.mean)
    if not judged.any():
        return judged
    corners = np.floor(floor_map.xy_m).astype(np.int64)
    cell = np.asarray(np.unique(corners, axis=0, return_inverse=True)[1]).reshape(-1)
    found, wanted = (
        np.bincount(cell[judged], each.mean[judged], minlength=int(cell.max()) + 1)
        for each in (seen, own)
    )
    kept = found / np.where(wanted > 0, wanted, np.nan)
    unlike = kept < known.changed_below * np.nanmedian(kept)
    return np.asarray(unlike[cell] & (seen.passes >= known.passes))


def spot_similarity(
    floor_map: FloorMap, newer: FloorMap, parameters: MergeParameters, *, own: bool = False
) -> SpotSimilarity:
    """How similar a map and another are where it passes near in the same direction.

    Of its `own` map, spots of the same pass do not count.
    """
    known = parameters.alignment
    some = np.flatnonzero(newer.order % THINNED == 0)
    pairs = cKDTree(floor_map.xy_m).sparse_distance_matrix(
        cKDTree(newer.xy_m[some]), known.near_m, output_type="coo_matrix"
    )
    i, j = pairs.row, some[pairs.col]
    turn_rad = np.abs(wrap_angle(newer.heading_rad[j] - floor_map.heading_rad[i]))
    near = turn_rad < known.turn_rad
    if own:
        other_walk = floor_map.walk[i] != floor_map.walk[j]
        near &= other_walk | (np.abs(floor_map.order[i] - floor_map.order[j]) >= PASS_SPOTS)
    i, j = i[near], j[near]
    count = np.bincount(i, minlength=len(floor_map.xy_m))
    total = np.bincount(i, _products(floor_map, newer, i, j), minlength=len(count))
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return SpotSimilarity(mean, _passes(i, newer.walk[j], newer.order[j], len(count)))


def _products(floor_map: FloorMap, newer: FloorMap, i: I64, j: I64) -> F64:
    """The cosines (k) of spots i and spots j of the other."""
    old, new = _elf(floor_map), _elf(newer)
    made = np.empty(len(i))
    for first in range(0, len(i), BLOCK_PAIRS):
        some = slice(first, first + BLOCK_PAIRS)
        made[some] = np.einsum("kd,kd->k", old[i[some]], new[j[some]])
    return made


def _passes(i: I64, walk: I64, order: I64, count: int) -> I64:
    """How many separate passes the neighbours (k) of each spot belong to."""
    sort = np.lexsort((order, walk, i))
    i, walk, order = i[sort], walk[sort], order[sort]
    new = (np.diff(i) != 0) | (np.diff(walk) != 0) | (np.diff(order) >= PASS_SPOTS)
    begins = np.concatenate([np.ones(min(len(i), 1), dtype=bool), new])
    return np.bincount(i[begins], minlength=count).astype(np.int64)


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


def _elf(floor_map: FloorMap) -> F64:
    vectors = next(item.vectors for item in floor_map.payloads if item.kind == "elf")
    return np.asarray(vectors, dtype=np.float64)
