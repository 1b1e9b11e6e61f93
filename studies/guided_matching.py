"""What guided matching is worth: maps with closures that a first solution led to, and without.

Beside it stands what came with it, sigmas of closures that fall with their score and are shared
with neighbours. In worlds and by seeds on which neither was chosen.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from elfslam.app.settings import Settings, sense_of
from elfslam.base.enums import Modality
from elfslam.base.values import AnySimilarity, Odometry, Recording, Truth
from elfslam.scoring.errors import AS_DECLARED, score_closures
from elfslam.slam.front_end import apply_acoustic_scale, dead_reckoning_nodes
from elfslam.slam.pipeline import closures_by
from elfslam.stages.closure import ClosureParameters, echo_sequence_similarity
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from elfslam.world.sensors import Sensor
from studies.cached import (
    SimulatedWalk,
    at_its_start,
    extract_echoes,
    extract_features,
    record_of,
    simulated,
)
from studies.mapping import CALIBRATED, trajectory_coverage, walkers
from studies.plain_features import ELF, PLAIN, closing_by, compared_encoders
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, median_aligned_m, per_walk

WORLDS = ("studio", "lounge", "hall", "concourse")
SEEDS = (120, 121, 122, 123)
ROUNDS = 4
EQUAL, WEIGHED, GUIDED = "equal sigmas", "sigmas by score", "guided matching"
ALL_WORLDS = "all worlds"
RATIO = "error over that without guided matching"
FIELD_EVIDENCE = 25.0
"""Nats that a unit of magnetic similarity is worth: logistic regression in development worlds."""


def measure_guided_matching(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Errors and closures by feature and by what was done (the condition).

    Ratios are geometric means, of each world and of all.
    """
    records = per_walk(_measured, context, worlds, seeds, rounds, kind)
    return [_ratio(each) if each.metric == RATIO else each for each in records]


def _ratio(logarithm: Record) -> Record:
    """The ratio, of the mean of its logarithm."""
    low, high = (None if each is None else float(np.exp(each))
                 for each in (logarithm.low, logarithm.high))  # fmt: skip
    return replace(logarithm, value=float(np.exp(logarithm.value)), low=low, high=high)


def _measured(walk: SimulatedWalk) -> list[Record]:
    recording, truth = simulated(walk, sensors=(Sensor.MAGNETIC,))
    recording = at_its_start(recording, truth)
    settings = walkers(walk.seed, kind_named(walk.kind))[CALIBRATED]
    found: list[Record] = []
    for method, nodes, similarity, variants in _methods(recording, settings):
        numbers = {
            name: _numbers(nodes, similarity, replace(settings, closure=closing), truth)
            for name, closing in variants.items()
        }
        found += chain.from_iterable(
            record_of(walk, method, name).each(each) for name, each in numbers.items()
        )
        found += _logarithms(walk, method, numbers)
    return found


def _methods(
    recording: Recording, settings: Settings
) -> Iterator[tuple[str, Odometry, AnySimilarity, Mapping[str, ClosureParameters]]]:
    """What is walked, what is similar, and what is done with it, by method."""
    walked = dead_reckoning_nodes(recording, settings)
    echoes = extract_echoes(recording, settings)
    nodes = apply_acoustic_scale(walked, echoes, settings)
    for feature in (ELF, PLAIN):
        features = extract_features(echoes, compared_encoders()[feature])
        guided = closing_by(feature, settings)
        weighed = replace(guided, most_earned=0.0)
        equal = replace(weighed, sigma_fall=0.0, shared_footsteps=0)
        variants = {EQUAL: equal, WEIGHED: weighed, GUIDED: guided}
        yield feature, nodes, echo_sequence_similarity(features, nodes), variants
    field = sense_of(Modality.MAGNETIC, settings)
    led = replace(
        field.closure, most_earned=settings.closure.most_earned, score_evidence=FIELD_EVIDENCE
    )
    alone = {WEIGHED: field.closure, GUIDED: led}
    yield Modality.MAGNETIC.value, walked, field.similarity_of(recording, walked), alone


def _numbers(
    nodes: Odometry, similarity: AnySimilarity, settings: Settings, truth: Truth
) -> dict[str, float]:
    closures = closures_by(nodes, [(similarity, settings.closure)], settings)
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, settings.graph)
    kept = closures.chosen(trajectory.closure_weights > 0.5)
    score = score_closures(kept, nodes.t_s, truth)
    return {
        MEDIAN_ALIGNED: median_aligned_m(trajectory, truth),
        "precision": score.precision, "recall": score.recall,
        "NEES": trajectory_coverage(trajectory, truth, AS_DECLARED).nees,
    }  # fmt: skip


def _logarithms(
    walk: SimulatedWalk, method: str, numbers: Mapping[str, Mapping[str, float]]
) -> Iterator[Record]:
    """Of a walk's errors over those by weighed closures, for its world and for all."""
    for name in (each for each in numbers if each != WEIGHED):
        of = record_of(walk, method, name)
        ratio = numbers[name][MEDIAN_ALIGNED] / numbers[WEIGHED][MEDIAN_ALIGNED]
        for world in (walk.world, ALL_WORLDS):
            yield replace(of, world=world, metric=RATIO, value=float(np.log(ratio)))


STUDY = Study(
    "What does guided matching add to maps, in worlds for development?",
    measure_guided_matching, minutes=10, long=True, scenarios=("people", "surveyor"),
    fast={"worlds": ("studio",), "seeds": (120,), "rounds": 2},
)  # fmt: skip
