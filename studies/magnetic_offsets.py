"""Where along the walk a closure holds best: two passes shifted until their fields agree.

A similarity between stretches finds a revisit to about half the distance between nodes. Sliding the
field of one pass along that of the other finds how far apart the two nodes lie to a decimetre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.geometry import between, interpolate_poses, wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.values import Closures, Odometry
from elfslam.baselines.magnetic import TURNED_ROUND, FieldProfile


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
