"""Maps placed on floor plans by where people can walk: placed right, wrong, or refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elfslam.app.anchor import floor_plan
from elfslam.base.arrays import F64
from elfslam.base.errors import NoAnswerError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.grid import FloorGrid, drawn_grid
from elfslam.base.values import Trajectory, Truth
from elfslam.line.anchoring import (
    AMBIGUOUS,
    NOWHERE,
    OK,
    AnchoringParameters,
    Placement,
    Tag,
    anchor,
    placed,
)
from elfslam.line.feature import load_encoder
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import PEOPLE, Kind
from elfslam.world.room import Room
from elfslam.world.simulate import load_world
from elfslam.world.walkable import HEAD_M
from studies.figures.plan_figures import placed_figure
from studies.finding import Finding, Given, Row
from studies.repeats import Numbers, by_world, finished
from studies.simulated_walk import SimulatedWalk, simulated

WORLDS: Mapping[str, int] = {"studio": 10, "lounge": 10, "concourse": 4}
"""Walks in each, for development: the worlds of evaluation stay unseen."""
OTHERS = {"studio": "lounge", "lounge": "concourse", "concourse": "studio"}
"""Whose plan a walk is tried on that was never there."""
FIRST_SEED = 100
ROUNDS = 2
CELL_M = 0.05
RIGHT_M = 1.0
"""A placement is right where half of the walk lies nearer the truth than this."""
TAG_ERROR_M = 0.5
"""How far off, per axis, people say that a walk began."""
WALLS, FURNISHED, ELSEWHERE = "walls", "walls and furniture", "another floor"
KNOWN_START = ", start known"
REFUSED: Numbers = {
    "right": 0.0, "wrong": 0.0, "ambiguous": 0.0, "nowhere": 1.0,
    "offered": 0.0, "error_m": np.nan, "sigma_m": np.nan,
}  # fmt: skip
"""What becomes of a walk that is far larger than the plan."""
NOTE = (
    "Solid: the likeliest placement. Orange: the others, with their probabilities. Dotted: where "
    "the walk was."
)


@dataclass(frozen=True, eq=False)
class Mapped:
    """A walk as it was mapped, and where it was (each n, 2)."""

    xy_m: F64
    truth_xy_m: F64


def measure_floor_plan(
    given: Given,
    *,
    worlds: Mapping[str, int] = WORLDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
    known: AnchoringParameters | None = None,
) -> Finding:
    """A row per world and plan: shares of walks placed right, wrong, and not."""
    parameters = known or AnchoringParameters()
    tasks = [
        SimulatedWalk(world, FIRST_SEED + k, rounds, kind.name)
        for world, count in worlds.items()
        for k in range(count)
    ]
    measure = partial(_measured, parameters=parameters)
    numbers = finished(measure, tasks, given)
    rows = [row for world, found in by_world(tasks, numbers).items() for row in _rows(world, found)]
    first = [SimulatedWalk(world, FIRST_SEED, rounds, kind.name) for world in worlds]
    panels = [_panel(walk, parameters) for walk in first]
    table = Panel("All walks", rows_table(rows), wide=True)
    subtitle = "Shares of walks, and median errors of those that were placed."
    return Finding(rows, Page("Maps placed on floor plans", subtitle, [*panels, table]))


def plan_of(room: Room, *, furnished: bool) -> FloorGrid:
    """The accessible ground of a simulated room."""
    low = [block.corners_m for block in room.blocks if furnished and block.base_m < HEAD_M]
    return drawn_grid([(room.outline_m,)], [(corners,) for corners in low], CELL_M)


def mapped(walk: SimulatedWalk) -> Mapped:
    """The walk as its echoes map it, from an origin of its own."""
    recording, truth = simulated(walk)
    trajectory = map_by_echoes(recording, load_encoder("compact"), Parameters()).trajectory
    return Mapped(trajectory.world_from_body[:, :2], _truth_of(trajectory, truth))


def _truth_of(trajectory: Trajectory, truth: Truth) -> F64:
    return interpolate_poses(truth.t_s, truth.world_from_body, trajectory.t_s)[:, :2]


def _measured(walk: SimulatedWalk, parameters: AnchoringParameters) -> Numbers:
    numbers: Numbers = {}
    made = mapped(walk)
    for name, plan, tag in _plans(walk, made):
        try:
            told = _judged(made, anchor([made.xy_m], plan, parameters, tag), lost=name == ELSEWHERE)
        except NoAnswerError:
            told = REFUSED
        numbers |= {f"{name}|{key}": value for key, value in told.items()}
    return numbers


def _plans(walk: SimulatedWalk, made: Mapped) -> Iterator[tuple[str, FloorGrid, Tag | None]]:
    """Plans by name: bare and furnished, without and with a start; and that of another floor."""
    room = load_world(walk.world).room
    off_m = np.random.default_rng([walk.seed, 7]).normal(0, TAG_ERROR_M, 2)
    tag = Tag(made.xy_m[0], made.truth_xy_m[0] + off_m)
    for name in (WALLS, FURNISHED):
        plan = plan_of(room, furnished=name == FURNISHED)
        yield name, plan, None
        yield name + KNOWN_START, plan, tag
    yield ELSEWHERE, plan_of(load_world(OTHERS[walk.world]).room, furnished=True), None


def _judged(made: Mapped, found: Placement, *, lost: bool) -> Numbers:
    """What became of a walk, as numbers; `lost` is a walk that was never on that plan."""
    poses = np.vstack([found.plan_from_map, found.others])
    errors_m = [_error_m(made, pose, found.scale) for pose in poses]
    right = not lost and errors_m[0] <= RIGHT_M
    sigma_m = float(np.sqrt(np.trace(found.covariance[:2, :2]) / 2))
    return {
        "right": float(found.status == OK and right),
        "wrong": float(found.status == OK and not right),
        "ambiguous": float(found.status == AMBIGUOUS),
        "nowhere": float(found.status == NOWHERE),
        "offered": float(found.status == AMBIGUOUS and not lost and min(errors_m) <= RIGHT_M),
        "error_m": errors_m[0],
        "sigma_m": sigma_m,
    }


def _error_m(made: Mapped, plan_from_map: F64, scale: float) -> float:
    apart = placed(made.xy_m, plan_from_map, scale) - made.truth_xy_m
    return float(np.median(np.linalg.norm(apart, axis=1)))


def _rows(world: str, numbers: Sequence[Mapping[str, float]]) -> Iterator[Row]:
    names = [WALLS, WALLS + KNOWN_START, FURNISHED, FURNISHED + KNOWN_START, ELSEWHERE]
    for name in names:
        table = {
            key: np.array([each[f"{name}|{key}"] for each in numbers])
            for key in ("right", "wrong", "ambiguous", "nowhere", "offered", "error_m", "sigma_m")
        }
        stood = (table["right"] + table["wrong"] > 0) & (name != ELSEWHERE)
        unsure = float(table["ambiguous"].sum())
        yield {
            "world": world,
            "plan": name,
            "walks": len(numbers),
            **{key: float(table[key].mean()) for key in ("right", "wrong", "ambiguous", "nowhere")},
            "right_among_offered": float(table["offered"].sum()) / unsure if unsure else None,
            "error_median_m": float(np.median(table["error_m"][stood])) if stood.any() else None,
            "sigma_median_m": float(np.median(table["sigma_m"][stood])) if stood.any() else None,
        }


def _panel(walk: SimulatedWalk, parameters: AnchoringParameters) -> Panel:
    """The first walk of a world on its furnished plan."""
    made, room = mapped(walk), load_world(walk.world).room
    found = anchor([made.xy_m], plan_of(room, furnished=True), parameters)
    poses = np.vstack([found.plan_from_map, found.others])
    walks = [
        (float(share), placed(made.xy_m, pose, found.scale))
        for share, pose in zip(found.shares, poses, strict=True)
    ]
    figure = placed_figure(floor_plan(room), walks, made.truth_xy_m)
    return Panel(f"{walk.world}: {found.status}", figure, NOTE)
