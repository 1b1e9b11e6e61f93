"""Magnetic closures chosen without the walk they are judged on: each set left out once.

Thresholds and sigmas are chosen on the other sets, with drifts of their own, and judged on the
drifts of the set that was left out. Beside the three published walks stands a simulated hall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Odometry, Orientation, Recording, Similarity, Truth
from elfslam.baselines.magnetic import (
    FieldProfile,
    MagneticParameters,
    field_profile,
    level_by_gravity,
    magnetic_similarity,
)
from elfslam.data.magnetic import drifted_odometry, read_magnetic
from elfslam.line.closure import find_closures
from elfslam.line.graph import build_graph, optimise
from elfslam.line.motion import nodes_by_distance
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate
from studies.finding import Finding, Given, Row
from studies.magnetic_offsets import AlignmentParameters, align_closures
from studies.magnetic_walks import (
    AS_STATED,
    CLOSURES,
    NODE_SPACING_M,
    PAPER_RMSE_M,
    PAPERS_DRIFT,
    SEEDS,
    honest,
    rmse_m,
)
from studies.repeats import Numbers, finished

HALL, HALL_SEED = "concourse", 100
"""A simulated walk of two laps, 238 m, through the field of a hall."""
Choice = tuple[float, float, float]
SETS = (*PAPER_RMSE_M, HALL)
CHOICE_SEEDS = (101, 102)
"""Drifts that parameters are chosen on."""
THRESHOLDS, SIGMAS_M, WORST = (0.45, 0.55, 0.65, 0.75), (0.5, 1.0, 1.5, 3.0), (0.25, 0.35, 0.5)
CHOICES = tuple(product(THRESHOLDS, SIGMAS_M, WORST))
"""Likeness of a closure at least, its sigma (m), and the difference of fields that drops it."""
NOTE = (
    "Chosen: the parameters with the least mean logarithm of error over drifted error on the other "
    "sets, drifts 101 and 102. Errors are root mean squares after the rigid move that fits best, "
    "medians and ranges over drifts 0 to 4."
)


@dataclass(frozen=True)
class DriftedWalk:
    """A walk and the drift that its odometry is given."""

    name: str
    seed: int


@dataclass(frozen=True, eq=False)
class Seen:
    """What is the same for any choice: footsteps, likeness of fields, the field along the walk."""

    odometry: Odometry
    truth: Truth
    nodes: Odometry
    similarity: Similarity
    profile: FieldProfile


def measure_magnetic_left_out(
    given: Given, *, sets: Sequence[str] = SETS, choices: Sequence[Choice] = CHOICES
) -> Finding:
    """A row per set: the parameters that the others chose, and the error with them.

    `data` holds `magnetic/*.mat`. Raises InputError where they are missing.
    """
    if given.data is None:
        raise InputError("magnetic-left-out: wanted real walks; set ELFSLAM_DATA to their folder")
    tasks = [DriftedWalk(name, seed) for name in sets for seed in (*CHOICE_SEEDS, *SEEDS)]
    measure = partial(measure_walk, data=given.data, choices=choices)
    found = finished(measure, tasks, given)
    numbers = dict(zip(tasks, found, strict=True))
    rows = [_row(name, sets, choices, numbers) for name in sets]
    table = Panel("Each set left out once", rows_table(rows), NOTE, wide=True)
    return Finding(rows, Page("Magnetic closures chosen without the walk", NOTE, [table]))


def measure_walk(task: DriftedWalk, data: Path, choices: Sequence[Choice]) -> Numbers:
    """Errors (m) of a walk: drifted, and mapped with each of the choices."""
    seen = _seen(*_walk(task, data))
    drifted_m = rmse_m(seen.odometry.t_s, seen.odometry.world_from_body, seen.truth)
    return {"drifted": drifted_m} | {
        str(choice): rmse_m(seen.nodes.t_s, _mapped(seen, choice), seen.truth) for choice in choices
    }


def _walk(task: DriftedWalk, data: Path) -> tuple[Recording, Truth]:
    generator = np.random.default_rng(task.seed)
    if task.name == HALL:
        return hall_walk(generator)
    return read_magnetic(data / "magnetic" / f"{task.name}.mat", generator, PAPERS_DRIFT)


def hall_walk(generator: np.random.Generator) -> tuple[Recording, Truth]:
    """The simulated walk with odometry at 10 Hz that drifts as that of the published walks."""
    recording, truth = simulate(
        load_world(HALL), HALL_SEED, rounds=2, sound=False, sensors=[Sensor.MAGNETIC]
    )
    assert recording.imu is not None
    t_s = np.arange(truth.t_s[0], truth.t_s[-1], 0.1)
    poses = interpolate_poses(truth.t_s, truth.world_from_body, t_s)
    odometry = drifted_odometry(t_s, poses, PAPERS_DRIFT, generator)
    level: Orientation = level_by_gravity(recording.imu)
    return replace(recording, odometry=odometry, orientation=level), Truth(t_s, poses)


def _seen(recording: Recording, truth: Truth) -> Seen:
    odometry, magnetometer = recording.odometry, recording.magnetometer
    assert odometry is not None
    assert magnetometer is not None
    nodes, parameters = nodes_by_distance(honest(odometry), NODE_SPACING_M), MagneticParameters()
    similarity = magnetic_similarity(magnetometer, recording.orientation, nodes, parameters)
    fine = replace(parameters, spacing_m=AlignmentParameters().step_m)
    profile = field_profile(magnetometer, recording.orientation, nodes, fine)
    return Seen(odometry, truth, nodes, similarity, profile)


def _mapped(seen: Seen, choice: Choice) -> F64:
    """The walk (n, 3) straightened by the closures of one choice."""
    threshold, sigma_m, worst = choice
    parameters = replace(
        CLOSURES, threshold=threshold, along_sigma_m=sigma_m, across_sigma_m=sigma_m
    )
    found = find_closures(seen.similarity, seen.nodes, parameters)
    finer = replace(AlignmentParameters(), worst=worst)
    closures = align_closures(found, seen.nodes, seen.profile, finer)
    graph = build_graph(seen.nodes, closures)
    return optimise(graph, seen.nodes.t_s, AS_STATED).world_from_body


def _row(
    name: str, sets: Sequence[str], choices: Sequence[Choice], numbers: dict[DriftedWalk, Numbers]
) -> Row:
    chosen = best_choice([other for other in sets if other != name], choices, numbers)
    walks = [numbers[DriftedWalk(name, seed)] for seed in SEEDS]
    drifted = np.array([walk["drifted"] for walk in walks])
    mapped = np.array([walk[str(chosen)] for walk in walks])
    best = min(float(np.median([walk[str(choice)] for walk in walks])) for choice in choices)
    return {
        "set": name,
        "threshold": chosen[0],
        "sigma (m)": chosen[1],
        "worst": chosen[2],
        "drifted (m)": round(float(np.median(drifted)), 3),
        "mapped (m)": round(float(np.median(mapped)), 3),
        "range": f"{mapped.min():.2f} to {mapped.max():.2f}",
        "best of all choices (m)": round(best, 3),
        "their program (m)": PAPER_RMSE_M.get(name),
    }


def best_choice(
    others: Sequence[str], choices: Sequence[Choice], numbers: dict[DriftedWalk, Numbers]
) -> Choice:
    """The choice with the least mean logarithm of error over drifted error on these sets."""

    def cost(choice: Choice) -> float:
        walks = [numbers[DriftedWalk(name, seed)] for name in others for seed in CHOICE_SEEDS]
        return float(np.mean([np.log(walk[str(choice)] / walk["drifted"]) for walk in walks]))

    return min(choices, key=cost)
