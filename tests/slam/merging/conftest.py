"""Planted walks: a place is a smooth random field of features over position and heading."""

from collections.abc import Callable

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import compose, interpolate_poses
from elfslam.base.values import Closures, Features, Odometry, Trajectory
from elfslam.slam.merging import MappedWalk

STEP_M = 0.7
STEP_S = 0.5
SIZE = 48
FORGETS_M, FORGETS_RAD = 0.7, 0.5
Place = Callable[[F64], F32]
Walker = Callable[..., MappedWalk]


def place(seed: int) -> Place:
    """What a pose (n, 3) sounds like there: unit vectors (n, 48)."""
    generator = np.random.default_rng(seed)
    waves = generator.normal(0, 1, (3, SIZE)) / np.array([[FORGETS_M], [FORGETS_M], [FORGETS_RAD]])
    phase = generator.uniform(0, 2 * np.pi, SIZE)

    def heard(poses: F64) -> F32:
        looking = np.column_stack([poses[:, :2], np.sin(poses[:, 2])])
        vectors = np.cos(looking @ waves + phase)
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.asarray(vectors / length, dtype=np.float32)

    return heard


def lap(width_m: float = 9.0, depth_m: float = 6.0, turns: float = 2.2, first: float = 0.0) -> F64:
    """Poses of footsteps round a rectangle, anticlockwise, from one share of a round to another."""
    ring = np.array([[0, 0], [width_m, 0], [width_m, depth_m], [0, depth_m], [0, 0]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    at = np.arange(first * along[-1], turns * along[-1], STEP_M) % along[-1]
    xy = np.column_stack([np.interp(at, along, ring[:, k]) for k in range(2)])
    heading = np.array([0, np.pi / 2, np.pi, -np.pi / 2])[np.searchsorted(along, at, "right") - 1]
    return np.column_stack([xy, heading])


def made_walk(
    heard: Place, true: F64, name: str, *, start: F64 | None = None, seed: int = 0
) -> MappedWalk:
    """A walk over true footsteps (n, 3) whose own frame has its origin at `start` (3)."""
    generator = np.random.default_rng(seed)
    frame = np.zeros(3) if start is None else np.asarray(start)
    t_s = STEP_S * np.arange(len(true))
    poses = compose(frame, true)
    poses[:, :2] += 0.05 * generator.standard_normal((len(true), 2))
    odometry = Odometry(t_s, poses, np.tile([0.1, 0.1, 0.02], (len(t_s) - 1, 1)))
    covariance = np.tile(np.diag([0.01, 0.01, 0.001]), (len(t_s), 1, 1))
    none = np.empty(0, dtype=np.int64)
    closures = Closures(none, none, np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3)))
    echo_t_s = np.arange(0.05, t_s[-1], 0.1)
    vectors = heard(interpolate_poses(t_s, true, echo_t_s))
    vectors = vectors + 0.03 * generator.standard_normal(vectors.shape)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    features = Features(echo_t_s, vectors, "planted")
    trajectory = Trajectory(t_s, poses, covariance, np.empty(0), "NO_CLOSURES")
    return MappedWalk(name, odometry, trajectory, closures, features)


@pytest.fixture
def here() -> Place:
    return place(1)


@pytest.fixture
def elsewhere() -> Place:
    return place(2)


@pytest.fixture
def walker() -> Walker:
    """`walker(place, name, way={...}, start=..., seed=...)`: two rounds of a rectangle or more."""

    def walk(
        heard: Place, name: str, *, way: dict[str, float] | None = None, **known
    ) -> MappedWalk:
        return made_walk(heard, lap(**(way or {})), name, **known)

    return walk
