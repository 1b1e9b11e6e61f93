"""The walk that grows in the page, in node: its graph and its closures are those of the line."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.geometry import compose
from elfslam.base.values import Closures, MeanSimilarity, Odometry
from elfslam.stages.closure import BACK, ClosureParameters, candidates
from elfslam.stages.feature import attenuation_of
from elfslam.stages.graph import GraphParameters, build_graph, optimise
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent
LAP = 40
SIGMA = np.array([0.08, 0.04, 0.03])
CLOSING_SIGMA = np.array([0.2, 0.28, 0.28])
AS_STATED = GraphParameters(robust=False, noise_rounds=0)


def two_laps(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Moves (2n, 3) of two laps round a square as they were, and as they were measured."""
    generator = np.random.default_rng(seed)
    turn = np.where(np.arange(2 * LAP) % 10 == 9, np.pi / 2, 0.0)
    true = np.column_stack([np.full(2 * LAP, 0.7), np.zeros(2 * LAP), turn])
    return true, true + generator.normal(0, SIGMA, true.shape)


def chained(moves: np.ndarray) -> np.ndarray:
    poses = [np.zeros(3)]
    for move in moves:
        poses.append(compose(poses[-1][None], move[None])[0])
    return np.array(poses)


def graph_vectors(seed: int) -> dict[str, Any]:
    """A walk with closures one lap apart, and where the line's graph puts its footsteps."""
    true, measured = two_laps(seed)
    nodes = Odometry(np.arange(2 * LAP + 1.0), chained(measured), np.tile(SIGMA, (2 * LAP, 1)))
    i = np.arange(4, LAP, 5)
    count = len(i)
    generator = np.random.default_rng(seed + 1)
    i_from_j = generator.normal(0, CLOSING_SIGMA / 2, (count, 3))
    covariance = np.tile(np.diag(CLOSING_SIGMA**2), (count, 1, 1))
    closures = Closures(i, i + LAP, np.ones(count), i_from_j, covariance)
    solved = optimise(build_graph(nodes, closures), nodes.t_s, AS_STATED)
    return {
        "moves": measured.tolist(),
        "sigma": SIGMA.tolist(),
        "closures": [
            {"i": int(a), "j": int(a) + LAP, "iFromJ": pose.tolist(), "sigma": list(CLOSING_SIGMA)}
            for a, pose in zip(i, i_from_j, strict=True)
        ],
        "solved": solved.world_from_body.ravel().tolist(),
        "reckoned": nodes.world_from_body.ravel().tolist(),
        "true": chained(true).ravel().tolist(),
    }


def heard_on(ways: list[tuple[int, int]], seed: int) -> np.ndarray:
    """What is heard on each of some stretches, from a place to another, on a line of places."""
    generator = np.random.default_rng(seed)
    places = generator.normal(0, 1, (80, 32))
    smooth = places + np.roll(places, 1, axis=0)
    rows = [
        smooth[each]
        for first, last in ways
        for each in range(first, last, 1 if last > first else -1)
    ]
    noisy = np.array(rows) + generator.normal(0, 0.35, (len(rows), 32))
    return np.asarray(noisy / np.linalg.norm(noisy, axis=1)[:, None], dtype=np.float32)


SIGNAL_TOO_DB = {0.5: 9.635, 3.0: 3.021, 10.0: 0.458, 30.0: 0.004}
"""Echoes and noise over noise (dB), as the phone's check measures, are so much more than echoes."""


def closure_vectors() -> dict[str, Any]:
    """Two laps and one walked back, and the candidates that the line finds in them."""
    means = heard_on([(0, 60), (0, 60), (60, 0)], 3)
    parameters = replace(ClosureParameters(), threshold=0.45, back_margin=0.05)
    found = candidates(MeanSimilarity(means, kind="planted"), parameters)
    return {
        "means": means.tolist(),
        "attenuated": {
            str(db): attenuation_of(db - SIGNAL_TOO_DB[db]) ** 2 for db in SIGNAL_TOO_DB
        },
        "parameters": asdict(parameters),
        "candidates": [
            {"i": int(i), "j": int(j), "score": float(score), "isBack": bool(way == BACK)}
            for i, j, score, way in zip(found.i, found.j, found.score, found.direction, strict=True)
        ],
    }


@needs_node
def test_graph_and_closures_are_those_of_the_line(tmp_path: Path) -> None:
    vectors = {"walks": [graph_vectors(seed) for seed in (1, 2, 3)], **closure_vectors()}
    file = tmp_path / "growing.json"
    file.write_text(json.dumps(vectors))
    passed_in_node(HERE / "growing.test.mjs", ELFSLAM_VECTORS=file)
