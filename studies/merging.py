"""Walks of unknown starts: which are merged, rightly or wrongly, and what many make of a map."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.enums import Mode
from elfslam.base.values import FloorMap, Trajectory, Truth
from elfslam.scoring.errors import Alignment, alignment_of, fix_errors, position_errors
from elfslam.slam.merging import MappedWalk, MergeParameters, add_walk, merge
from elfslam.slam.merging.grow import map_of
from elfslam.stages.locate import LocateParameters, locate_one_shot
from elfslam.world.kinds import SURVEYOR, Kind
from studies.localization_cost import map_bytes
from studies.located import MEDIAN_M
from studies.mapping import MEDIAN_ALIGNED
from studies.merged_walks import (
    FIRST,
    MAP,
    MOVED,
    SECOND,
    WALKS,
    WHOLE,
    Stroll,
    one_after_another,
    strolled,
    truly_apart_m,
)
from studies.plain_features import ELF
from studies.repeats import finished
from studies.results import Record, seeds_text
from studies.study import SCENARIOS, Study, StudyContext

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
    """Errors of a map of some walks and of a query walk in it, its size, and one more walk's cost.

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
            (MAP, MEDIAN_ALIGNED): _median_m(walked, true),
            (query, MEDIAN_M): found.ok.median_m,
            (query, "third quartile (m)"): found.ok.q3_m,
            (query, "answered"): found.coverage,
            (MAP, "spots"): float(len(floor_map.xy_m)),
            (MAP, "memory (MB)"): map_bytes(floor_map) / 1e6,
            (MAP, "one more walk (s)"): _adding_s(floor_map, asked),
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


def _median_m(walked: Trajectory, true: Truth) -> float:
    errors_m = position_errors(walked.t_s, walked.world_from_body, true, Alignment.ALIGNED)
    return float(np.median(errors_m))


def _adding_s(floor_map: FloorMap, walk: MappedWalk) -> float:
    began_s = time.perf_counter()
    add_walk(floor_map, walk, MergeParameters())
    return time.perf_counter() - began_s


STUDY = Study(
    "Which walks of unknown starts are merged, rightly or wrongly, and what do many make of a map?",
    measure_merging, minutes=30, long=True, scenarios=("surveyor", "people"),
    fast={"worlds": ("studio", "lounge"), "seeds": (130, 131, 132),
          "pairs": {SAME: 1, OTHER: 1}, "walks": (2,)},
)  # fmt: skip
