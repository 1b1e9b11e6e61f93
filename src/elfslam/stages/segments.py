"""Trajectory localization by curve matching: the last footsteps pick stretches of a map.

Dead reckoning knows the shape of a short walk, not where it lies. Every stretch of a mapped walk
that has this shape, walked either way and with steps somewhat longer or shorter, is a candidate;
of these the one that sounds most like what was heard is where the phone is (paper, section 5.5:
curve matching proposes, the largest mean similarity wins).
"""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import C128, F32, F64, I64, Bool, Value, array
from elfslam.base.fixes import NOWHERE, Fix, scored_fix
from elfslam.base.geometry import wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.values import Fixes, FixStatus, FloorMap, Odometry

JUMP_M = 1.5
"""Consecutive spots of a mapped walk never lie further apart."""
SPACING_M = 0.1
"""Between the places where stretches of the map may begin and end."""


@dataclass(frozen=True)
class SegmentParameters:
    """How short walks are compared with stretches of a map, and when no fix is given."""

    footsteps: int = parameter(8, "footsteps", "length of the short walk", 2, 100)
    most_off_m: float = parameter(
        0.5, "m", "stretches further off the reckoned shape (rms) are none", 0.01, 100.0
    )
    scales: int = parameter(5, "", "lengths of step that are tried", 1, 50)
    scale_reach: float = parameter(
        0.15, "", "steps may be this much longer or shorter than reckoned", 0.0, 0.9
    )
    unknown_below: float = parameter(
        0.47, "", "mean similarity of the best stretch below this is UNKNOWN_PLACE", -1.0, 1.0
    )
    temperature: float = parameter(
        0.025, "", "softmax temperature of the mean similarity", 1e-4, 10.0
    )
    near_m: float = parameter(
        1.0, "m", "stretches that end this close to the best one are one place", 0.05, 100
    )
    ambiguous_below: float = parameter(
        0.9, "", "less belief near the best stretch is AMBIGUOUS", 0.0, 1.0
    )
    fewest_heard: float = parameter(
        0.5, "", "share of the footsteps that must have echoes, else NO_ECHO", 0.0, 1.0
    )
    sigma_floor_m: float = parameter(0.10, "m", "least error of a fix per axis", 0.0, 100.0)


@dataclass(frozen=True, eq=False)
class Paths(Value):
    """The mapped walks at places (g) a fixed way apart, each along it and back.

    `first` is the first place of the same path, `spot` the nearest spot of the map, `heading_rad`
    that of a phone carried along.
    """

    xy_m: F64 = array("g", 2)
    heading_rad: F64 = array("g")
    spot: I64 = array("g", dtype=np.int64)
    first: I64 = array("g", dtype=np.int64)


def locate_by_segments(
    nodes: Odometry, scores: F32, floor_map: FloorMap, parameters: SegmentParameters
) -> Fixes:
    """A fix for every footstep that has enough of them before it.

    `scores` (n-1, m) say how similar each spot of the map is to each stretch between the n nodes,
    rows of NaN where nothing was heard. Times are the middles of the last stretch used. None at
    all (0 fixes) where the walk has too few footsteps.
    """
    length = parameters.footsteps
    poses = nodes.world_from_body
    middle_m = (poses[1:, :2] + poses[:-1, :2]) / 2
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    paths = paths_of(floor_map)
    rows = [
        _fix(middle_m[each], scores[each], paths, floor_map, parameters)
        for each in (slice(last - length, last) for last in range(length, len(middle_m) + 1))
    ]
    if not rows:
        none = np.empty(0)
        covariance = np.empty((0, 2, 2))
        return Fixes(none, np.empty((0, 2)), none, covariance, none, none.astype(np.int64))
    columns = (np.array(column) for column in zip(*rows, strict=True))
    return Fixes(middle_s[length - 1 :], *columns)


def paths_of(floor_map: FloorMap) -> Paths:
    """The walks of a map as paths; walks of one spot give none."""
    first, parts = 0, []
    for rows in _chains(floor_map):
        for way in (1, -1):
            part = _path(floor_map, rows[::way], way)
            parts.append((*part, np.full(len(part[0]), first)))
            first += len(part[0])
    return Paths(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def shape_errors(path_m: F64, places: I64, curve_m: F64) -> F64:
    """Root mean square distance (s) of stretches of a path from a curve (n, 2), rigidly laid on.

    Stretch s is the path (g, 2) at s + `places` (n, from 0), for all that fit on it.
    """
    path, curve = _complex(path_m - path_m.mean(axis=0)), _complex(curve_m - curve_m.mean(axis=0))
    count = max(len(path) - int(places[-1]), 0)
    power = np.abs(path) ** 2
    total, overlap, square = np.zeros(count, complex), np.zeros(count, complex), np.zeros(count)
    for place, point in zip(places, curve, strict=True):
        some = slice(place, place + count)
        total += path[some]
        overlap += path[some] * point.conj()
        square += power[some]
    square += float(np.sum(np.abs(curve) ** 2)) - np.abs(total) ** 2 / len(curve)
    return np.asarray(np.sqrt(np.maximum(square - 2 * np.abs(overlap), 0.0) / len(curve)))


def _complex(xy_m: F64) -> C128:
    return np.asarray(xy_m[:, 0] + 1j * xy_m[:, 1])


def _chains(floor_map: FloorMap) -> list[I64]:
    """The spots of each mapped walk in order, cut where two neighbours lie too far apart."""
    order = np.lexsort((floor_map.order, floor_map.walk))
    apart_m = np.linalg.norm(np.diff(floor_map.xy_m[order], axis=0), axis=1)
    cut = (np.diff(floor_map.walk[order]) != 0) | (apart_m > JUMP_M)
    return np.split(order, np.flatnonzero(cut) + 1)


def _path(floor_map: FloorMap, rows: I64, way: int) -> tuple[F64, F64, I64]:
    """Positions, headings and nearest spots along one chain, evenly spaced."""
    xy_m = floor_map.xy_m[rows]
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0), axis=1))])
    places_m = np.arange(0.0, at_m[-1] + 1e-9, SPACING_M)
    along = np.interp(places_m, at_m, np.arange(len(rows), dtype=np.float64))
    spot = rows[np.round(along).astype(np.int64)]
    placed = np.column_stack([np.interp(places_m, at_m, column) for column in xy_m.T])
    turned = 0.0 if way == 1 else np.pi
    return placed, wrap_angle(floor_map.heading_rad[spot] + turned), spot


def _fix(
    curve_m: F64, scores: F32, paths: Paths, floor_map: FloorMap, parameters: SegmentParameters
) -> Fix:
    heard = ~np.isnan(scores[:, 0])
    if heard.sum() < max(1, parameters.fewest_heard * len(heard)):
        return *NOWHERE, np.nan, int(FixStatus.NO_ECHO)
    end, alike = _candidates(curve_m, scores, heard, paths, parameters)
    if not len(end):
        return *NOWHERE, np.nan, int(FixStatus.UNKNOWN_PLACE)
    covariances_m2 = floor_map.covariance_m2[paths.spot[end]]
    return scored_fix(alike, paths.xy_m[end], paths.heading_rad[end], covariances_m2, parameters)


def _candidates(
    curve_m: F64, scores: F32, heard: Bool, paths: Paths, parameters: SegmentParameters
) -> tuple[I64, F32]:
    """Where stretches (s) of the shape of the curve end, and how similar what was heard is to each.

    Every length of step that is tried gives its own.
    """
    steps_m = np.linalg.norm(np.diff(curve_m, axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    reach = parameters.scale_reach if parameters.scales > 1 else 0.0
    along = np.take(scores[heard], paths.spot, axis=1)
    ends, similarities = [], []
    for scale in np.linspace(1 - reach, 1 + reach, parameters.scales):
        places = np.round(scale * walked_m / SPACING_M).astype(np.int64)
        off_m = shape_errors(paths.xy_m, places, scale * curve_m)
        begin = np.flatnonzero(off_m <= parameters.most_off_m)
        begin = begin[paths.first[begin] == paths.first[begin + places[-1]]]
        alike = [row[begin + place] for row, place in zip(along, places[heard], strict=True)]
        ends.append(begin + places[-1])
        similarities.append(np.mean(alike, axis=0))
    return np.concatenate(ends), np.concatenate(similarities)
