"""The paper's table of mapping errors: echoes, the baselines, and all of them in one graph.

Beside the ELF stand plain features, which need no training, each with a threshold of its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elfslam.app.settings import Settings, sense_of
from elfslam.base.arrays import F64
from elfslam.base.enums import Modality
from elfslam.base.geometry import path_length_m
from elfslam.base.values import (
    NO_CLOSURES,
    AnySimilarity,
    Closures,
    Echoes,
    Features,
    Odometry,
    Recording,
    Trajectory,
    Truth,
)
from elfslam.learn.parameters import ScratchParameters
from elfslam.scoring.errors import (
    AS_DECLARED,
    Alignment,
    SimilarityTransform,
    match,
    place,
    placed_errors,
    placement,
    score_closures,
    summarise,
)
from elfslam.slam.front_end import apply_acoustic_scale, dead_reckoning_nodes
from elfslam.slam.pipeline import closures_by
from elfslam.stages.closure import ClosureParameters, echo_sequence_similarity
from elfslam.stages.graph import build_graph, optimise
from elfslam.stages.motion import calibrated, calibrated_by_distance
from elfslam.world.kinds import PEOPLE, QUIET, Kind, kind_named
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world
from studies.cached import (
    SimulatedWalk,
    at_its_start,
    extract_echoes,
    extract_features,
    record_of,
    simulate,
    simulated,
)
from studies.curation import CurationParameters, curated_closures
from studies.plain_features import CLOSURE_THRESHOLDS, ELF, closing_by, compared_encoders
from studies.results import Record, seeds_text
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, per_walk

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(10))
ROUNDS = 4
CURATED_SEEDS = 3
"""The paper's curation takes minutes for each walk of a mall: seeds below this get it."""
COURSE = "concourse"
"""Where a walker is calibrated: a lap of known length."""
OFF, OFF_SIGMA = 0.1, 0.1
"""Steps are assumed this much too long (even seeds) or too short, and known no better."""
CALIBRATED, UNCALIBRATED = "calibrated", "10 % off"
PAPERS = ", paper's"
"""Ends the name of what is closed by the paper's curation."""
SOUND = "dead reckoning, acoustic odometry"
ALONE = "ELF without pre-training"
ALONE_THRESHOLD = 0.15
"""An encoder trained on one walk alone scores nothing as high as the shipped one does."""
OTHERS = (Modality.MAGNETIC, Modality.EMR, Modality.WIFI)
SENSORS = (Sensor.WIFI, Sensor.MAGNETIC, Sensor.EMR)
ALIGNED = (MEDIAN_ALIGNED, "mean error, aligned (m)", "third quartile, aligned (m)")
PAPER_M: Mapping[str, Mapping[str, tuple[float, float, float]]] = {
    "ELF": {
        "living_room": (0.10, 0.10, 0.14), "office": (0.63, 0.63, 0.80), "mall": (0.45, 0.53, 0.69),
    },
    ALONE: {
        "living_room": (0.73, 0.82, 1.25), "office": (1.69, 1.68, 1.94), "mall": (1.16, 1.14, 1.42),
    },
    f"wifi{PAPERS}": {
        "living_room": (0.44, 0.45, 0.55), "office": (1.52, 1.54, 2.06), "mall": (1.24, 1.26, 1.54),
    },
    f"magnetic{PAPERS}": {
        "living_room": (0.56, 0.55, 0.64), "office": (1.14, 1.24, 1.82), "mall": (0.79, 0.81, 1.05),
    },
}  # fmt: skip
"""Median, mean and third quartile, m, of mapping in three real places."""


def measure_mapping(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
    scratch: ScratchParameters | None = None,
) -> list[Record]:
    """Errors of every method for walkers calibrated and not (the condition)."""
    measure = partial(_measured, scratch=scratch or ScratchParameters(threads=1))
    walks = per_walk(measure, context, worlds, seeds, rounds, kind)
    curated = seeds_text([seed for seed in seeds if seed < CURATED_SEEDS])
    return [
        replace(each, paper=_paper_m(each), seeds=curated if PAPERS in each.method else each.seeds)
        for each in walks
    ]


def _measured(walk: SimulatedWalk, scratch: ScratchParameters) -> list[Record]:
    kind = kind_named(walk.kind)
    recording, truth = simulated(walk, sensors=SENSORS)
    recording = at_its_start(recording, truth)
    echoes = extract_echoes(recording, Settings())
    features = _features(echoes, walk.seed, scratch)
    found: list[Record] = []
    for walker, known in walkers(walk.seed, kind).items():
        methods = list(_closures(recording, echoes, features, known))
        if walker == CALIBRATED and walk.seed < CURATED_SEEDS:
            methods += _as_the_paper_closes(recording, echoes, features, known)
        for method, nodes, closures in methods:
            trajectory = optimise(build_graph(nodes, closures), nodes.t_s, known.graph)
            numbers = {
                **trajectory_errors(trajectory, truth),
                **_evidence(closures, trajectory, truth),
            }
            found += record_of(walk, method, walker).each(numbers)
    return found


def _paper_m(record: Record) -> float | None:
    """What the paper has in its three places, which it aligned."""
    if record.condition != CALIBRATED:
        return None
    known = PAPER_M.get(record.method, {}).get(record.world, ())
    return dict(zip(ALIGNED, known, strict=False)).get(record.metric)


def walkers(seed: int, kind: Kind = QUIET) -> Mapping[str, Settings]:
    """The settings for this walker, calibrated on another walk, and with steps 10 % off."""
    usual = Settings()
    recording, truth = simulate(load_world(COURSE), seed, rounds=1, sound=False, walker=kind.walker)
    assert recording.imu is not None
    length_m = path_length_m(truth.world_from_body[:, :2])
    known = calibrated_by_distance(recording.imu, length_m, usual.motion)
    off = calibrated(known, 1 + OFF * (1 if seed % 2 == 0 else -1), OFF_SIGMA)
    return {CALIBRATED: replace(usual, motion=known), UNCALIBRATED: replace(usual, motion=off)}


def _features(echoes: Echoes, seed: int, scratch: ScratchParameters) -> dict[str, Features]:
    """By the shipped encoder, by plain features, by an encoder trained on this walk alone."""
    from studies.paper_training import learnt_from_walk

    alone = learnt_from_walk(echoes, scratch, seed=seed)
    encoders = {**compared_encoders(), ALONE: alone}
    return {name: extract_features(echoes, encoder) for name, encoder in encoders.items()}


def _closures(
    recording: Recording, echoes: Echoes, features: Mapping[str, Features], settings: Settings
) -> Iterator[tuple[str, Odometry, Closures]]:
    """What is walked and closed by method, first nothing, at last by all modalities together.

    Methods by echoes also take the length of steps from them.
    """
    walked = dead_reckoning_nodes(recording, settings)
    yield "dead reckoning", walked, NO_CLOSURES
    heard = apply_acoustic_scale(walked, echoes, settings)
    yield SOUND, heard, NO_CLOSURES
    elf = {name: echo_sequence_similarity(each, heard) for name, each in features.items()}
    strictness = {name: closing_by(name, settings) for name in CLOSURE_THRESHOLDS}
    strictness[ALONE] = replace(settings.closure, threshold=ALONE_THRESHOLD)
    for name, alike in elf.items():
        yield name, heard, closures_by(heard, [(alike, strictness[name])], settings)
    for item in OTHERS:
        yield (
            item.value,
            walked,
            closures_by(walked, [_sensed(item, recording, walked, settings)], settings),
        )
    others = [_sensed(item, recording, heard, settings) for item in OTHERS]
    together = closures_by(heard, [(elf[ELF], settings.closure), *others], settings)
    yield "all together", heard, together


def _as_the_paper_closes(
    recording: Recording, echoes: Echoes, features: Mapping[str, Features], settings: Settings
) -> Iterator[tuple[str, Odometry, Closures]]:
    """Our features and the paper's baselines by the paper's curation, which takes minutes."""
    walked = dead_reckoning_nodes(recording, settings)
    heard = apply_acoustic_scale(walked, echoes, settings)
    alike = echo_sequence_similarity(features[ELF], heard)
    curated = _curated(alike, heard, settings, settings.closure.threshold)
    yield f"{ELF}{PAPERS} curation", heard, curated
    for item, paper in _as_in_the_paper(settings).items():
        similarity, closure = _sensed(item, recording, walked, paper)
        closures = _curated(similarity, walked, paper, closure.threshold)
        yield f"{item}{PAPERS}", walked, closures


def _sensed(
    item: Modality, recording: Recording, nodes: Odometry, settings: Settings
) -> tuple[AnySimilarity, ClosureParameters]:
    sense = sense_of(item, settings)
    return sense.similarity_of(recording, nodes), sense.closure


def _curated(
    similarity: AnySimilarity, nodes: Odometry, settings: Settings, threshold: float
) -> Closures:
    return curated_closures(similarity, nodes, replace(CurationParameters(), threshold=threshold))


def _as_in_the_paper(settings: Settings) -> Mapping[Modality, Settings]:
    return {
        Modality.WIFI: replace(settings, wifi=replace(settings.wifi, variant="paper")),
        Modality.MAGNETIC: replace(settings, magnetic=replace(settings.magnetic, variant="paper")),
    }


def trajectory_errors(trajectory: Trajectory, truth: Truth) -> dict[str, float]:
    """Median, mean and third quartile, by where the map lies: as declared or fitted."""
    numbers: dict[str, float] = {}
    matched = match(trajectory.t_s, trajectory.world_from_body, truth)
    for name, where in {
        "declared start": AS_DECLARED,
        "aligned": placement(matched, Alignment.ALIGNED),
    }.items():
        poses = trajectory.world_from_body
        summary = summarise(placed_errors(trajectory.t_s, poses, truth, where))
        numbers |= {
            f"median error, {name} (m)": summary.median_m,
            f"mean error, {name} (m)": summary.mean_m,
            f"third quartile, {name} (m)": summary.q3_m,
        }
    return numbers


def _evidence(closures: Closures, trajectory: Trajectory, truth: Truth) -> dict[str, float]:
    """How right the closures were, found and accepted, and the sigmas of the trajectory."""
    score = score_closures(closures, trajectory.t_s, truth)
    known = np.isfinite(score.distance_m)
    covered = trajectory_coverage(trajectory, truth, AS_DECLARED)
    return {
        "precision of closures": float(score.right[known].mean()) if known.any() else float("nan"),
        "within one sigma": covered.one_sigma,
        "within two sigma": covered.two_sigma,
        "NEES": covered.nees,
    }


# --- uncertainty ---


@dataclass(frozen=True)
class Coverage:
    """Shares of footsteps whose true x (or y) lies within one and two sigma, both axes pooled.

    0.68 and 0.95 where the sigmas are right. `nees` is the mean normalised error squared in the
    plane, 2 where they are.
    """

    one_sigma: float
    two_sigma: float
    nees: float


def trajectory_coverage(
    trajectory: Trajectory, truth: Truth, where: SimilarityTransform | None = None
) -> Coverage:
    """Against a dense truth, the map lying `where` it does in the world.

    By default anchored at its first pose, which the covariance takes for certain.
    """
    matched = match(trajectory.t_s, trajectory.world_from_body, truth)
    where = where or placement(matched, Alignment.ANCHORED)
    error_m = place(matched.estimate, where)[:, :2] - matched.truth[:, :2]
    covariance = _turned(_at(trajectory, matched.t_s), float(where.world_from_map[2]))
    sigma_m = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    away = np.abs(error_m[1:]) / sigma_m[1:]
    solved = np.linalg.solve(covariance[1:], error_m[1:, :, None])[:, :, 0]
    nees = float(np.mean(np.sum(error_m[1:] * solved, axis=1)))
    return Coverage(float(np.mean(away <= 1)), float(np.mean(away <= 2)), nees)


def _at(trajectory: Trajectory, t_s: F64) -> F64:
    """Covariances (m, 2, 2) of the nearest footstep before each time."""
    row = np.clip(np.searchsorted(trajectory.t_s, t_s, side="right") - 1, 0, None)
    return np.asarray(trajectory.covariance[row][:, :2, :2])


def _turned(covariance: F64, angle_rad: float) -> F64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    return np.asarray(turn @ covariance @ turn.T)


STUDY = Study(
    "How far off are maps, by method, in the paper's three places?",
    measure_mapping, minutes=55, scenarios=("people", "surveyor"), long=True,
    needs=("torch", "sklearn"),
    fast={"worlds": ("living_room",), "seeds": (0, 1), "rounds": 2,
          "scratch": ScratchParameters(steps=20, pairs=32, threads=1)},
)  # fmt: skip
