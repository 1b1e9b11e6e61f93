"""Closures step by step: how right and how complete they are, and what maps they give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import I64
from elfslam.base.drift import Drift
from elfslam.base.values import AnySimilarity, Closures, Odometry, Truth
from elfslam.line.closure import candidates, find_closures, possible
from elfslam.line.feature import extract_features, load_encoder
from elfslam.line.graph import build_graph, optimise
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.scoring.closure_score import score_closures
from elfslam.scoring.errors import Alignment, position_errors, summarise
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.front_end import hear, walk_nodes, with_heard_steps
from elfslam.slam.parameters import Parameters
from elfslam.world.kinds import PEOPLE, Kind
from studies.curation import CurationParameters, curated_closures, pairs_on_lines
from studies.figures.dots import Dot, dots_by, dots_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_interval, mean_of
from studies.repeats import Numbers, by_world, finished
from studies.simulated_walk import SimulatedWalk, simulated

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(5))
ROUNDS = 4
SINGLE = "single pairs"
PAPER, SEQUENCE = "paper's curation", "sequences"
MEASURES = ("pairs", "precision", "recall", "map (m)", "map, all believed (m)")
PAIR_SIGMA = np.array([0.2, 0.28, 0.28])


def measure_closure_steps(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> Finding:
    """Precision and recall after each step of both strategies.

    Maps are made of what a strategy ends with, and of single pairs without any; once by the graph
    that may doubt closures and once by plain least squares, which believes all.
    """
    tasks = [SimulatedWalk(world, seed, rounds, kind.name) for world in worlds for seed in seeds]
    numbers = finished(_measured, tasks, given)
    rows = [
        {"world": world, "strategy": strategy, "step": step, **_row(found, strategy, step)}
        for world, found in by_world(tasks, numbers).items()
        for strategy, step in _in_order(found[0])
    ]
    return Finding(rows, _page(rows))


def _measured(walk: SimulatedWalk) -> Numbers:
    recording, truth = simulated(walk)
    parameters = Parameters()
    echoes = hear(recording, parameters)
    nodes = with_heard_steps(walk_nodes(recording, parameters), echoes, parameters)
    features = extract_features(echoes, load_encoder("compact"))
    similarity = echo_sequence_similarity(features, nodes)
    numbers: Numbers = {}
    for (strategy, step), closures in _steps(similarity, nodes, parameters).items():
        score = score_closures(closures, nodes.t_s, truth)
        found = {"pairs": float(score.count), "precision": score.precision, "recall": score.recall}
        numbers |= {f"{strategy}|{step}|{name}": value for name, value in found.items()}
    for strategy, closures in _ends(similarity, nodes, parameters).items():
        numbers |= _maps(strategy, closures, nodes, truth, parameters)
    return numbers


def _steps(
    similarity: AnySimilarity, nodes: Odometry, parameters: Parameters
) -> Mapping[tuple[str, str], Closures]:
    """What is left after each step, by strategy and step."""
    curation = _curation(parameters)
    on_lines = pairs_on_lines(similarity.scores, curation)
    curated = curated_closures(similarity, nodes, curation)
    ridges = candidates(similarity, parameters.closure)
    allowed = ridges.chosen(possible(ridges, Drift(nodes), parameters.closure))
    best = _best_pairs(similarity, parameters)
    return {
        (SINGLE, "best of each footstep"): best,
        (PAPER, "on a line in its slice"): _pairs(*np.sort(on_lines[:, :2].astype(int)).T),
        (PAPER, "mirrored, one per line"): curated,
        (SEQUENCE, "ridges"): _pairs(ridges.i, ridges.j),
        (SEQUENCE, "allowed by dead reckoning"): _pairs(allowed.i, allowed.j),
        (SEQUENCE, "without rivals"): find_closures(similarity, nodes, parameters.closure),
    }


def _ends(
    similarity: AnySimilarity, nodes: Odometry, parameters: Parameters
) -> Mapping[str, Closures]:
    return {
        SINGLE: _best_pairs(similarity, parameters),
        PAPER: curated_closures(similarity, nodes, _curation(parameters)),
        SEQUENCE: find_closures(similarity, nodes, parameters.closure),
    }


def _curation(parameters: Parameters) -> CurationParameters:
    """The paper's, from the likeness at which our features may be of one place."""
    return replace(CurationParameters(), threshold=parameters.closure.threshold)


def _maps(
    strategy: str, closures: Closures, nodes: Odometry, truth: Truth, parameters: Parameters
) -> Numbers:
    """The last step, by the graph, and the map errors of both graphs."""
    doubting = optimise(build_graph(nodes, closures), nodes.t_s, parameters.graph)
    plain = replace(parameters.graph, robust=False)
    believing = optimise(build_graph(nodes, closures), nodes.t_s, plain)
    believed = closures.chosen(doubting.closure_weights > 0.5)
    score = score_closures(believed, nodes.t_s, truth)
    found = {"pairs": float(score.count), "precision": score.precision, "recall": score.recall}
    for name, each in (("map (m)", doubting), ("map, all believed (m)", believing)):
        errors = position_errors(each.t_s, each.world_from_body, truth, Alignment.ALIGNED)
        found[name] = summarise(errors).median_m
    return {f"{strategy}|believed by the graph|{name}": value for name, value in found.items()}


def _best_pairs(similarity: AnySimilarity, parameters: Parameters) -> Closures:
    """Each footstep with the one most like it, where that is like enough and not near in time."""
    scores = similarity.scores.copy()
    index = np.arange(len(scores))
    scores[np.abs(index[:, None] - index) < parameters.closure.near_footsteps] = -1.0
    partner = scores.argmax(axis=1)
    alike = scores[index, partner] >= parameters.closure.threshold
    pairs = np.unique(np.sort(np.column_stack([index, partner])[alike]), axis=0)
    return _pairs(*pairs.T)


def _pairs(i: I64, j: I64) -> Closures:
    """Pairs as closures that say: the same place, walked the same way."""
    count = len(i)
    covariance = np.tile(np.diag(PAIR_SIGMA**2), (count, 1, 1))
    return Closures(i, j, np.ones(count), np.zeros((count, 3)), covariance)


def _in_order(numbers: Numbers) -> list[tuple[str, str]]:
    """Strategies and their steps, strategy by strategy."""
    named = dict.fromkeys((key.split("|")[0], key.split("|")[1]) for key in numbers)
    return sorted(named, key=lambda pair: (SINGLE, PAPER, SEQUENCE).index(pair[0]))


def _row(walks: Sequence[Numbers], strategy: str, step: str) -> Row:
    row: Row = {}
    for name in MEASURES:
        values = [numbers.get(f"{strategy}|{step}|{name}", np.nan) for numbers in walks]
        known = [value for value in values if np.isfinite(value)]
        row[name] = mean_of(known)
        if known:
            row[f"{name}, from"], row[f"{name}, to"] = mean_interval(known)
    row["walks"] = len(walks)
    return row


def _page(rows: Sequence[Row]) -> Page:
    panels = [
        Panel(
            f"{name.capitalize()} after each step",
            dots_figure(_dots(rows, name), name, ""),
            NOTES[name],
            wide=True,
        )
        for name in ("precision", "recall")
    ]
    shown = [{name: row[name] for name in ("world", "strategy", "step", *MEASURES)} for row in rows]
    panels.append(Panel("The steps", rows_table(shown), wide=True))
    return Page("Closures, step by step", "simulated walks, the shipped encoder", panels)


NOTES = {
    "precision": "Share of pairs whose ends truly lie within 1 m. Lines are 95 % over walks.",
    "recall": "Share of the footsteps that come back to a place and end a right closure.",
}


def _dots(rows: Sequence[Row], name: str) -> dict[str, list[Dot]]:
    return dots_by(
        lambda row: str(row["world"]), lambda row: f"{row['strategy']}: {row['step']}",
        rows, name, f"{name}, from", f"{name}, to",
    )  # fmt: skip
