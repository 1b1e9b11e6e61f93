"""Map matching by a particle filter: a walk followed through the passages of a floor plan.

A particle filter whose particles remember where they came from (Widyawan, Klepal and Beauregard
2008, "A backtracking particle filter for fusing building plans with PDR displacement estimates").
Whoever walks through a wall dies out, with all the past that led there.
"""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt

from elfslam.base.arrays import F64, I64, Value, array
from elfslam.base.geometry import between, compose, mean_pose
from elfslam.base.grid import FloorGrid
from elfslam.base.parameters import parameter
from elfslam.base.values import Odometry, Trajectory


@dataclass(frozen=True)
class MapMatchingParameters:
    """How a walk is followed through a plan."""

    particles: int = parameter(4000, "", "particles of the walk", 10, 1_000_000)
    step_noise: float = parameter(
        0.5, "", "share of the stated noise of steps that particles differ by", 0.01, 10.0
    )
    scale_sigma: float = parameter(
        0.02, "", "relative error of the walk's length, one sigma", 0.0, 0.2
    )
    error_m: float = parameter(
        0.15, "m", "how far off the ground of the plan people are taken to be", 0.01, 5.0
    )
    reach_m: float = parameter(
        0.6, "m", "further off accessible ground is no less likely", 0.1, 10.0
    )
    say: float = parameter(
        0.35, "", "share of a footstep's evidence that is new beside the last", 0.01, 1.0
    )


@dataclass(frozen=True, eq=False)
class Particles(Value):
    """Poses (p, 3) of all particles, their scale, how their heading drifts, and log weight."""

    poses: F64 = array("p", 3)
    scale: F64 = array("p")
    drift_radps: F64 = array("p")
    log_weight: F64 = array("p")


@dataclass(frozen=True, eq=False)
class Followed(Value):
    """The walk as the plan allows it, and the share of footsteps off the ground all the same."""

    poses: F64 = array("n", 3)
    covariance: F64 = array("n", 3, 3, covariance=True)
    off_share: float


@dataclass(frozen=True, eq=False)
class Gaps(Value):
    """How far off the ground each square is, m, from its lower left corner on."""

    gap_m: F64 = array("r", "c")
    corner_m: F64 = array(2)
    cell_m: float

    def at(self, xy_m: F64) -> F64:
        """Gaps (n) at points (n, 2); beyond the squares as at their edge."""
        square = np.floor((xy_m - self.corner_m) / self.cell_m).astype(np.int64)
        column, row = np.clip(square, 0, np.array(self.gap_m.shape[::-1]) - 1).T
        return np.asarray(self.gap_m[row, column])


def gaps_of(ground: FloorGrid, reach_m: float) -> Gaps:
    """Distances to ground where people stand, asked up to `reach_m` about it."""
    margin = int(np.ceil(reach_m / ground.cell_m)) + 1
    free = np.pad(ground.free, margin)
    gap_m = distance_transform_edt(~free) * ground.cell_m if free.any() else np.inf * ~free
    corner_m = ground.corner_m - margin * ground.cell_m
    return Gaps(np.minimum(gap_m, reach_m), corner_m, ground.cell_m)


def follow_ground(
    nodes: Odometry,
    start: F64,
    start_covariance: F64,
    ground: FloorGrid,
    parameters: MapMatchingParameters,
    generator: np.random.Generator,
) -> Followed:
    """The walk of `nodes` from about `start` (3, with its covariance) over standing ground.

    The moves are those between the nodes, each with its step's sigmas; corrected poses serve as
    well as reckoned ones. Everything in the frame of the plan.
    """
    gaps = gaps_of(ground, parameters.reach_m)
    moves = between(nodes.world_from_body[:-1], nodes.world_from_body[1:])
    sigma = nodes.step_sigma * [parameters.step_noise, parameters.step_noise, 1.0]
    drift_radps = nodes.heading_drift_sigma_radps
    particles = _first(start, start_covariance, drift_radps, parameters, generator)
    past, parents = [particles.poses], []
    for move, errs, lasting_s in zip(moves, sigma, np.diff(nodes.t_s), strict=True):
        moved = _moved(particles, move, errs, lasting_s, generator)
        particles = _weighed(moved, gaps, parameters)
        parent = _survivors(particles, generator)
        particles = _chosen(particles, parent)
        past.append(particles.poses)
        parents.append(parent)
    poses, covariance = _remembered(past, parents, _weights(particles))
    covariance[:, [0, 1], [0, 1]] += parameters.error_m**2
    off = gaps.at(poses[:, :2]) > 2 * parameters.error_m
    return Followed(poses, covariance, float(off.mean()))


def followed_trajectory(trajectory: Trajectory, followed: Followed) -> Trajectory:
    """The trajectory with its poses as the plan allows them."""
    return replace(
        trajectory, world_from_body=followed.poses, covariance=followed.covariance, status="OK"
    )


def _first(
    start: F64,
    covariance: F64,
    drift_sigma_radps: float,
    parameters: MapMatchingParameters,
    generator: np.random.Generator,
) -> Particles:
    count = parameters.particles
    poses = generator.multivariate_normal(start, covariance, count)
    scale = 1 + parameters.scale_sigma * generator.standard_normal(count)
    drift_radps = drift_sigma_radps * generator.standard_normal(count)
    return Particles(poses, scale, drift_radps, np.zeros(count))


def _moved(
    particles: Particles, move: F64, sigma: F64, lasting_s: float, generator: np.random.Generator
) -> Particles:
    """Each particle moved by the step as it may have been."""
    steps = move + sigma * generator.standard_normal(particles.poses.shape)
    steps[:, 2] += particles.drift_radps * lasting_s
    steps[:, :2] *= particles.scale[:, None]
    return replace(particles, poses=compose(particles.poses, steps))


def _weighed(particles: Particles, gaps: Gaps, parameters: MapMatchingParameters) -> Particles:
    gap = gaps.at(particles.poses[:, :2]) / parameters.error_m
    return replace(particles, log_weight=particles.log_weight - parameters.say * gap**2 / 2)


def _weights(particles: Particles) -> F64:
    weight = np.exp(particles.log_weight - particles.log_weight.max())
    return np.asarray(weight / weight.sum())


def _survivors(particles: Particles, generator: np.random.Generator) -> I64:
    """Indices of the particles that go on: all, until half of their worth is lost."""
    weight, count = _weights(particles), len(particles.poses)
    if 1 / np.sum(weight**2) > count / 2:
        return np.arange(count)
    ladder = (generator.random() + np.arange(count)) / count
    return np.minimum(np.searchsorted(np.cumsum(weight), ladder), count - 1)


def _chosen(particles: Particles, parent: I64) -> Particles:
    same = bool((np.diff(parent) == 1).all())
    weight = particles.log_weight if same else np.zeros(len(parent))
    kept = particles.poses[parent], particles.scale[parent], particles.drift_radps[parent]
    return Particles(*kept, weight)


def _remembered(past: list[F64], parents: list[I64], weight: F64) -> tuple[F64, F64]:
    """Mean poses (n, 3) and covariances (n, 3, 3) of the pasts of those who are left."""
    row, told = np.arange(len(weight)), []
    for poses, parent in zip(past[::-1], [*parents[::-1], row], strict=True):
        told.append(mean_pose(poses[row], weight))
        row = parent[row]
    told.reverse()
    return np.array([pose for pose, _ in told]), np.array([spread for _, spread in told])
