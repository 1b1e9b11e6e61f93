"""Walks of unknown starts: which are merged, rightly or wrongly, and what many make of a map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.enums import Mode
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import FloorMap, Recording, Trajectory, Truth
from elfslam.scoring.errors import alignment_of, fix_errors
from elfslam.slam.merging import MappedWalk, MergeParameters, merge, walk_of
from elfslam.slam.merging.grow import map_of
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.locate import LocateParameters, locate_one_shot
from elfslam.world.kinds import SURVEYOR, Kind, kind_named
from elfslam.world.room import fault_of_route
from elfslam.world.simulate import load_world
from elfslam.world.world_file import World
from studies.cached import SCENARIOS, shipped, simulate
from studies.located import MEDIAN_M
from studies.plain_features import ELF
from studies.results import Record, seeds_text
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, finished, median_aligned_m

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(10))
SAME, PARTLY, OTHER, APART = "same way", "part of the way", "two worlds", "no common ground"
OPPOSITE, CHANGED = "the other way round", "furniture moved"
HUNDRED: Mapping[str, int] = {SAME: 50, PARTLY: 10, OTHER: 30, APART: 10}
BESIDES: Mapping[str, int] = {OPPOSITE: 10, CHANGED: 10}
OVERLAPPING = (SAME, PARTLY)
RIGHT_M = 1.0
"""Walks that typically are less far apart where the map has them together are merged rightly."""
COUNTS = (1, 2, 4, 8)
"""Of walks in a map."""
RIGHT, REFUSED, WRONG = OUTCOMES = ("right (pairs)", "refused (pairs)", "wrong (pairs)")
DRAWN = "drawn (pairs)"
OVERLAP = "all that overlap"


@dataclass(frozen=True)
class Pair:
    """Two walks, and what they have in common."""

    common: str
    one: Stroll
    other: Stroll


@dataclass(frozen=True)
class Growth:
    """A map of ever more walks, and a stranger who is looked for in it."""

    world: str
    walks: tuple[int, ...]
    stranger: int
    kind: str


def measure_merging(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    pairs: Mapping[str, int] | None = None,
    walks: Sequence[int] = COUNTS,
    kind: Kind = SURVEYOR,
) -> list[Record]:
    """Outcomes of random pairs by what they have in common, and maps of 1 to 8 walks."""
    wanted = {**HUNDRED, **BESIDES} if pairs is None else pairs
    generator = np.random.default_rng(0)
    every = [common for common, count in wanted.items() for _ in range(count)]
    drawn = [_drawn(common, worlds, seeds, generator, kind) for common in every]
    grown = [
        Growth(world, tuple(seeds[:count]), seeds[-1], kind.name)
        for world in worlds
        for count in walks
    ]
    tasks: list[Pair | Growth] = [*dict.fromkeys(drawn), *grown]
    found = dict(zip(tasks, finished(_measured, tasks, context), strict=True))
    outcomes = {
        common: [record.metric for pair in drawn if pair.common == common for record in found[pair]]
        for common in wanted
    }
    outcomes[OVERLAP] = [each for common in OVERLAPPING for each in outcomes.get(common, [])]
    records = [each for growth in grown for each in found[growth]]
    for common, each in outcomes.items():
        counts = {DRAWN: len(each), **{name: each.count(name) for name in OUTCOMES}}
        records += [Record(ELF, name, count, condition=common) for name, count in counts.items()]
    scenario, of = SCENARIOS[kind.name], seeds_text(seeds)
    return [replace(each, scenario=scenario, seeds=of) for each in records]


def _drawn(
    common: str,
    worlds: Sequence[str],
    seeds: Sequence[int],
    generator: np.random.Generator,
    kind: Kind,
) -> Pair:
    """A random pair: two people, each with a number of rounds of their own, the second later."""
    here, there = generator.permutation(len(worlds))[:2] if len(worlds) > 1 else (0, 0)
    one, other = generator.permutation(len(seeds))[:2]
    rounds = generator.integers(2, 4, 2)
    parts = {PARTLY: (WHOLE, FIRST), APART: (FIRST, SECOND)}.get(common, (WHOLE, WHOLE))
    return Pair(
        common,
        Stroll(worlds[here], seeds[one], int(rounds[0]), parts[0], kind=kind.name),
        Stroll(
            worlds[there if common == OTHER else here],
            seeds[other],
            int(rounds[1]),
            parts[1],
            reverse=common == OPPOSITE,
            state=MOVED if common == CHANGED else "",
            later=True,
            kind=kind.name,
        ),
    )


def _measured(task: Pair | Growth) -> list[Record]:
    return [_outcome(task)] if isinstance(task, Pair) else list(_growth(task))


def _outcome(pair: Pair) -> Record:
    """What came of a pair: merged rightly, wrongly, or refused."""
    (one, one_truth), (other, other_truth) = strolled(pair.one), strolled(pair.other)
    made = merge([one, other], MergeParameters())
    if not made.maps:
        return Record(ELF, REFUSED, 1.0)
    if pair.common in (OTHER, APART):
        return Record(ELF, WRONG, 1.0)
    apart_m = truly_apart_m(made.maps[0].trajectories, [one_truth, other_truth])
    right = len(apart_m) > 0 and float(np.median(apart_m)) < RIGHT_M
    return Record(ELF, RIGHT if right else WRONG, 1.0)


def _growth(growth: Growth) -> Iterator[Record]:
    """Errors of a map of some walks and of a query walk in it.

    Where nothing was merged there is but one walk in the map.
    """
    strolls = [
        strolled(Stroll(growth.world, seed, later=number % 2 == 1, kind=growth.kind))
        for number, seed in enumerate(growth.walks)
    ]
    asked, truth = strolled(Stroll(growth.world, growth.stranger, later=True, kind=growth.kind))
    made = _map_of([walk for walk, _ in strolls])
    numbers: dict[tuple[str, str], float] = {(MAP, WALKS): 1.0}
    if made is not None:
        names, trajectories, floor_map = made
        truths = {walk.name: true for walk, true in strolls}
        walked, true = one_after_another(trajectories, [truths[name] for name in names])
        fixes = locate_one_shot(asked.features, floor_map, LocateParameters())
        found = fix_errors(fixes, truth, alignment_of(walked, true))
        query = f"{ELF}, {Mode.ONE_SHOT.value}"
        numbers = {
            (MAP, WALKS): float(len(trajectories)),
            (MAP, MEDIAN_ALIGNED): median_aligned_m(walked, true),
            (query, MEDIAN_M): found.ok.median_m,
            (query, "answered"): found.coverage,
        }
    for (method, metric), value in numbers.items():
        if np.isfinite(value):
            condition = f"{len(growth.walks)} walks"
            yield Record(method, metric, value, world=growth.world, condition=condition)


def _map_of(
    walks: Sequence[MappedWalk],
) -> tuple[Sequence[str], Sequence[Trajectory], FloorMap] | None:
    """The names and trajectories of the walks that came into one map, and the map."""
    if len(walks) == 1:
        (walk,) = walks
        return [walk.name], [walk.trajectory], map_of(walk, walk.trajectory, MergeParameters())
    made = merge(walks, MergeParameters()).maps
    return (made[0].names, made[0].trajectories, made[0].floor_map) if made else None


# --- walks ---


CORNER_SIGMA_M = 0.15
"""How far the corners of one walker's route lie from another's."""
TRIES = 1000
TOGETHER_M = 0.6
"""Footsteps of two walks this close in a map lie together there."""
WHOLE, FIRST, SECOND = "whole", "first part", "second part"
MOVED = "moved"
MAP, WALKS = "map", "walks in the map"
"""The method whose error is the map's own, and how many walks came into it."""


@dataclass(frozen=True)
class Stroll:
    """A walk of one person: over the whole route, or there and back over a part of it.

    A `later` one is of another day, with another phone.
    """

    world: str
    seed: int
    rounds: int = 3
    part: str = WHOLE
    reverse: bool = False
    state: str = ""
    later: bool = False
    kind: str = SURVEYOR.name


@cache
def strolled(stroll: Stroll) -> tuple[MappedWalk, Truth]:
    """The walk as it is mapped by itself, its start unknown, and the truth."""
    recording, truth = recorded(stroll)
    run = map_by_echoes(recording, shipped(), Settings())
    return replace(walk_of(run), name=repr(stroll)), truth


def recorded(stroll: Stroll) -> tuple[Recording, Truth]:
    """The recording of a walk, and the truth."""
    world, kind = _routed(stroll), kind_named(stroll.kind)
    today = kind.asking(world.room) if stroll.later else kind.mapping(world.room)
    return simulate(
        world, stroll.seed, rounds=stroll.rounds, reverse=stroll.reverse, walker=kind.walker,
        circumstances=replace(today, state=stroll.state),
    )  # fmt: skip


def truly_apart_m(trajectories: Sequence[Trajectory], truths: Sequence[Truth]) -> F64:
    """How far apart two walks truly are (k) at footsteps that lie together in their common map.

    That is what a merger claims; how bent the map is as a whole says more of the walks.
    """
    (one, other), (one_true, other_true) = (
        [walk.world_from_body[:, :2] for walk in trajectories],
        [
            interpolate_poses(truth.t_s, truth.world_from_body, walk.t_s)[:, :2]
            for walk, truth in zip(trajectories, truths, strict=True)
        ],
    )
    away_m, near = cKDTree(one).query(other, distance_upper_bound=TOGETHER_M)
    known = np.isfinite(away_m)
    return np.asarray(np.linalg.norm(one_true[near[known]] - other_true[known], axis=1))


def one_after_another(
    trajectories: Sequence[Trajectory], truths: Sequence[Truth]
) -> tuple[Trajectory, Truth]:
    """Walks of one frame as one long walk, and its truth: to be aligned and judged as a whole."""
    pairs = list(zip(trajectories, truths, strict=True))
    lasts_s = [max(walk.t_s[-1], truth.t_s[-1]) + 1.0 for walk, truth in pairs]
    begins_s = np.cumsum([0.0, *lasts_s])
    t_s = [walk.t_s + begin for walk, begin in zip(trajectories, begins_s, strict=False)]
    true_s = [truth.t_s + begin for truth, begin in zip(truths, begins_s, strict=False)]
    poses = np.vstack([walk.world_from_body for walk in trajectories])
    covariance = np.concatenate([walk.covariance for walk in trajectories])
    known = np.vstack([truth.world_from_body for truth in truths])
    walked = Trajectory(np.concatenate(t_s), poses, covariance, np.empty(0), "OK")
    return walked, Truth(np.concatenate(true_s), known)


def _routed(stroll: Stroll) -> World:
    """The world with the route of this walker: it starts at any corner, each a little elsewhere."""
    world = load_world(stroll.world)
    generator = np.random.default_rng([stroll.seed, 2])
    corners = _part(world.route_m, stroll.part)
    for _ in range(TRIES):
        route_m = corners + generator.normal(0, CORNER_SIGMA_M, corners.shape)
        if stroll.part == WHOLE:
            route_m = np.roll(route_m, -int(generator.integers(len(route_m))), axis=0)
        else:
            route_m = np.vstack([route_m, route_m[-2:0:-1]])
        if fault_of_route(world.room, route_m, closed=True) is None:
            return replace(world, route_m=route_m)
    return world


def _part(route_m: F64, part: str) -> F64:
    """The corners of the route, or of a part; between both parts lies a leg that none walks."""
    half = len(route_m) // 2
    return {WHOLE: route_m, FIRST: route_m[: half - 1], SECOND: route_m[half : 2 * half - 1]}[part]


STUDY = Study(
    "Which walks of unknown starts are merged, rightly or wrongly, and what do many make of a map?",
    measure_merging, minutes=30, long=True, scenarios=("surveyor", "people"),
    fast={"worlds": ("studio", "lounge"), "seeds": (130, 131, 132),
          "pairs": {SAME: 1, OTHER: 1}, "walks": (2,)},
)  # fmt: skip
