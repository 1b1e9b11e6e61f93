"""From which score loops are closed, for every feature: maps of development worlds by threshold.

A threshold that suits one feature closes nothing by another. Each gets the one at which the maps of
surveyors and of pedestrians are best on the whole, as a share of what dead reckoning errs.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.values import NO_CLOSURES, Closures, Odometry, Truth
from elfslam.scoring.errors import score_closures
from elfslam.slam.front_end import apply_acoustic_scale, dead_reckoning_nodes
from elfslam.slam.pipeline import closures_by
from elfslam.stages.closure import echo_sequence_similarity
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.kinds import PEOPLE, SURVEYOR, kind_named
from studies.cached import (
    SCENARIOS,
    SimulatedWalk,
    at_its_start,
    extract_echoes,
    extract_features,
    simulated,
)
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import compared_encoders
from studies.results import Record, averaged, seeds_text
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, finished, median_aligned_m

WORLDS = ("studio", "lounge", "concourse")
"""For development; nothing is reported in them."""
SEEDS = (100, 101, 102)
ROUNDS = 4
THRESHOLDS = (0.05, 0.07, 0.1, 0.12, 0.15, 0.18, 0.2, 0.22, 0.25, 0.3, 0.35, 0.4)
RATIO, BEST = "error over dead reckoning's", "best threshold"


def measure_thresholds(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    thresholds: Sequence[float] = THRESHOLDS,
) -> list[Record]:
    """By feature and threshold (the condition): the ratio over all walks, errors and closures."""
    tasks = [
        SimulatedWalk(world, seed, rounds, kind.name)
        for world in worlds
        for kind in (SURVEYOR, PEOPLE)
        for seed in seeds
    ]
    walks = finished(partial(_measured, thresholds=tuple(thresholds)), tasks, context)
    told = [[each for each in walk if each.metric != RATIO] for walk in walks]
    return [*_ratios(walks, seeds), *averaged(told, seeds)]


def _measured(walk: SimulatedWalk, thresholds: Sequence[float]) -> list[Record]:
    kind = kind_named(walk.kind)
    recording, truth = simulated(walk)
    known = walkers(walk.seed, kind)[CALIBRATED]
    echoes = extract_echoes(recording, Settings())
    nodes = apply_acoustic_scale(
        dead_reckoning_nodes(at_its_start(recording, truth), known), echoes, known
    )
    reckoned_m = _median_m(nodes, NO_CLOSURES, truth, known)
    found: list[Record] = []
    for feature, encoder in compared_encoders().items():
        similarity = echo_sequence_similarity(extract_features(echoes, encoder), nodes)
        for threshold in thresholds:
            strict = replace(known.closure, threshold=threshold)
            closures = closures_by(nodes, [(similarity, strict)], known)
            score = score_closures(closures, nodes.t_s, truth)
            mapped_m = _median_m(nodes, closures, truth, known)
            numbers = {
                RATIO: mapped_m / reckoned_m, MEDIAN_ALIGNED: mapped_m,
                "closures": float(len(closures.i)), "precision of closures": score.precision,
            }  # fmt: skip
            of = Record(feature, scenario=SCENARIOS[walk.kind], condition=f"{threshold:g}")
            found += of.each(numbers)
    return found


def _median_m(nodes: Odometry, closures: Closures, truth: Truth, known: Settings) -> float:
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, known.graph)
    return median_aligned_m(trajectory, truth)


def _ratios(walks: Sequence[Sequence[Record]], seeds: Sequence[int]) -> list[Record]:
    """Geometric means of the ratios over all walks, and each feature's best threshold by them."""
    logs: dict[tuple[str, str], list[float]] = {}
    for each in (record for walk in walks for record in walk if record.metric == RATIO):
        logs.setdefault((each.method, each.condition), []).append(float(np.log(each.value)))
    told = seeds_text(seeds)
    means = [
        Record(feature, RATIO, float(np.exp(np.mean(some))), condition=threshold, seeds=told)
        for (feature, threshold), some in logs.items()
    ]
    best = {
        feature: min((each for each in means if each.method == feature), key=lambda e: e.value)
        for feature in dict.fromkeys(each.method for each in means)
    }
    return means + [
        Record(feature, BEST, float(each.condition), seeds=told) for feature, each in best.items()
    ]


STUDY = Study(
    "From which score does each feature close loops best, in worlds for development?",
    measure_thresholds, minutes=2, long=True,
    fast={"worlds": ("studio",), "seeds": (100,), "rounds": 2,
          "thresholds": (0.1, 0.22)},
)  # fmt: skip
