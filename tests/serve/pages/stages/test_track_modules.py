"""The tracker of the page in node: with the same draws it makes the same fixes as the line's."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from elfslam.base.geometry import between
from elfslam.base.values import FixStatus, FloorMap
from elfslam.stages.track import Tracker, TrackParameters
from tests.in_node import agrees_in_node, needs_node

HERE = Path(__file__).parent
DOUBTED = (0, 9, 10, 11)
"""Steps of which others say that they are suspect."""
LURED = (22, 23, 24)
"""Steps at which another place is heard."""


class RecordedDraws:
    """A generator that notes every draw in the order of use."""

    def __init__(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)
        self.draws: list[float] = []

    def uniform(self) -> float:
        return float(self._noted(self._generator.uniform()))

    def normal(self, size: Any) -> np.ndarray:
        return np.asarray(self._noted(self._generator.normal(size=size)))

    def _noted(self, drawn: Any) -> Any:
        self.draws += np.ravel(drawn).tolist()
        return drawn


def known_floor(seed: int) -> FloorMap:
    """Spots along a winding path about the origin, there and back, in the page's numbers."""
    generator = np.random.default_rng(seed)
    along = np.arange(0, 40, 0.14)
    heading = np.concatenate([np.sin(along / 4), np.sin(along / 4) + np.pi])
    path = np.column_stack([along - 20, 3 * np.cos(along / 4)])
    xy_m = np.vstack([path, path + 0.3]) + generator.normal(0, 0.03, (2 * len(along), 2))
    count = len(xy_m)
    root = generator.normal(0, 0.1, (count, 2, 2))
    covariance = (root @ root.transpose(0, 2, 1)).astype(np.float32).astype(float)
    xy_m, heading = (np.asarray(rows, np.float32).astype(float) for rows in (xy_m, heading))
    order = np.arange(count)
    return FloorMap(xy_m, heading, np.zeros(count), order, covariance, (), "digest", ("walk",))


def heard_at(floor_map: FloorMap, xy_m: np.ndarray, level: float) -> np.ndarray:
    """Scores that are highest at a place, and hardly lower across the origin."""
    away = np.linalg.norm(floor_map.xy_m - xy_m, axis=1)
    mirrored = np.linalg.norm(floor_map.xy_m + xy_m, axis=1)
    scores = level * np.maximum(np.exp(-(away**2)), 0.97 * np.exp(-(mirrored**2)))
    return np.asarray(scores, np.float32)


def walk_vectors(seed: int, known: TrackParameters) -> dict[str, Any]:
    """Steps unheard at first and in between, and in the end where nobody has been."""
    floor_map, draws = known_floor(seed), RecordedDraws(seed)
    tracker = Tracker(floor_map, known, draws)  # type: ignore[arg-type]
    generator = np.random.default_rng(seed + 50)
    path = np.column_stack([floor_map.xy_m, floor_map.heading_rad])[:185:5]
    moves = between(path[:-1], path[1:])
    steps = []
    for k in range(36):
        move = moves[k] + generator.normal(0, [0.1, 0.05, 0.03])
        sigma = np.array([0.25, 0.17, 0.01])
        middle_m = (path[k, :2] + path[k + 1, :2]) / 2
        scores = heard_at(floor_map, middle_m, 0.9 if k < 28 else 0.3)
        if k < 2 or k % 7 == 5:
            scores = np.full_like(scores, np.nan)
        if k in LURED:
            scores = np.full_like(scores, 0.1)
            scores[len(scores) // 2 + k] = 0.95
        suspect = k in DOUBTED
        told_fix = tracker.step(move, sigma, scores, suspect=suspect)
        xy_m, heading_rad, covariance_m2, likeness, status = told_fix
        heard = None if np.isnan(scores[0]) else scores.astype(float).tolist()
        told = np.array([*xy_m, heading_rad, *covariance_m2.ravel()[[0, 1, 3]], likeness])
        steps.append(
            {
                "move": move.tolist(),
                "sigma": sigma.tolist(),
                "scores": heard,
                "suspect": suspect,
                "told": [None if np.isnan(value) else value for value in told.tolist()],
                "status": FixStatus(status).name,
            }
        )
    return {
        "map": as_page(floor_map),
        "parameters": asdict(known),
        "draws": draws.draws,
        "steps": steps,
    }


def as_page(floor_map: FloorMap) -> dict[str, Any]:
    return {
        "xyM": floor_map.xy_m.ravel().tolist(),
        "headingRad": floor_map.heading_rad.tolist(),
        "covarianceM2": floor_map.covariance_m2.reshape(-1, 4)[:, [0, 1, 3]].ravel().tolist(),
    }


def nearest_vectors() -> dict[str, Any]:
    """Nearest points as scipy finds them, with and without a limit of distance."""
    generator = np.random.default_rng(9)
    points = generator.normal(0, 3, (3000, 4)) * [4, 2, 0.3, 0.3]
    asked = generator.normal(0, 4, (200, 4)) * [4, 2, 0.3, 0.3]
    near, rows = cKDTree(points).query(asked, k=5)
    return {
        "points": points.ravel().tolist(),
        "asked": asked.tolist(),
        "rows": rows.tolist(),
        "squares": (near**2).tolist(),
        "within": 1.5,
        "rows_within": [row[far < 1.5].tolist() for row, far in zip(rows, near, strict=True)],
    }


@pytest.fixture(scope="module")
def track_vectors() -> dict[str, Any]:
    known = replace(TrackParameters(), particles=225)
    walks = [walk_vectors(seed, known) for seed in range(2)]
    return {"walks": [*walks, walk_vectors(2, TrackParameters())], "nearest": nearest_vectors()}


@needs_node
def test_the_tracker_is_that_of_the_line(track_vectors: dict[str, Any], tmp_path: Path) -> None:
    agrees_in_node(HERE / "track.test.mjs", track_vectors, tmp_path)


def test_the_walks_meet_every_status(track_vectors: dict[str, Any]) -> None:
    met = {step["status"] for walk in track_vectors["walks"] for step in walk["steps"]}
    assert met == {status.name for status in FixStatus}
    steps = [step for walk in track_vectors["walks"] for step in walk["steps"]]
    assert any(step["status"] == "SUSPECT" and not step["suspect"] for step in steps)
    assert any(len(rows) < 5 for rows in track_vectors["nearest"]["rows_within"])
