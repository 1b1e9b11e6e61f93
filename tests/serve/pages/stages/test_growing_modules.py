"""Graphs, closures, floors and ways of the page in node: those of the pipeline in Python."""

from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.building import Passage
from elfslam.base.geometry import compose
from elfslam.base.values import Closures, LevelPassage, MeanSimilarity, Odometry
from elfslam.slam.floor_location import floors_by_vote
from elfslam.stages.closure import BACK, ClosureParameters, candidates
from elfslam.stages.feature import SUCCESSIVE, attenuation_of
from elfslam.stages.graph import GraphParameters, build_graph, optimise
from elfslam.stages.levels import LevelParameters
from elfslam.stages.ways import LevelPosition, Route, way, way_graph
from tests.in_node import agrees_in_node, needs_node

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


def attenuated(db: float, noise: float, seed: int) -> dict[str, Any]:
    """Cosines of successive echoes of a walk amid noise, and what Python makes of them."""
    generator = np.random.default_rng(seed)
    places = np.repeat(generator.normal(0, 1, (20, 32)), 4, axis=0)
    noisy = places + noise * generator.normal(0, 1, places.shape)
    vectors = np.float32(noisy / np.linalg.norm(noisy, axis=1)[:, None])
    alike = np.sum(vectors[1:] * vectors[:-1], axis=1)
    attenuation = attenuation_of(vectors, db - SIGNAL_TOO_DB[db], SUCCESSIVE)
    return {"echoDb": db, "alike": alike.tolist(), "attenuation": attenuation}


def closure_vectors() -> dict[str, Any]:
    """Two laps and one walked back, and the candidates that the line finds in them."""
    means = heard_on([(0, 60), (0, 60), (60, 0)], 3)
    parameters = replace(ClosureParameters(), threshold=0.45, back_margin=0.05)
    found = candidates(MeanSimilarity(means, kind="planted"), parameters)
    return {
        "means": means.tolist(),
        "attenuated": [
            attenuated(db, noise, seed)
            for seed, (db, noise) in enumerate(product(SIGNAL_TOO_DB, (0.5, 1.5, 2.2, 6.0)))
        ],
        "parameters": asdict(parameters),
        "candidates": [
            {"i": int(i), "j": int(j), "score": float(score), "isBack": bool(way == BACK)}
            for i, j, score, way in zip(found.i, found.j, found.score, found.direction, strict=True)
        ],
    }


@needs_node
def test_graph_and_closures_are_those_of_the_line(tmp_path: Path) -> None:
    vectors = {"walks": [graph_vectors(seed) for seed in (1, 2, 3)], **closure_vectors()}
    agrees_in_node(HERE / "growing.test.mjs", vectors, tmp_path)


EVERY_S = 0.5
"""Half a span is a whole number of these."""


def scene(seed: int, levels: list[int], parameters: LevelParameters) -> dict[str, Any]:
    """Scores of a walk that changes floors now and then, with silence, and what Python votes."""
    generator = np.random.default_rng(seed)
    t_s = EVERY_S * np.arange(400)
    scores = generator.uniform(0.2, 0.4, (len(t_s), len(levels)))
    stays = np.repeat(generator.integers(0, len(levels), 5), len(t_s) // 5)
    scores[np.arange(len(t_s)), stays] += generator.uniform(-0.1, 0.2, len(t_s))
    scores[generator.random(len(t_s)) < 0.1] = np.nan
    scores[160:240] = np.nan
    level, sure = floors_by_vote(t_s, scores, levels, None, parameters)
    return {
        "levels": levels,
        "parameters": {name: asdict(parameters)[name] for name in ("vote_s", "least_lead")},
        "t_s": t_s.tolist(),
        "scores": [[None if np.isnan(each) else each for each in row] for row in scores.tolist()],
        "level": level.tolist(),
        "sure": sure.tolist(),
    }


@needs_node
def test_the_vote_is_that_of_python(tmp_path: Path) -> None:
    known = LevelParameters()
    scenes = [scene(seed, [-1, 0, 1, 2], known) for seed in range(3)]
    scenes += [scene(3, [0, 3], LevelParameters(vote_s=7.0, least_lead=0.1)), scene(4, [2], known)]
    told = {
        (each, sure)
        for one in scenes[:3]
        for each, sure in zip(one["level"], one["sure"], strict=True)
    }
    assert {sure for _, sure in told} == {True, False}
    assert len({each for each, sure in told if sure}) > 2
    agrees_in_node(HERE / "floor_location.test.mjs", scenes, tmp_path)


def building_vectors(seed: int) -> dict[str, Any]:
    """Three floors of random ground, an island on one, passages of every kind, and their ways."""
    generator = np.random.default_rng(seed)
    ground = {level: generator.uniform(-4, 6, (700, 2)) for level in (-1, 0, 1)}
    ground[1] = np.vstack([ground[1], generator.uniform(20, 22, (60, 2))])
    ends = [(a, b) for a, b in generator.uniform(-5, 7, (8, 2)).tolist()]
    joined = zip(
        (LevelPassage.STAIRS, LevelPassage.LIFT, LevelPassage.ESCALATOR, LevelPassage.ESCALATOR),
        ((-1, 0), (-1, 1), (0, 1), (1, 0)),
        ends[::2],
        ends[1::2],
        strict=True,
    )
    passages = [Passage(kind, *levels, a, b, 9.5) for kind, levels, a, b in joined]
    graph, asked = way_graph(ground, passages), []
    for row in generator.uniform(-5, 7, (40, 4)).tolist():
        start, goal = (
            LevelPosition(int(level), (x, y))
            for level, x, y in zip(generator.integers(-1, 2, 2), row[::2], row[1::2], strict=True)
        )
        asked.append((start, goal))
    asked.append((LevelPosition(0, (0.0, 0.0)), LevelPosition(1, (21.0, 21.0))))
    asked.append((LevelPosition(0, (0.0, 0.0)), LevelPosition(0, (0.3, 0.4))))
    return {
        "floors": [{"level": k, "points": xy_m.tolist()} for k, xy_m in ground.items()],
        "passages": [asdict(each) for each in passages],
        "asked": [
            {"start": asdict(one), "goal": asdict(other), "wanted": told(way(graph, one, other))}
            for one, other in asked
        ],
    }


def told(route: Route | None) -> dict[str, Any] | None:
    if route is None:
        return None
    legs = [
        {"level": each.level, "xy_m": each.xy_m.tolist(), "leaves_by": each.leaves_by}
        for each in route.legs
    ]
    return {"length_m": route.length_m, "duration_s": route.duration_s, "legs": legs}


@needs_node
def test_ways_are_those_of_python(tmp_path: Path) -> None:
    vectors = building_vectors(7)
    wanted = [each["wanted"] for each in vectors["asked"]]
    assert wanted[-2] is None, "nobody walked to the island"
    assert {len(each["legs"]) for each in wanted if each} >= {1, 2}
    agrees_in_node(HERE / "ways.test.mjs", vectors, tmp_path)
