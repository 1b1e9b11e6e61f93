"""Loop closures step by step: precision and recall after each, and the maps that they make."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import I64
from elfslam.base.values import AnySimilarity, Closures, Odometry, Truth
from elfslam.scoring.errors import Alignment, position_errors, score_closures, summarise
from elfslam.slam.front_end import apply_acoustic_scale, dead_reckoning_nodes
from elfslam.stages.closure import (
    Drift,
    candidates,
    echo_sequence_similarity,
    find_closures,
    within_gate,
)
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.kinds import PEOPLE, Kind
from studies.cached import (
    SimulatedWalk,
    extract_echoes,
    extract_features,
    record_of,
    shipped,
    simulated,
)
from studies.curation import CurationParameters, curated_closures, pairs_on_lines
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, per_walk

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(5))
ROUNDS = 4
NEAREST, PAPER, SEQUENCE = "nearest neighbours", "paper's curation", "sequences"
ACCEPTED = "accepted by the graph"
MEDIAN_BELIEVED = "median error, every closure accepted (m)"
PAIR_SIGMA = np.array([0.2, 0.28, 0.28])


def measure_closures(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Precision and recall after each step (the condition) of three strategies.

    Maps are made of what a strategy ends with: by the graph that may reject closures, and by plain
    least squares, which accepts all.
    """
    return per_walk(_measured, context, worlds, seeds, rounds, kind)


def _measured(walk: SimulatedWalk) -> list[Record]:
    recording, truth = simulated(walk)
    settings = Settings()
    echoes = extract_echoes(recording, settings)
    nodes = apply_acoustic_scale(dead_reckoning_nodes(recording, settings), echoes, settings)
    features = extract_features(echoes, shipped())
    similarity = echo_sequence_similarity(features, nodes)
    found: list[Record] = []
    for strategy, step, closures, last in _steps(similarity, nodes, settings):
        found += _scored(record_of(walk, strategy, step), closures, nodes, truth)
        if last:
            accepted = record_of(walk, strategy, ACCEPTED)
            found += _mapped(accepted, closures, nodes, truth, settings)
    return found


def _steps(
    similarity: AnySimilarity, nodes: Odometry, settings: Settings
) -> Iterator[tuple[str, str, Closures, bool]]:
    """Strategy, step, what is left after it, and whether it is the last before the graph."""
    yield NEAREST, "best of each footstep", _nearest(similarity, settings), True
    curation = replace(CurationParameters(), threshold=settings.closure.threshold)
    on_lines = np.sort(pairs_on_lines(similarity.scores, curation)[:, :2].astype(int))
    yield PAPER, "on a line in its slice", _pairs(*on_lines.T), False
    curated = curated_closures(similarity, nodes, curation)
    yield PAPER, "symmetric, one per line", curated, True
    ridges = candidates(similarity, settings.closure)
    yield SEQUENCE, "ridges", _pairs(ridges.i, ridges.j), False
    gated = ridges.chosen(within_gate(ridges, Drift(nodes), settings.closure))
    yield SEQUENCE, "within the gate", _pairs(gated.i, gated.j), False
    closures = find_closures(similarity, nodes, settings.closure)
    yield SEQUENCE, "ratio test passed", closures, True


def _scored(of: Record, closures: Closures, nodes: Odometry, truth: Truth) -> list[Record]:
    score = score_closures(closures, nodes.t_s, truth)
    return of.each({"precision": score.precision, "recall": score.recall})


def _mapped(
    of: Record, closures: Closures, nodes: Odometry, truth: Truth, settings: Settings
) -> list[Record]:
    """What the graph accepts of the closures, and the errors of both maps."""
    graph, plain = build_graph(nodes, closures), replace(settings.graph, robust=False)
    doubting, believing = (optimise(graph, nodes.t_s, each) for each in (settings.graph, plain))
    found = _scored(of, closures.chosen(doubting.closure_weights > 0.5), nodes, truth)
    for metric, each in ((MEDIAN_ALIGNED, doubting), (MEDIAN_BELIEVED, believing)):
        errors = position_errors(each.t_s, each.world_from_body, truth, Alignment.ALIGNED)
        found.append(replace(of, metric=metric, value=summarise(errors).median_m))
    return found


def _nearest(similarity: AnySimilarity, settings: Settings) -> Closures:
    """Each footstep with the one most like it, where that is like enough and not near in time."""
    scores = similarity.scores.copy()
    index = np.arange(len(scores))
    scores[np.abs(index[:, None] - index) < settings.closure.near_footsteps] = -1.0
    partner = scores.argmax(axis=1)
    alike = scores[index, partner] >= settings.closure.threshold
    pairs = np.unique(np.sort(np.column_stack([index, partner])[alike]), axis=0)
    return _pairs(*pairs.T)


def _pairs(i: I64, j: I64) -> Closures:
    """Pairs as closures that say: the same place, walked the same way."""
    count = len(i)
    covariance = np.tile(np.diag(PAIR_SIGMA**2), (count, 1, 1))
    return Closures(i, j, np.ones(count), np.zeros((count, 3)), covariance)


STUDY = Study(
    "How right and how complete are loop closures after each step that curates them?",
    measure_closures, minutes=5, scenarios=("people",), long=True, needs=("sklearn",),
    fast={"worlds": ("studio",), "seeds": (100,), "rounds": 2},
)  # fmt: skip
