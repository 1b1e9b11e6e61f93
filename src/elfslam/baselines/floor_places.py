"""A walk with an unknown start, located in the map of a floor by Wi-Fi and the magnetic field."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.enums import Modality, Mode
from elfslam.base.errors import InputError
from elfslam.base.values import (
    Closures,
    Fixes,
    FixStatus,
    FloorMap,
    Odometry,
    Trajectory,
    WifiScans,
)
from elfslam.baselines.floor_walks import (
    LEVELS,
    FloorParameters,
    FloorWalk,
    StartSigma,
    corrected,
    field_levels,
    heading_by_phone,
    thinned_rows,
)
from elfslam.baselines.maps import payload_of, rssi_of
from elfslam.baselines.neighbours import UNKNOWN_HEADING_RAD, field_weights
from elfslam.baselines.wifi import (
    Fingerprints,
    WifiPlaces,
    fingerprints,
    place_scores,
    placed_by,
    wifi_places,
)

SENSORS = ("imu", "orientation", "magnetometer", "wifi")
ANYWHERE_M = 300.0
"""How exactly the start of a walk is known that may begin anywhere on the floor."""
WORLD = -1
"""As the node before the first, the world's origin of a graph of walks."""


@dataclass(frozen=True, eq=False)
class FloorPlaces:
    """The places of a mapped floor: where they are, how they were walked, what is there.

    `levels` (m, w, 2) is the magnetic field about each, where it is asked for.
    """

    wifi: WifiPlaces
    heading_rad: F64
    levels: F64 | None
    parameters: FloorParameters


def floor_places(
    floor_map: FloorMap, by: Collection[Modality], parameters: FloorParameters
) -> FloorPlaces:
    """The places of a map, known by Wi-Fi and maybe by the magnetic field as well.

    Raises InputError where Wi-Fi is not among them, or the map has not what is asked for.
    """
    if Modality.WIFI not in by:
        raise InputError(
            f"floor: wanted wifi, or wifi and magnetic, got {','.join(by)}; the field alone tells "
            "no place of a floor"
        )
    wifi = wifi_places([rssi_of(floor_map, parameters.wifi)], [floor_map.xy_m], parameters.wifi)
    levels = None
    if Modality.MAGNETIC in by:
        known = payload_of(floor_map, "magnetic", LEVELS)
        levels = known.vectors.astype(np.float64).reshape(len(known.vectors), -1, 2)
    return FloorPlaces(wifi, floor_map.heading_rad, levels, parameters)


def locate_on_floor(walk: FloorWalk, places: FloorPlaces, mode: Mode) -> Fixes:
    """A fix per stretch by the Wi-Fi there; per footstep by the whole walk, or by what was known
    of it by then (`Mode.TRACK`).

    Raises InputError where the walk has no scan, or no field where that is asked for.
    """
    _scans(walk)
    if mode is Mode.ONE_SHOT:
        return at_each_place(walk, places)
    t_s = walk.nodes.t_s
    if mode is Mode.TRACK:
        known = [known_by(walk, places, count) for count in range(1, len(t_s) + 1)]
        return _fixes(t_s, [None if each is None else _pose(each, -1) for each in known])
    whole = whole_walk(walk, places)
    return _fixes(t_s, [None if whole is None else _pose(whole, k) for k in range(len(t_s))])


def at_each_place(walk: FloorWalk, places: FloorPlaces) -> Fixes:
    """Fixes by the Wi-Fi heard around the middle of each stretch, without dead reckoning."""
    scores = _scores(walk, places, np.arange(len(walk.nodes.t_s) - 1))
    known = places.parameters.places
    xy_m, scatter_m2 = placed_by(scores, places.wifi.xy_m, known)
    middle_s = (walk.nodes.t_s[1:] + walk.nodes.t_s[:-1]) / 2
    return Fixes(
        t_s=middle_s,
        xy_m=xy_m,
        heading_rad=np.full(len(xy_m), np.nan),
        covariance_m2=scatter_m2 + known.sigma_m**2 * np.eye(2),
        score=scores.max(axis=1),
        status=_status(xy_m),
    )


def whole_walk(walk: FloorWalk, places: FloorPlaces) -> Trajectory | None:
    """A walk that Wi-Fi draws to where it belongs, all of it known; None where it was never heard.

    The magnetic field, where asked for, tells which of the places near by are meant.
    """
    rows = pulled_rows(walk.nodes)
    scores = _scores(walk, places, rows)
    known = places.parameters.places
    drawn_by_wifi = drawn(walk.nodes, placed_by(scores, places.wifi.xy_m, known)[0], places)
    if places.levels is None or drawn_by_wifi is None:
        return drawn_by_wifi
    poses = drawn_by_wifi.world_from_body
    middle_m = (poses[rows + 1, :2] + poses[rows, :2]) / 2
    near = np.linalg.norm(middle_m[:, None] - places.wifi.xy_m[None], axis=2) <= known.near_m
    by_field = _field_weights(walk, poses[rows, 2], near, places)
    weights = scores**known.wifi_power * by_field
    xy_m, _ = placed_by(weights, places.wifi.xy_m, replace(known, wifi_power=1.0))
    return drawn(walk.nodes, xy_m, places)


def known_by(walk: FloorWalk, places: FloorPlaces, footsteps: int) -> Trajectory | None:
    """What the first footsteps and the compass up to then tell; None before the first scan.

    The footsteps are those found in the whole recording.
    """
    if footsteps < 2:
        return None
    then = _until(walk, footsteps)
    try:
        return whole_walk(heading_by_phone(then, places.parameters.motion), places)
    except InputError:
        return None


def drawn(nodes: Odometry, xy_m: F64, places: FloorPlaces) -> Trajectory | None:
    """A walk from anywhere whose `pulled_rows` are drawn to places (k, 2); None where none is.

    Its heading is known as that of walks with a known start is; rows of NaN draw nothing.
    """
    pulled = np.flatnonzero(np.isfinite(xy_m[:, 0]))
    if not len(pulled):
        return None
    to_m = xy_m[pulled]
    at_m = nodes.world_from_body[pulled_rows(nodes)[pulled], :2]
    placed = nodes.world_from_body + np.array([*(to_m - at_m).mean(axis=0), 0.0])
    variance = [places.parameters.neighbours.sigma_m**2] * 2 + [UNKNOWN_HEADING_RAD**2]
    closures = Closures(
        i=np.full(len(pulled), WORLD),
        j=pulled,
        score=np.ones(len(pulled)),
        i_from_j=np.column_stack([to_m, np.zeros(len(pulled))]),
        covariance=np.tile(np.diag(variance), (len(pulled), 1, 1)),
    )
    start = StartSigma(position_m=ANYWHERE_M)
    return corrected([replace(nodes, world_from_body=placed)], closures, start)[0]


def pulled_rows(nodes: Odometry) -> I64:
    """The stretches of a walk that are drawn: where its thinned nodes are."""
    return np.asarray(np.minimum(thinned_rows(nodes), len(nodes.t_s) - 2))


def _pose(known: Trajectory, row: int) -> tuple[F64, F64]:
    return known.world_from_body[row], known.covariance[row]


def _fixes(t_s: F64, known: Sequence[tuple[F64, F64] | None]) -> Fixes:
    """A pose and its covariance at each time, or none."""
    nowhere = np.full(3, np.nan), np.full((3, 3), np.nan)
    poses, covariance = (
        np.array(column) for column in zip(*(each or nowhere for each in known), strict=True)
    )
    return Fixes(
        t_s=t_s,
        xy_m=poses[:, :2],
        heading_rad=poses[:, 2],
        covariance_m2=covariance[:, :2, :2],
        score=np.where(np.isfinite(poses[:, 0]), 1.0, np.nan),
        status=_status(poses[:, :2]),
    )


def _status(xy_m: F64) -> I64:
    """A place that shares nothing with the map is unknown."""
    known = np.isfinite(xy_m[:, 0])
    return np.where(known, FixStatus.OK, FixStatus.UNKNOWN_PLACE).astype(np.int64)


def _scores(walk: FloorWalk, places: FloorPlaces, rows: I64) -> F64:
    """Scores (k, m) of all places at some stretches."""
    parameters = places.parameters.wifi
    heard = fingerprints(_scans(walk), walk.nodes, parameters)
    some = Fingerprints(heard.bssids, heard.rssi_dbm[rows])
    return place_scores(some, places.wifi, parameters)


def _until(walk: FloorWalk, count: int) -> FloorWalk:
    """The first footsteps of a walk, and what its phone had sensed by then."""
    nodes, recording = walk.nodes, walk.recording
    until_s = nodes.t_s[count - 1]
    sensed = {name: _cut(getattr(recording, name), until_s) for name in SENSORS}
    return replace(walk, recording=replace(recording, **sensed), nodes=nodes.chosen(slice(count)))


def _cut(sensed: Any, until_s: float) -> Any:
    """The rows of a sensor up to then."""
    return None if sensed is None else sensed.chosen(sensed.t_s <= until_s)


def _field_weights(walk: FloorWalk, heading_rad: F64, near: Bool, places: FloorPlaces) -> F64:
    """Weights (n, m) of the places near by, by the field at the pulled rows; 0 for all others."""
    assert places.levels is not None
    known = places.parameters.neighbours
    here = field_levels(walk, known)[pulled_rows(walk.nodes)]
    weights = np.zeros(near.shape)
    some, count = np.flatnonzero(near.any(axis=0)), len(near)
    both = np.zeros((count + len(some),) * 2, dtype=np.bool_)
    both[:count, count:] = near[:, some]
    weights[:, some] = field_weights(
        np.concatenate([here, places.levels[some]]),
        np.concatenate([heading_rad, places.heading_rad[some]]),
        both,
        known,
    )[:count, count:]
    return weights


def _scans(walk: FloorWalk) -> WifiScans:
    if walk.recording.wifi is None:
        raise InputError(f"{walk.recording.name}: has no Wi-Fi scan; leave it out")
    return walk.recording.wifi
