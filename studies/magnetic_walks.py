"""The magnetic walks of Kok and Solin 2024: loops closed by the field alone, on a real phone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.geometry import between, interpolate_poses, wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.values import Closures, Odometry, Orientation, Recording, Similarity, Truth
from elfslam.baselines.magnetic import (
    MAGNETIC_CLOSURES,
    TURNED_ROUND,
    FieldProfile,
    MagneticParameters,
    field_profile,
    magnetic_similarity,
)
from elfslam.data.magnetic import OdometryError
from elfslam.scoring.errors import Alignment, interval, position_errors
from elfslam.stages.closure import ClosureParameters, find_closures
from elfslam.stages.graph import GraphParameters, build_graph, optimise
from elfslam.stages.motion import nodes_by_distance
from studies.results import Record

AS_STATED = GraphParameters(noise_rounds=0)
"""How noisy the odometry is, is known exactly: this study drifts it."""
SEEDS = (0, 1, 2, 3, 4)
"""Drifts that are reported; parameters were chosen on seeds from 101 on."""
PAPERS_DRIFT = OdometryError(
    heading_bias_radps=0.005, heading_sigma_rad=0.001, position_sigma_m=0.01, scale_sigma=0.0
)
"""Per sample of 0.1 s: 0.01 rad/s of noise turn by 0.001 rad."""
BIAS_SIGMA_RADPS = 0.01
"""Of the steady drift of the heading: twice what there is, of which the walk knows nothing."""
NODE_SPACING_M = 0.5
CLOSURES = replace(
    MAGNETIC_CLOSURES, threshold=0.45, along_sigma_m=1.5, across_sigma_m=1.5, heading_sigma_rad=0.3
)
"""This odometry is exact to a centimetre a sample, and closures along a line share most of their
field and so their error: each is trusted far less than it is exact."""
PAPER_RMSE_M = {"library": 0.30, "square": 0.10, "eight": 0.10, "mall": 1.02}
"""Their program on the same input: median error over drifts."""
RECKONED, RMSE = "dead reckoning", "RMSE, aligned (m)"


@dataclass(frozen=True, eq=False)
class Seen:
    """What is the same for any closures: nodes, similarity of fields, the field along the walk."""

    odometry: Odometry
    truth: Truth
    nodes: Odometry
    similarity: Similarity
    profile: FieldProfile


def median_of(of: Record, values: Sequence[float]) -> Record:
    """A record with the median of values of drifts, and its interval."""
    each = [np.atleast_1d(value) for value in values]
    low, high = interval(each, lambda some: float(np.median(some)), np.random.default_rng(0))
    return replace(of, value=float(np.median(values)), low=low, high=high)


def see(recording: Recording, truth: Truth, orientation: Orientation | None) -> Seen:
    """A drifted walk by its field; the truth is carried along only."""
    odometry, magnetometer = recording.odometry, recording.magnetometer
    assert odometry is not None
    assert magnetometer is not None
    nodes, parameters = nodes_by_distance(honest(odometry), NODE_SPACING_M), MagneticParameters()
    similarity = magnetic_similarity(magnetometer, orientation, nodes, parameters)
    fine = replace(parameters, spacing_m=AlignmentParameters().step_m)
    profile = field_profile(magnetometer, orientation, nodes, fine)
    return Seen(odometry, truth, nodes, similarity, profile)


def mapped(seen: Seen, closing: ClosureParameters, aligning: AlignmentParameters) -> F64:
    """The poses (n, 3) of the walk once closures by its field have corrected it."""
    found = find_closures(seen.similarity, seen.nodes, closing)
    closures = align_closures(found, seen.nodes, seen.profile, aligning)
    graph = build_graph(seen.nodes, closures)
    return optimise(graph, seen.nodes.t_s, AS_STATED).world_from_body


def honest(odometry: Odometry) -> Odometry:
    """The odometry that says how its turns err: each by itself, and all alike by a bias."""
    sigma = np.array(odometry.step_sigma)
    sigma[:, 2] = PAPERS_DRIFT.heading_sigma_rad
    return replace(odometry, step_sigma=sigma, heading_drift_sigma_radps=BIAS_SIGMA_RADPS)


def rmse_m(t_s: F64, poses: F64, truth: Truth) -> float:
    """Root mean square error of poses (n, 3) after the rigid move that fits best."""
    errors = position_errors(t_s, poses, truth, Alignment.ALIGNED)
    return float(np.sqrt(np.mean(errors**2)))


# --- passes shifted against each other ---


@dataclass(frozen=True)
class AlignmentParameters:
    """How far and how finely two passes are shifted against each other."""

    step_m: float = parameter(0.1, "m", "distance between shifts and between samples", low=0.01)
    half_window_m: float = parameter(2.0, "m", "length compared before and after a node", low=0.1)
    reach_m: float = parameter(1.0, "m", "farthest shift: beyond it a closure is dropped", low=0.05)
    chord_m: float = parameter(
        1.0, "m", "the direction of walking is that of a chord this far both ways", low=0.05
    )
    worst: float = parameter(
        0.35, "", "mean square difference (in variances) beyond which a closure is dropped", low=0.0
    )


def align_closures(
    closures: Closures, nodes: Odometry, profile: FieldProfile, parameters: AlignmentParameters
) -> Closures:
    """The closures with the relative pose at which the fields of the two passes agree best.

    Those that agree nowhere within reach are left out. Passes are taken to lie on one line:
    headings differ by what the walk does between each node's heading and its chord.
    """
    shift_m, cost = np.array(
        [_best_shift(*row, profile, parameters) for row in _rows(closures)]
    ).reshape(-1, 2).T  # fmt: skip
    kept = cost <= parameters.worst
    i_from_j = _relative_poses(closures, nodes, profile.walked_m, shift_m, parameters)
    return replace(
        closures,
        i=closures.i[kept],
        j=closures.j[kept],
        score=closures.score[kept],
        i_from_j=i_from_j[kept],
        covariance=closures.covariance[kept],
    )


def _rows(closures: Closures) -> list[tuple[int, int, int]]:
    """i, j and 1, or -1 where the second pass goes the other way."""
    way = np.where(np.abs(wrap_angle(closures.i_from_j[:, 2])) > np.pi / 2, -1, 1)
    return list(zip(closures.i.tolist(), closures.j.tolist(), way.tolist(), strict=True))


def _best_shift(
    i: int, j: int, way: int, profile: FieldProfile, parameters: AlignmentParameters
) -> tuple[float, float]:
    """How far past node i, along its pass, node j lies; and the cost there (inf at the ends)."""
    window_m = _grid(parameters.half_window_m, parameters.step_m)
    shifts_m = _grid(parameters.reach_m, parameters.step_m)
    turn = TURNED_ROUND[profile.field.shape[1]] if way < 0 else 1.0
    there = profile.at(profile.walked_m[j] + way * window_m) * turn
    here = profile.at(profile.walked_m[i] + shifts_m[:, None] + window_m)
    cost = ((here - there) ** 2).sum(axis=2).mean(axis=1)
    best = int(cost.argmin())
    if best in (0, len(cost) - 1):
        return 0.0, np.inf
    before, at, after = cost[best - 1 : best + 2]
    finer = 0.5 * (before - after) / max(before - 2 * at + after, 1e-12)
    return float(shifts_m[best] + finer * parameters.step_m), float(at)


def _grid(reach_m: float, step_m: float) -> F64:
    count = round(reach_m / step_m)
    return np.asarray(step_m * np.arange(-count, count + 1))


def _relative_poses(
    closures: Closures,
    nodes: Odometry,
    walked_m: F64,
    shift_m: F64,
    parameters: AlignmentParameters,
) -> F64:
    """i_from_j (k, 3): node j stands where pass i is after the shift, and walks along its chord."""
    poses, way = nodes.world_from_body, np.array([row[2] for row in _rows(closures)])
    met_m, from_m = walked_m[closures.i] + shift_m, walked_m[closures.j]
    met = interpolate_poses(walked_m, poses, met_m)
    ahead = _chord(walked_m, poses, met_m, np.ones(len(met_m)), parameters.chord_m)
    back = _chord(walked_m, poses, from_m, way, parameters.chord_m)
    met[:, 2] = ahead - back + poses[closures.j, 2]
    return between(poses[closures.i], met)


def _chord(walked_m: F64, poses: F64, at_m: F64, way: F64, chord_m: float) -> F64:
    """Direction (k) of the walk around each distance; turned round where `way` is -1."""
    ends = [interpolate_poses(walked_m, poses, at_m + way * side * chord_m) for side in (-1, 1)]
    move = ends[1] - ends[0]
    return np.asarray(np.arctan2(move[:, 1], move[:, 0]))
