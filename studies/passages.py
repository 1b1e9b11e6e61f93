"""Walks followed through a floor plan: how much walls and furniture put right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elfslam.app.anchor import floor_plan
from elfslam.app.follow import Start, follow
from elfslam.base.arrays import F64
from elfslam.base.geometry import between, compose, interpolate_poses
from elfslam.base.values import Run
from elfslam.line.anchoring import AnchoringParameters
from elfslam.line.feature import load_encoder
from elfslam.line.map_matching import MapMatchingParameters, followed_trajectory
from elfslam.scoring.alignment import AS_DECLARED
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import Sense as Motion
from elfslam.slam.pipeline import map_by, map_by_echoes, no_similarity
from elfslam.world.kinds import PEOPLE, Kind
from elfslam.world.simulate import load_world
from studies.figures.coverage import trajectory_coverage
from studies.figures.plan_figures import followed_figure
from studies.finding import Finding, Given, Row
from studies.floor_plan import plan_of
from studies.intervals import mean_range
from studies.repeats import Numbers, by_world, finished
from studies.simulated_walk import SimulatedWalk, simulated

WORLDS = ("living_room", "office", "mall")
SEEDS = (0, 1, 2, 3, 4)
ROUNDS = 2
TOLD_SIGMA = np.array([0.5, 0.5, 0.2])
"""How well the walker says where the walk begins and whereto, m, m, rad."""
ECHOES, STEPS = "ELF", "dead reckoning"
NOTE = (
    "Median error along a walk, means over walks with their 95 % interval. Sigmas: share of "
    "footsteps within one and two per axis (0.68 and 0.95 where they are right)."
)


@dataclass(frozen=True, eq=False)
class Pair:
    """A walk before and after the plan was heard, and where it was (each n, 2); its numbers."""

    before_m: F64
    after_m: F64
    truth_m: F64
    numbers: Numbers


def measure_passages(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
    known: MapMatchingParameters | None = None,
) -> Finding:
    """Errors from the told start before and after, by echoes and by steps."""
    matching = known or MapMatchingParameters()
    tasks = [SimulatedWalk(world, seed, rounds, kind.name) for world in worlds for seed in seeds]
    measure = partial(_measured, parameters=matching)
    numbers = finished(measure, tasks, given)
    rows = [row for world, found in by_world(tasks, numbers).items() for row in _rows(world, found)]
    first = [SimulatedWalk(world, seeds[0], rounds, kind.name) for world in worlds]
    panels = [_panel(walk, matching) for walk in first]
    table = Panel("All walks", rows_table(rows), NOTE, wide=True)
    subtitle = "The start is known to half a metre and eleven degrees, the plan has its furniture."
    return Finding(rows, Page("Walks followed through floor plans", subtitle, [*panels, table]))


def _measured(walk: SimulatedWalk, parameters: MapMatchingParameters) -> Numbers:
    return {
        f"{name}|{key}": value
        for name, pair in pairs_of(walk, parameters)
        for key, value in pair.numbers.items()
    }


def pairs_of(walk: SimulatedWalk, parameters: MapMatchingParameters) -> Iterator[tuple[str, Pair]]:
    """The walk by its echoes and by its steps alone, before and after."""
    recording, truth = simulated(walk)
    ground = plan_of(load_world(walk.world).room, furnished=True)
    generator = np.random.default_rng([walk.seed, 11])
    off = generator.normal(0, TOLD_SIGMA)
    runs: dict[str, Run] = {
        ECHOES: map_by_echoes(recording, load_encoder("compact"), Parameters()),
        STEPS: map_by(recording, [Motion(no_similarity, Parameters().closure)], Parameters()),
    }
    for name, run in runs.items():
        poses = run.trajectory.world_from_body
        true = interpolate_poses(truth.t_s, truth.world_from_body, run.trajectory.t_s)
        start = Start(true[0] + off, np.diag(np.square(TOLD_SIGMA)))
        told = compose(start.pose, between(poses[0], poses))
        found = follow(run, start, ground, AnchoringParameters().keep_off_m, parameters)
        covered = trajectory_coverage(
            followed_trajectory(run.trajectory, found), truth, AS_DECLARED
        )
        numbers = {
            "before": _median_m(told, true),
            "after": _median_m(found.poses, true),
            "one sigma": covered.one_sigma,
            "two sigma": covered.two_sigma,
            "off": found.off_share,
        }
        yield name, Pair(told[:, :2], found.poses[:, :2], true[:, :2], numbers)


def _median_m(poses: F64, true: F64) -> float:
    return float(np.median(np.linalg.norm(poses[:, :2] - true[:, :2], axis=1)))


def _rows(world: str, numbers: Sequence[Numbers]) -> Iterator[Row]:
    for name in (STEPS, ECHOES):
        table = {
            key: np.array([each[f"{name}|{key}"] for each in numbers])
            for key in ("before", "after", "one sigma", "two sigma")
        }
        low, high = mean_range(table["after"])
        yield {
            "world": world,
            "walk by": name,
            "walks": len(numbers),
            "as told (m)": float(table["before"].mean()),
            "followed (m)": float(table["after"].mean()),
            "range": f"{low:.2f} to {high:.2f}",
            "1 sigma": float(table["one sigma"].mean()),
            "2 sigma": float(table["two sigma"].mean()),
        }


def _panel(walk: SimulatedWalk, parameters: MapMatchingParameters) -> Panel:
    """The first walk of a world by its steps alone, on its plan."""
    pair = dict(pairs_of(walk, parameters))[STEPS]
    drawn = floor_plan(load_world(walk.world).room)
    figure = followed_figure(drawn, pair.after_m, pair.before_m, pair.truth_m)
    title = f"{walk.world}: {pair.numbers['before']:.2f} m, then {pair.numbers['after']:.2f} m"
    return Panel(title, figure)
