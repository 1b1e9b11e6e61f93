"""Whether dead reckoning errs as much as it says: displacements over a distance, normalised."""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Value, array
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Odometry, Truth
from elfslam.scoring.errors import is_sparse

REFERENCE_M = 10.0
"""The heading at the start of a displacement is the direction of travel over so much before it."""
TRUTH_SPACING_M = 5.0
"""Dense truth is read this often, about as far apart as waypoints lie."""
TOLERANCE = 0.3
"""A displacement may be so much longer or shorter than asked for, relative to it."""


@dataclass(frozen=True, eq=False)
class Displacements(Value):
    """Errors (n, 2) along and across the true displacements, m, and what was said of them."""

    error_m: F64 = array("n", 2)
    sigma_m: F64 = array("n", 2)
    nees: F64 = array("n")


def displacement_errors(
    odometry: Odometry, truth: Truth, distance_m: float, truth_sigma_m: float = 0.0
) -> Displacements:
    """Errors of all moves that are about `distance_m` of path long, with the odometry's sigmas.

    Each move starts where the true one does and with the direction of the REFERENCE_M before.
    `truth_sigma_m` is the error of a true position per axis (waypoints are tapped by hand). The
    normalised error squared (NEES) is 2 in the mean where the sigmas are right.
    """
    t_s, true = _read(truth, odometry)
    poses = interpolate_poses(odometry.t_s, odometry.world_from_body, t_s)[:, :2]
    found = [np.empty((0, 5))]
    for before, start, end in _triples(true, distance_m):
        error, covariance = _moved(odometry, t_s, poses, true, (before, start, end))
        covariance = covariance + _truth_covariance(true, (before, start, end), truth_sigma_m)
        nees = error @ np.linalg.solve(covariance, error)
        found.append(np.array([[*error, *np.sqrt(np.diag(covariance)), nees]]))
    rows = np.vstack(found)
    return Displacements(rows[:, :2], rows[:, 2:4], rows[:, 4])


def _read(truth: Truth, odometry: Odometry) -> tuple[F64, F64]:
    """Times and true positions (n, 2), about as far apart as waypoints."""
    inside = (truth.t_s >= odometry.t_s[0]) & (truth.t_s <= odometry.t_s[-1])
    t_s, xy_m = truth.t_s[inside], truth.world_from_body[inside, :2]
    if is_sparse(truth) or len(t_s) == 0:
        return t_s, xy_m
    cell = (_walked(xy_m) / TRUTH_SPACING_M).astype(int)
    kept = np.flatnonzero(np.diff(cell, prepend=-1))
    return t_s[kept], xy_m[kept]


def _walked(xy_m: F64) -> F64:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0), axis=1))])


def _triples(true: F64, distance_m: float) -> list[tuple[int, int, int]]:
    """Rows where a reference, a displacement and its end lie, one for each start."""
    walked_m, triples = _walked(true), []
    for start in range(1, len(true) - 1):
        before = int(np.searchsorted(walked_m, walked_m[start] - REFERENCE_M, "right")) - 1
        end = start + int(np.argmin(abs(walked_m[start:] - walked_m[start] - distance_m)))
        far_m = walked_m[end] - walked_m[start]
        straight_m = np.linalg.norm(true[start] - true[max(before, 0)])
        near = abs(far_m - distance_m) <= TOLERANCE * distance_m
        if (
            before >= 0
            and near
            and straight_m > REFERENCE_M / 2
            and np.any(true[end] != true[start])
        ):
            triples.append((before, start, end))
    return triples


def _moved(
    odometry: Odometry, t_s: F64, poses: F64, true: F64, rows: tuple[int, int, int]
) -> tuple[F64, F64]:
    """Error along and across the true displacement, and its covariance (2, 2) in those axes."""
    before, start, end = rows
    turn = _angle(true[start] - true[before]) - _angle(poses[start] - poses[before])
    wanted = true[end] - true[start]
    axes = _rotation(-_angle(wanted))
    error = axes @ (_rotation(turn) @ (poses[end] - poses[start]) - wanted)
    nodes = np.searchsorted(odometry.t_s, t_s[[before, start, end]])
    into = axes @ _rotation(turn)
    covariance = into @ _covariance(odometry, nodes) @ into.T
    return error, covariance


def _covariance(odometry: Odometry, nodes: I64) -> F64:
    """Covariance (2, 2) of the displacement between the last two of three nodes, odometry axes.

    The direction from the first to the second is what the heading is taken from.
    """
    before, start, end = nodes
    position = odometry.world_from_body[:, :2]
    noise, reference_noise = _noise(odometry, start, end), _noise(odometry, before, start)
    reference = position[start] - position[before]
    length_m = max(float(np.linalg.norm(reference)), 1e-9)
    aside = _turned(reference) / length_m**2
    swing = _turned(position[end] - position[start])
    # At the start the heading is off by all that was gathered; the reference tells a part of it.
    gathered_rad = np.concatenate(
        [np.zeros(2 * (start - before)), odometry.step_sigma[before:start, 2]]
    )
    turned_rad = gathered_rad - reference_noise @ aside
    drifted_rad = odometry.heading_drift_sigma_radps * (odometry.t_s[start] - odometry.t_s[before])
    drifted_rad -= float(_drift(odometry, before, start) @ aside)
    drift = _drift(odometry, start, end) + swing * drifted_rad
    scale = odometry.scale_sigma * (position[end] - position[start])
    along_walk = np.outer(drift, drift) + np.outer(scale, scale)
    swung = np.outer(swing, swing) * float(turned_rad @ turned_rad)
    return np.asarray(noise.T @ noise + swung + along_walk)


def _noise(odometry: Odometry, start: int, end: int) -> F64:
    """What each step's independent errors move the end by, one sigma: rows (k, 2)."""
    rows = np.arange(start, end)
    heading = odometry.world_from_body[rows, 2]
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    sigma = odometry.step_sigma[rows]
    swept_m = _turned(odometry.world_from_body[end, :2] - odometry.world_from_body[rows + 1, :2])
    return np.vstack([ahead * sigma[:, :1], _turned(ahead) * sigma[:, 1:2], swept_m * sigma[:, 2:]])


def _drift(odometry: Odometry, start: int, end: int) -> F64:
    """What one sigma of the steady turn moves the end (2) by."""
    rows = np.arange(start, end)
    swept_m = _turned(odometry.world_from_body[end, :2] - odometry.world_from_body[rows + 1, :2])
    lasting_s = np.diff(odometry.t_s)[rows, None]
    return np.asarray(odometry.heading_drift_sigma_radps * (swept_m * lasting_s).sum(axis=0))


def _truth_covariance(true: F64, rows: tuple[int, int, int], sigma_m: float) -> F64:
    """What errors of the true positions add: at both ends, and by the heading they give."""
    before, start, end = rows
    far_m = np.linalg.norm(true[end] - true[start])
    reference_m = np.linalg.norm(true[start] - true[before])
    return 2 * sigma_m**2 * np.diag([1.0, 1.0 + (far_m / reference_m) ** 2])


def _turned(vectors: F64) -> F64:
    """Vectors (..., 2) a quarter turn to the left."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def _angle(vector: F64) -> float:
    return float(np.arctan2(vector[1], vector[0]))


def _rotation(angle_rad: float) -> F64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
