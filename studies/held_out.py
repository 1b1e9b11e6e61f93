"""A walk with an unknown start, located in the map of a floor by Wi-Fi and the magnetic field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose
from elfslam.base.values import Closures, Odometry, WifiScans
from elfslam.baselines.neighbours import (
    UNKNOWN_HEADING_RAD,
    NeighbourParameters,
    field_weights,
    field_windows,
)
from elfslam.baselines.wifi import Fingerprints, WifiFingerprintParameters, fingerprints
from elfslam.baselines.wifi_places import (
    PlaceParameters,
    WifiPlaces,
    place_scores,
    placed_by,
    wifi_places,
)
from studies.floor_graph import StartSigma, corrected, thinned_rows
from studies.mall_floor import FloorWalk, compass_turn

ANYWHERE_M = 300.0
"""How exactly the start of a walk is known that may begin anywhere on the floor."""
NEAR_M = 15.0
"""The field is compared with places this near to where Wi-Fi has the walk."""
WORLD = -1
"""As the node before the first, the world's origin of a graph of walks."""
PLACES = PlaceParameters()


@dataclass(frozen=True, eq=False)
class FloorPlaces:
    """The places of all mapped walks: where they are, how they were walked, what is there."""

    wifi: WifiPlaces
    heading_rad: F64
    windows: F64


def floor_places(walks: Sequence[FloorWalk], poses: Sequence[F64]) -> FloorPlaces:
    """A place for every stretch between footsteps of walks with scans, from their solved poses."""
    heard = [(w, at) for w, at in zip(walks, poses, strict=True) if w.recording.wifi is not None]
    parameters = WifiFingerprintParameters()
    wifi = wifi_places(
        [fingerprints(_scans(walk), walk.nodes, parameters) for walk, _ in heard],
        [(at[1:, :2] + at[:-1, :2]) / 2 for _, at in heard],
        parameters,
    )
    heading_rad = np.concatenate([at[:-1, 2] for _, at in heard])
    return FloorPlaces(wifi, heading_rad, np.vstack([_windows(walk) for walk, _ in heard]))


def at_each_place(walk: FloorWalk, places: FloorPlaces, at_s: F64) -> F64:
    """Positions (k, 2) at times by the Wi-Fi heard around them alone, without dead reckoning."""
    scores = _scores(_scans(walk), walk.nodes, places, np.arange(len(walk.nodes.t_s) - 1))
    xy_m = placed_by(scores, places.wifi.xy_m, PLACES)
    middle_s = (walk.nodes.t_s[1:] + walk.nodes.t_s[:-1]) / 2
    good = np.isfinite(xy_m[:, 0])
    if not good.any():
        return np.full((len(at_s), 2), np.nan)
    columns = [np.interp(at_s, middle_s[good], xy_m[good, axis]) for axis in (0, 1)]
    return np.column_stack(columns)


def whole_walk(walk: FloorWalk, places: FloorPlaces) -> F64:
    """Poses (n, 3) of a walk that Wi-Fi draws to where it belongs, all of it known."""
    return drawn(walk.nodes, _pulls(_scans(walk), walk.nodes, places))


def whole_walk_by_field(walk: FloorWalk, places: FloorPlaces) -> F64:
    """The same with the magnetic field telling which of the places near by are meant."""
    poses, rows = whole_walk(walk, places), pulled_rows(walk.nodes)
    scores = _scores(_scans(walk), walk.nodes, places, rows)
    middle_m = (poses[rows + 1, :2] + poses[rows, :2]) / 2
    near = np.linalg.norm(middle_m[:, None] - places.wifi.xy_m[None], axis=2) <= NEAR_M
    field = _field_weights(_windows(walk)[rows], poses[rows, 2], near, places)
    weights = scores**PLACES.wifi_power * field
    xy_m = placed_by(weights, places.wifi.xy_m, replace(PLACES, wifi_power=1.0))
    return drawn(walk.nodes, xy_m)


def live(walk: FloorWalk, places: FloorPlaces, at_s: F64) -> F64:
    """Positions (k, 2), each from what was known by then; NaN before the first scan.

    The heading, too, is the mean of the phone's up to then.
    """
    return np.array([_by_then(walk, places, until_s) for until_s in at_s])


def drawn(nodes: Odometry, xy_m: F64) -> F64:
    """Poses (n, 3) of a walk from anywhere, its `pulled_rows` drawn to places (k, 2).

    Its heading is known as that of walks with a known start is; rows of NaN draw nothing. All
    poses are NaN where nothing draws.
    """
    pulled = np.flatnonzero(np.isfinite(xy_m[:, 0]))
    if not len(pulled):
        return np.full_like(nodes.world_from_body, np.nan)
    to_m = xy_m[pulled]
    at_m = nodes.world_from_body[pulled_rows(nodes)[pulled], :2]
    placed = nodes.world_from_body + np.array([*(to_m - at_m).mean(axis=0), 0.0])
    variance = [NeighbourParameters().sigma_m ** 2] * 2 + [UNKNOWN_HEADING_RAD**2]
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
    return np.minimum(thinned_rows(nodes), len(nodes.t_s) - 2)


def _scores(wifi: WifiScans, nodes: Odometry, places: FloorPlaces, rows: I64) -> F64:
    """Scores (k, m) of all places at some stretches."""
    parameters = WifiFingerprintParameters()
    heard = fingerprints(wifi, nodes, parameters)
    some = Fingerprints(heard.bssids, heard.rssi_dbm[rows])
    return place_scores(some, places.wifi, parameters)


def _pulls(wifi: WifiScans, nodes: Odometry, places: FloorPlaces) -> F64:
    """Where Wi-Fi draws the pulled stretches (k, 2)."""
    scores = _scores(wifi, nodes, places, pulled_rows(nodes))
    return placed_by(scores, places.wifi.xy_m, PLACES)


def _by_then(walk: FloorWalk, places: FloorPlaces, until_s: float) -> F64:
    wifi, nodes = _until(_scans(walk), walk.nodes, until_s)
    if len(nodes.t_s) < 2 or not len(wifi.t_s):
        return np.full(2, np.nan)
    if walk.recording.orientation is not None:
        late = compass_turn(walk.recording.orientation, walk.nodes)
        turn_rad = compass_turn(walk.recording.orientation, nodes) - late
        poses = compose(np.array([0.0, 0.0, turn_rad]), nodes.world_from_body)
        nodes = replace(nodes, world_from_body=poses)
    return drawn(nodes, _pulls(wifi, nodes, places))[-1, :2]


def _until(wifi: WifiScans, nodes: Odometry, until_s: float) -> tuple[WifiScans, Odometry]:
    """What was heard and walked by then, from the first footstep to the last."""
    count = int(np.searchsorted(nodes.t_s, until_s, side="right"))
    within = nodes.t_s[max(count - 1, 0)]
    scans = (wifi.t_s >= nodes.t_s[0]) & (wifi.t_s <= min(within, until_s))
    heard = WifiScans(wifi.t_s[scans], wifi.bssids, wifi.rssi_dbm[scans], wifi.age_s[scans])
    walked = replace(
        nodes,
        t_s=nodes.t_s[:count],
        world_from_body=nodes.world_from_body[:count],
        step_sigma=nodes.step_sigma[: max(count - 1, 0)],
    )
    return heard, walked


def _field_weights(windows: F64, heading_rad: F64, near: Bool, places: FloorPlaces) -> F64:
    """Weights (n, m) of the places near by; 0 for all others."""
    weights = np.zeros(near.shape)
    some, count = np.flatnonzero(near.any(axis=0)), len(near)
    both = np.zeros((count + len(some),) * 2, dtype=np.bool_)
    both[:count, count:] = near[:, some]
    weights[:, some] = field_weights(
        np.vstack([windows, places.windows[some]]),
        np.concatenate([heading_rad, places.heading_rad[some]]),
        both,
        NeighbourParameters(),
    )[:count, count:]
    return weights


def _windows(walk: FloorWalk) -> F64:
    """The field about the beginning of each stretch."""
    known = walk.recording
    if known.magnetometer is None:
        raise InputError(f"{known.name}: has no magnetometer; leave it out")
    parameters = NeighbourParameters()
    return field_windows(known.magnetometer, known.orientation, walk.nodes, parameters)[:-1]


def _scans(walk: FloorWalk) -> WifiScans:
    if walk.recording.wifi is None:
        raise InputError(f"{walk.recording.name}: has no Wi-Fi scan; leave it out")
    return walk.recording.wifi
