"""From which likeness loops are closed, for every feature: maps of development worlds by threshold.

A threshold that suits one feature closes nothing by another. Each gets the one at which the maps of
surveyors and of people are best on the whole, as a share of what dead reckoning errs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.values import NO_CLOSURES, Closures, Odometry, Truth
from elfslam.line.feature import extract_features
from elfslam.line.graph import build_graph, optimise
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.scoring.closure_score import score_closures
from elfslam.slam.front_end import hear, walk_nodes, with_heard_steps
from elfslam.slam.pipeline import closures_by
from elfslam.world.kinds import PEOPLE, SURVEYOR, kind_named
from studies.finding import Finding, Given, Row
from studies.located import at_its_start
from studies.mapping import CALIBRATED, trajectory_errors, walkers
from studies.plain_features import compared_encoders
from studies.repeats import Numbers, finished
from studies.simulated_walk import SimulatedWalk, simulated

WORLDS = ("studio", "lounge", "concourse")
"""For development; nothing is reported in them."""
SEEDS = (100, 101, 102)
ROUNDS = 4
THRESHOLDS = (0.05, 0.07, 0.1, 0.12, 0.15, 0.18, 0.2, 0.22, 0.25, 0.3, 0.35, 0.4)


def measure_thresholds(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
) -> Finding:
    """A row per feature and threshold: error over dead reckoning's, closures."""
    tasks = [
        SimulatedWalk(world, seed, rounds, kind.name)
        for world in worlds
        for kind in (SURVEYOR, PEOPLE)
        for seed in seeds
    ]
    numbers = finished(_measured, tasks, given)
    return Finding(_rows(tasks, numbers))


def _measured(walk: SimulatedWalk) -> Numbers:
    kind = kind_named(walk.kind)
    recording, truth = simulated(walk)
    known = walkers(walk.seed, kind)[CALIBRATED]
    echoes = hear(recording, Settings())
    nodes = with_heard_steps(walk_nodes(at_its_start(recording, truth), known), echoes, known)
    numbers = {"reckoned": _median_m(nodes, NO_CLOSURES, truth, known)}
    for feature, encoder in compared_encoders().items():
        alike = echo_sequence_similarity(extract_features(echoes, encoder), nodes)
        for threshold in THRESHOLDS:
            strict = replace(known.closure, threshold=threshold)
            closures = closures_by(nodes, [(alike, strict)], known)
            score = score_closures(closures, nodes.t_s, truth)
            key = f"{feature}|{threshold:g}"
            numbers[f"{key}|mapped"] = _median_m(nodes, closures, truth, known)
            numbers[f"{key}|closures"] = float(len(closures.i))
            numbers[f"{key}|right"] = float(score.right.sum())
    return numbers


def _median_m(nodes: Odometry, closures: Closures, truth: Truth, known: Settings) -> float:
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, known.graph)
    return trajectory_errors(trajectory, truth)[MEDIAN_ALIGNED]


def _rows(tasks: Sequence[SimulatedWalk], numbers: Sequence[Numbers]) -> list[Row]:
    """The best threshold of a feature has the least geometric mean of shares over all walks."""
    keys = dict.fromkeys(key.rsplit("|", 1)[0] for key in numbers[0] if "|" in key)
    shares = {
        key: float(np.exp(np.mean([np.log(n[f"{key}|mapped"] / n["reckoned"]) for n in numbers])))
        for key in keys
    }
    rows: list[Row] = []
    for key in keys:
        feature, threshold = key.split("|")
        best = min(share for other, share in shares.items() if other.startswith(f"{feature}|"))
        rows.append(
            {
                "feature": feature,
                "threshold": float(threshold),
                "map over dead reckoning": round(shares[key], 3),
                "best": "<-" if shares[key] == best else "",
                **_by_kind(tasks, numbers, key),
            }
        )
    return rows


def _by_kind(
    tasks: Sequence[SimulatedWalk], numbers: Sequence[Numbers], key: str
) -> Mapping[str, object]:
    """Mean map error (m), closures a walk and the share of them that are right."""
    found: Row = {}
    for kind in dict.fromkeys(task.kind for task in tasks):
        some = [n for task, n in zip(tasks, numbers, strict=True) if task.kind == kind]
        closures, right = (sum(n[f"{key}|{what}"] for n in some) for what in ("closures", "right"))
        found[f"{kind} (m)"] = round(float(np.mean([n[f"{key}|mapped"] for n in some])), 2)
        found[f"{kind}: closures"] = round(closures / len(some), 1)
        found[f"{kind}: right"] = round(right / closures, 3) if closures else None
    return found
