"""A walk with a known truth: five rounds in a room of 10 x 6 m, dead-reckoned with drift."""

from collections.abc import Callable

import numpy as np
import pytest

from elfslam.base import values
from elfslam.base.geometry import between, chain
from elfslam.scoring.figures import FloorPlan

STEP_M = 0.65
STEP_S = 0.55
ROUNDS = 5


def _rounds() -> np.ndarray:
    corners = np.array([[1, 1], [9, 1], [9, 5], [1, 5], [1, 1]], float)
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(lengths)])
    at_m = np.arange(0, ROUNDS * along[-1], STEP_M) % along[-1]
    xy = np.column_stack([np.interp(at_m, along, corners[:, axis]) for axis in (0, 1)])
    heading = np.array([0, np.pi / 2, -np.pi, -np.pi / 2])
    leg = np.clip(np.searchsorted(along, at_m, side="right") - 1, 0, 3)
    return np.column_stack([xy, heading[leg]])


@pytest.fixture(scope="session")
def truth() -> values.Truth:
    poses = _rounds()
    return values.Truth(t_s=1.0 + STEP_S * np.arange(len(poses)), world_from_body=poses)


@pytest.fixture(scope="session")
def waypoints(truth: values.Truth) -> values.Truth:
    """The same walk as positions alone, one in seven."""
    poses = truth.world_from_body[::7].copy()
    poses[:, 2] = np.nan
    return values.Truth(t_s=truth.t_s[::7], world_from_body=poses)


@pytest.fixture(scope="session")
def floor_plan() -> FloorPlan:
    room = np.array([[0, 0], [10, 0], [10, 6], [0, 6]], float)
    table = np.array([[3, 2.2], [6.5, 2.2], [6.5, 3.8], [3, 3.8]])
    shelf = np.array([[0, 5.6], [4, 5.6], [4, 6], [0, 6]])
    return FloorPlan(outline=room, obstacles=(table, shelf))


@pytest.fixture(scope="session")
def run(truth: values.Truth) -> values.Run:
    generator = np.random.default_rng(7)
    poses, size = truth.world_from_body, truth.t_s.size
    moves = between(poses[:-1], poses[1:])
    drifting = moves * [1.06, 1.06, 1] + generator.normal(0, [0.02, 0.01, 0.02], moves.shape)
    drifting[:, 2] += 0.004
    start = np.zeros(3)
    walked = chain(start, moves) + generator.normal(0, [0.06, 0.06, 0.01], (size, 3))
    sigma = 0.05 + 0.1 * np.abs(np.sin(np.arange(size) / 15))
    closures, scores = _closures(poses, generator)
    covariance = sigma[:, None, None] ** 2 * np.diag([1.0, 2.0, 0.01])
    weights = np.clip(generator.normal(0.8, 0.3, closures.i.size), 0, 1)
    return values.Run(
        name="living room <b>round</b>",
        odometry=values.Odometry(truth.t_s, chain(start, drifting), np.full((size - 1, 3), 0.05)),
        similarity=values.Similarity(scores, "elf"),
        closures=closures,
        trajectory=values.Trajectory(truth.t_s, walked, covariance, weights, "OK"),
        floor_map=None,
        echoes=_echoes(truth),
        features=values.Features(truth.t_s, np.eye(size, 128)[:, :128] + _one(size), "compact-1"),
        seconds={"echoes": 1.9, "features": 3.2, "similarity": 0.4, "closures": 0.8, "graph": 0.6},
    )


def _one(size: int) -> np.ndarray:
    """Fills the rows that a wide identity leaves empty."""
    rows = np.zeros((size, 128))
    rows[128:, 0] = 1
    return rows


def _echoes(truth: values.Truth) -> values.Echoes:
    size = truth.t_s.size
    losses = np.array([[40.0, 1.2]])
    return values.Echoes(truth.t_s, np.zeros((size, values.ECHO_SAMPLES)), losses)


def _closures(
    poses: np.ndarray, generator: np.random.Generator
) -> tuple[values.Closures, np.ndarray]:
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    facing = np.cos(poses[:, None, 2] - poses[None, :, 2]) > 0.5
    noise = generator.normal(0, 0.06, apart.shape)
    scores = 0.15 + 0.6 * np.exp(-((apart / 0.5) ** 2)) * facing + (noise + noise.T) / 2
    i, j = np.nonzero(np.triu(scores > 0.62, k=15))
    pick = generator.random(i.size) < 0.4
    i, j = np.append(i[pick], [3, 10]), np.append(j[pick], [60, 90])
    relative = between(poses[i], poses[j])
    covariance = np.tile(np.eye(3) * 0.04, (i.size, 1, 1))
    return values.Closures(i, j, scores[i, j], relative, covariance), scores[:-1, :-1]


@pytest.fixture(scope="session")
def moved() -> Callable[[values.Truth, np.ndarray], np.ndarray]:
    """Poses of a truth, seen from a map that lies at `world_from_map`."""

    def poses(truth: values.Truth, world_from_map: np.ndarray) -> np.ndarray:
        return np.asarray(between(world_from_map, truth.world_from_body))

    return poses
