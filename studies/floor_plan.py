"""Maps placed on floor plans by where people can walk: placed rightly, wrongly, or refused."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import NoAnswerError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.grid import FloorGrid, drawn_grid
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.floor_plan_alignment import (
    AMBIGUOUS,
    NOWHERE,
    OK,
    AnchoringParameters,
    Placement,
    Tag,
    anchor,
    placed,
)
from elfslam.world.kinds import PEOPLE, Kind
from elfslam.world.room import HEAD_M, Room
from elfslam.world.simulate import load_world
from studies.cached import SimulatedWalk, record_of, shipped, simulated
from studies.magnetic_walks import median_of
from studies.results import Record, averaged, seeds_text
from studies.study import Study, StudyContext, finished

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
KNOWN_START = ", known start"
RIGHT, WRONG, UNSURE, REFUSED = "placed rightly", "placed wrongly", "ambiguous", "nowhere"
OFFERED = "right one among those offered"
MEDIANS = ERROR, SIGMA = "median error (m)", "reported sigma (m)"
"""Of walks that were placed: the median over them."""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A walk as it was mapped, and where it was (each n, 2)."""

    xy_m: F64
    truth_xy_m: F64


def measure_floor_plan(
    context: StudyContext,
    *,
    worlds: Mapping[str, int] = WORLDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
    known: AnchoringParameters | None = None,
) -> list[Record]:
    """Shares of walks placed rightly, wrongly and not, by plan (the condition)."""
    found: list[Record] = []
    measure = partial(_measured, parameters=known or AnchoringParameters())
    seeds = {world: range(FIRST_SEED, FIRST_SEED + count) for world, count in worlds.items()}
    tasks = [
        SimulatedWalk(world, seed, rounds, kind.name) for world in seeds for seed in seeds[world]
    ]
    walks = finished(measure, tasks, context)
    for world, some in seeds.items():
        mine = [walk for walk, task in zip(walks, tasks, strict=True) if task.world == world]
        shares = [[each for each in walk if each.metric not in MEDIANS] for walk in mine]
        found += averaged(shares, some) + _medians(mine, some)
    return found


def plan_of(room: Room, *, furnished: bool) -> FloorGrid:
    """The accessible ground of a simulated room."""
    low = [block.corners_m for block in room.blocks if furnished and block.base_m < HEAD_M]
    return drawn_grid([(room.outline_m,)], [(corners,) for corners in low], CELL_M)


def mapped(walk: SimulatedWalk) -> Mapped:
    """The walk as its echoes map it, from an origin of its own."""
    recording, truth = simulated(walk)
    trajectory = map_by_echoes(recording, shipped(), Parameters()).trajectory
    true = interpolate_poses(truth.t_s, truth.world_from_body, trajectory.t_s)
    return Mapped(trajectory.world_from_body[:, :2], true[:, :2])


def _measured(walk: SimulatedWalk, parameters: AnchoringParameters) -> list[Record]:
    made, found = mapped(walk), list[Record]()
    for plan, ground, tag in _plans(walk, made):
        try:
            placement = anchor([made.xy_m], ground, parameters, tag)
            outcome = _outcome(made, placement, lost=plan == ELSEWHERE)
        except NoAnswerError:  # far larger than the plan
            outcome = {RIGHT: 0.0, WRONG: 0.0, UNSURE: 0.0, REFUSED: 1.0}
        found += record_of(walk, "placement", plan).each(outcome)
    return found


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


def _outcome(made: Mapped, found: Placement, *, lost: bool) -> dict[str, float]:
    """What became of a walk, as numbers; `lost` is a walk that was never on that plan."""
    poses = np.vstack([found.plan_from_map, found.others])
    errors_m = [_error_m(made, pose, found.scale) for pose in poses]
    right = not lost and errors_m[0] <= RIGHT_M
    outcome = {
        RIGHT: float(found.status == OK and right),
        WRONG: float(found.status == OK and not right),
        UNSURE: float(found.status == AMBIGUOUS),
        REFUSED: float(found.status == NOWHERE),
    }
    if found.status == AMBIGUOUS:
        outcome[OFFERED] = float(not lost and min(errors_m) <= RIGHT_M)
    if found.status == OK and not lost:
        sigma_m = float(np.sqrt(np.trace(found.covariance[:2, :2]) / 2))
        outcome |= {ERROR: errors_m[0], SIGMA: sigma_m}
    return outcome


def _error_m(made: Mapped, plan_from_map: F64, scale: float) -> float:
    apart = placed(made.xy_m, plan_from_map, scale) - made.truth_xy_m
    return float(np.median(np.linalg.norm(apart, axis=1)))


def _medians(walks: Sequence[Sequence[Record]], seeds: Sequence[int]) -> list[Record]:
    """The medians over the walks that were placed, with their intervals."""
    values: dict[Record, list[float]] = {}
    for each in (record for walk in walks for record in walk if record.metric in MEDIANS):
        values.setdefault(replace(each, value=0.0, seeds=seeds_text(seeds)), []).append(each.value)
    return [median_of(of, some) for of, some in values.items()]


STUDY = Study(
    "How often does a map find its place on a floor plan, and how often a wrong one?",
    measure_floor_plan, minutes=40, scenarios=("people", "surveyor"), long=True,
    fast={"worlds": {"studio": 1}, "rounds": 1},
)  # fmt: skip
