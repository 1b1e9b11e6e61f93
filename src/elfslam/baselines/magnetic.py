"""Geomagnetic similarity: the field along the walk, compared by dynamic time warping.

Steel and wiring bend the field in a way that stays with the place. The field is levelled by roll
and pitch, sampled by distance walked instead of time, and the stretches around any two nodes are
compared by dynamic time warping (DTW), as in the geomagnetic SLAM that the paper compares with
(Wang et al., keyframe-based geomagnetic SLAM). Yaw is never used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation, Slerp

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import Magnetometer, Odometry, Orientation, Similarity

TURNED_ROUND = {1: np.array([1.0]), 3: np.array([-1.0, -1.0, 1.0])}
"""What walking the other way does to the magnitude alone, and to forward, left and up."""
LOOKS_AHEAD = np.array([0.0, 1.0, -1.0])
"""A phone axis that is never vertical, be the phone held flat or upright."""


@dataclass(frozen=True)
class MagneticParameters:
    """How stretches of the magnetic field are cut and compared."""

    spacing_m: float = parameter(0.25, "m", "distance between samples of the field", low=0.02)
    half_window_m: float = parameter(
        2.0, "m", "length compared before and after each node", low=0.1
    )
    warp_m: float = parameter(0.5, "m", "how far the warping may shift a sample", low=0.0)
    least_variation_ut: float = parameter(
        2.0, "uT", "components that vary less are not scaled up to unit variance", low=0.1
    )
    cost_scale: float = parameter(
        0.82, "", "warping cost (in standard deviations) where the score falls to 1/e", low=0.01
    )


def magnetic_similarity(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    parameters: MagneticParameters,
) -> Similarity:
    """Scores (n-1, n-1) in [0, 1]: exp(-cost / scale), symmetric, 1 for a stretch and itself.

    A stretch is compared as it was walked and turned round, and the better of the two counts.
    Raises InputError where the magnetometer does not cover the walk.
    """
    windows = field_sequences(magnetometer, orientation, nodes, parameters)
    band = round(parameters.warp_m / parameters.spacing_m)
    costs = np.minimum(
        warping_costs(windows, windows, band), warping_costs(windows, turned_round(windows), band)
    )
    scores = np.exp(-(costs + costs.T) / 2 / parameters.cost_scale)
    return Similarity(scores, kind="magnetic")


def field_sequences(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    parameters: MagneticParameters,
) -> F64:
    """The field (n-1, w, c) around the middle of each stretch between nodes, sampled by distance.

    The components are forward, left and up of the levelled phone, or the magnitude alone where the
    orientation is unknown; each without its mean over the walk, in standard deviations.
    """
    field = levelled_field(magnetometer, orientation)
    walked_m = _walked_m(nodes)
    along_m, sampled = _by_distance(magnetometer.t_s, field, nodes.t_s, walked_m, parameters)
    middle_m = (walked_m[1:] + walked_m[:-1]) / 2
    reach = round(parameters.half_window_m / parameters.spacing_m)
    offsets_m = parameters.spacing_m * np.arange(-reach, reach + 1)
    wanted_m = middle_m[:, None] + offsets_m
    normal = _normalised(sampled, parameters)
    return np.stack([np.interp(wanted_m, along_m, column) for column in normal.T], axis=-1)


def levelled_field(magnetometer: Magnetometer, orientation: Orientation | None) -> F64:
    """The field (n, 3), forward, left and up of the phone held level, microtesla.

    Without an orientation only its magnitude (n, 1). Turning the walker about the vertical turns
    forward and left with it: no yaw enters.
    """
    if orientation is None or len(orientation.t_s) < 2:
        return np.asarray(np.linalg.norm(magnetometer.field_ut, axis=1, keepdims=True))
    attitude = Slerp(orientation.t_s, Rotation.from_quat(orientation.world_from_phone))
    at_s = np.clip(magnetometer.t_s, orientation.t_s[0], orientation.t_s[-1])
    world_from_phone = attitude(at_s).as_matrix()
    east, north, up = np.einsum("nij,nj->in", world_from_phone, magnetometer.field_ut)
    ahead = (world_from_phone @ LOOKS_AHEAD)[:, :2]
    cos, sin = (ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)).T
    return np.column_stack([cos * east + sin * north, cos * north - sin * east, up])


def turned_round(windows: F64) -> F64:
    """The same stretches walked the other way: order reversed, forward and left with other sign."""
    return np.asarray(windows[:, ::-1] * TURNED_ROUND[windows.shape[2]])


def warping_costs(windows: F64, others: F64, band: int) -> F64:
    """Cost (n, m) of warping each of n stretches (w, c) onto each of m, per sample.

    Dynamic time warping with Euclidean cost and a Sakoe-Chiba band: samples that are matched lie
    at most `band` apart.
    """
    return np.asarray(
        _warping_costs(np.ascontiguousarray(windows), np.ascontiguousarray(others), band)
    )


def _walked_m(nodes: Odometry) -> F64:
    steps_m = np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def _by_distance(
    t_s: F64, field: F64, nodes_t_s: F64, walked_m: F64, parameters: MagneticParameters
) -> tuple[F64, F64]:
    """Distances (m) at which the field was seen, and its mean (m, c) in the cell around each."""
    inside: Bool = (t_s >= nodes_t_s[0]) & (t_s <= nodes_t_s[-1])
    if inside.sum() < 2:
        raise InputError(
            f"magnetometer: got {inside.sum()} samples between {nodes_t_s[0]:.1f} and "
            f"{nodes_t_s[-1]:.1f} s of the walk, wanted at least 2; record it while walking"
        )
    at_m = np.interp(t_s[inside], nodes_t_s, walked_m)
    cell = np.round(at_m / parameters.spacing_m).astype(int)
    counts = np.bincount(cell)
    seen = np.flatnonzero(counts)
    sums = np.column_stack([np.bincount(cell, weights=column) for column in field[inside].T])
    return np.asarray(seen * parameters.spacing_m), sums[seen] / counts[seen, None]


def _normalised(sampled: F64, parameters: MagneticParameters) -> F64:
    """Without the mean, which holds the phone's own magnetism, and of comparable variation."""
    variation_ut = np.maximum(sampled.std(axis=0), parameters.least_variation_ut)
    return np.asarray((sampled - sampled.mean(axis=0)) / variation_ut)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _warping_costs(windows: F64, others: F64, band: int) -> F64:
    costs = np.empty((len(windows), len(others)))
    for i in range(len(windows)):
        for j in range(len(others)):
            costs[i, j] = _warping_cost(windows[i], others[j], band)
    return costs


@njit(cache=True)  # type: ignore[untyped-decorator]
def _warping_cost(one: F64, other: F64, band: int) -> float:
    size = len(one)
    before = np.full(size + 1, np.inf)
    before[0] = 0.0
    now = np.empty(size + 1)
    for i in range(1, size + 1):
        now[:] = np.inf
        for j in range(max(1, i - band), min(size, i + band) + 1):
            square = 0.0
            for k in range(one.shape[1]):
                square += (one[i - 1, k] - other[j - 1, k]) ** 2
            now[j] = np.sqrt(square) + min(before[j], before[j - 1], now[j - 1])
        before, now = now, before
    return float(before[size] / size)
