"""Acoustic odometry: is a walk of better scale when the echoes say how long the steps are?"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.geometry import path_length_m
from elfslam.base.values import Chirp, Echoes, Features, Odometry, Truth
from elfslam.scoring.errors import interval, match
from elfslam.slam.front_end import dead_reckoning_nodes
from elfslam.stages.acoustic_odometry import (
    AcousticOdometryParameters,
    ScaleEstimate,
    measure_scale,
    rescaled,
    with_prior,
)
from elfslam.stages.chirp import make_chirp
from elfslam.stages.closure import echo_sequence_similarity, find_closures
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.kinds import PEOPLE, Kind
from studies.cached import (
    SCENARIOS,
    SimulatedWalk,
    extract_echoes,
    extract_features,
    shipped,
    simulated,
)
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext, finished, median_aligned_m

SEEDS = {
    "studio": range(110, 120),
    "lounge": range(110, 120),
    "concourse": range(110, 120),
    "living_room": range(10),
    "office": range(10),
    "mall": range(10),
}
"""The first three worlds are those of development, but these walks in them were not looked at."""
ROUNDS = 4
PEOPLE_SIGMA = 0.06
"""How far true and claimed steps of people are apart without sound."""
CLAIMED, MEASURED, TRUE = "claimed steps", "steps by echoes", "true steps"
SCALE, SIGMA, MAP = "scale", "sigma", "median error, aligned (m)"
ALL = "all"

WALKS = tuple(
    SimulatedWalk(world, seed, ROUNDS) for world, seeds in SEEDS.items() for seed in seeds
)


@dataclass(frozen=True, eq=False)
class HeardWalk:
    """What the pipeline has of a walk, and the truth."""

    nodes: Odometry
    echoes: Echoes
    chirp: Chirp
    truth: Truth


def measure_acoustic_odometry(
    context: StudyContext, *, walks: Sequence[SimulatedWalk] = WALKS, kind: Kind = PEOPLE
) -> list[Record]:
    """Errors of scale and of the map by world, with steps as claimed, by echoes, and as true."""
    walks = [replace(walk, kind=kind.name) for walk in walks]
    found = finished(measure_walk, walks, context)
    records: list[Record] = []
    for world in (*dict.fromkeys(walk.world for walk in walks), ALL):
        of = [k for k, walk in enumerate(walks) if world in (walk.world, ALL)]
        seeds = "" if world == ALL else seeds_text([walks[k].seed for k in of])
        head = Record("", world=world, scenario=SCENARIOS[kind.name], seeds=seeds)
        records += summarised([found[k] for k in of], head)
    return records


def measure_walk(walk: SimulatedWalk) -> list[Record]:
    """Scale of a walk and error of its map, with steps as claimed, by echoes, and as true.

    What the sound alone says has a sigma; it is infinite where the sound was refused.
    """
    heard = hear_walk(walk)
    true = true_scale(heard.nodes, heard.truth)
    found = measure_scale(heard.echoes, heard.nodes, heard.chirp, AcousticOdometryParameters())
    scales = {CLAIMED: 1.0, MEASURED: with_prior(found, PEOPLE_SIGMA).scale, TRUE: true}
    features = extract_features(heard.echoes, shipped())
    return [
        Record("sound alone", SCALE, found.scale),
        Record("sound alone", SIGMA, found.sigma),
        *(Record(name, SCALE, scale) for name, scale in scales.items()),
        *(
            Record(name, MAP, _map_error_m(heard, features, ScaleEstimate(scale, 0.0)))
            for name, scale in scales.items()
        ),
    ]


def hear_walk(walk: SimulatedWalk) -> HeardWalk:
    """A walk as the pipeline has it."""
    recording, truth = simulated(walk)
    assert recording.audio is not None
    settings = Settings()
    chirp = make_chirp(settings.chirp, recording.audio.rate_hz)
    nodes = dead_reckoning_nodes(recording, settings)
    return HeardWalk(nodes, extract_echoes(recording, settings), chirp, truth)


def true_scale(nodes: Odometry, truth: Truth) -> float:
    """True over claimed length of a walk, both from footstep to footstep."""
    matched = match(nodes.t_s, nodes.world_from_body, truth)
    return path_length_m(matched.truth[:, :2]) / path_length_m(matched.estimate[:, :2])


def _map_error_m(heard: HeardWalk, features: Features, estimate: ScaleEstimate) -> float:
    """Median aligned error of the map from steps of this scale."""
    nodes, settings = rescaled(heard.nodes, estimate), Settings()
    closures = find_closures(echo_sequence_similarity(features, nodes), nodes, settings.closure)
    made = optimise(build_graph(nodes, closures), nodes.t_s, settings.graph)
    return median_aligned_m(made, heard.truth)


def summarised(walks: Sequence[Sequence[Record]], of: Record) -> Iterator[Record]:
    """What walks have in common: errors of scale (rms) and maps (median), refusals, NEES."""
    values: dict[tuple[str, str], F64] = {
        (each.method, each.metric): np.array([walk[k].value for walk in walks])
        for k, each in enumerate(walks[0])
    }
    true, sigma = values[TRUE, SCALE], values["sound alone", SIGMA]
    off = {name: values[name, SCALE] / true - 1.0 for name in (CLAIMED, MEASURED)}
    for name, each in off.items():
        rms = 100 * float(np.sqrt(np.mean(each**2)))
        yield replace(of, method=name, metric="scale error, rms (%)", value=rms)
    known = np.isfinite(sigma)
    yield replace(of, method=MEASURED, metric="refused walks", value=float((~known).sum()))
    if known.any():
        nees = (((values["sound alone", SCALE] - true) / sigma)[known] ** 2).mean()
        yield replace(of, method=MEASURED, metric="NEES of the scale", value=float(nees))
    better = (np.abs(off[MEASURED]) < np.abs(off[CLAIMED])).astype(float)
    yield _of(of, MEASURED, "walks improved (share)", better, np.mean)
    for name in (CLAIMED, MEASURED, TRUE):
        yield replace(of, method=name, metric=MAP, value=float(np.median(values[name, MAP])))
    ratio = values[MEASURED, MAP] / values[CLAIMED, MAP]
    yield _of(of, MEASURED, "map error over that of claimed steps", ratio, np.median)


def _of(
    of: Record, method: str, metric: str, values: F64, statistic: Callable[[F64], Any]
) -> Record:
    low, high = interval(
        [np.array([value]) for value in values], lambda some: float(statistic(some)),
        np.random.default_rng(0),
    )  # fmt: skip
    return replace(
        of, method=method, metric=metric, value=float(statistic(values)), low=low, high=high
    )


STUDY = Study(
    "Is a walk of better scale when echoes say how long its steps are?",
    measure_acoustic_odometry, minutes=60, scenarios=("people", "surveyor"), long=True,
    fast={"walks": (SimulatedWalk("studio", 100, 2),)},
)  # fmt: skip
