"""Walks of unknown starts: which are merged, rightly or wrongly, and what many make of a map."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.values import FloorMap
from elfslam.line.locate import LocateParameters, locate_one_shot
from elfslam.scoring.errors import Alignment, alignment_of, fix_errors, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.merging import MergeParameters, add_walk, merge
from elfslam.slam.merging.grow import map_of
from elfslam.world.kinds import SURVEYOR, Kind
from studies.figures.curves import Curve, curves_figure
from studies.figures.outcomes import outcomes_figure
from studies.finding import Finding, Given, Row
from studies.merged_walks import (
    FIRST,
    MOVED,
    SECOND,
    WHOLE,
    Stroll,
    one_after_another,
    strolled,
    truly_apart_m,
)
from studies.repeats import Numbers, finished

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(10))
SAME, PARTLY, OTHER, APART = "same way", "part of the way", "two worlds", "no common ground"
OPPOSITE, CHANGED = "the other way round", "furniture moved"
HUNDRED: Mapping[str, int] = {SAME: 50, PARTLY: 10, OTHER: 30, APART: 10}
BESIDES: Mapping[str, int] = {OPPOSITE: 10, CHANGED: 10}
OVERLAPPING = (SAME, PARTLY)
RIGHT_M = 1.0
"""Walks that typically are less far apart where the map has them together are merged rightly."""
WALKS = (1, 2, 4, 8)
OUTCOMES = ("right", "refused", "wrong")


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
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    pairs: Mapping[str, int] | None = None,
    walks: Sequence[int] = WALKS,
    kind: Kind = SURVEYOR,
) -> Finding:
    """Outcomes of random pairs of walks, and maps of 1 to 8 walks."""
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
    numbers = finished(_measured, tasks, given)
    found = dict(zip(tasks, numbers, strict=True))
    outcomes = {
        common: _counted([found[pair] for pair in drawn if pair.common == common])
        for common in wanted
    }
    growth = _whole(
        [{"world": each.world, "walks": len(each.walks), **_rounded(found[each])} for each in grown]
    )
    rows: list[Row] = [{"pairs": common, **counts} for common, counts in outcomes.items()]
    return Finding(_together(outcomes, rows, growth), _page(outcomes, rows, growth))


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


def _measured(task: Pair | Growth) -> Numbers:
    return _pair(task) if isinstance(task, Pair) else _growth(task)


def _pair(pair: Pair) -> Numbers:
    """What came of a pair: right, wrong or refused, and its error where it was merged."""
    (one, one_truth), (other, other_truth) = strolled(pair.one), strolled(pair.other)
    made = merge([one, other], MergeParameters())
    if not made.maps:
        return {"refused": 1.0}
    if pair.common in (OTHER, APART):
        return {"wrong": 1.0}
    apart_m = truly_apart_m(made.maps[0].trajectories, [one_truth, other_truth])
    typical_m = float(np.median(apart_m)) if len(apart_m) else np.inf
    return {"right" if typical_m < RIGHT_M else "wrong": 1.0, "apart (m)": min(typical_m, 1e3)}


def _growth(growth: Growth) -> Numbers:
    """Errors of a map of some walks and of a stranger in it, its size, and the last walk's cost."""
    parameters = MergeParameters()
    strolls = [
        strolled(Stroll(growth.world, seed, later=number % 2 == 1, kind=growth.kind))
        for number, seed in enumerate(growth.walks)
    ]
    walks, truths = zip(*strolls, strict=True)
    if len(walks) == 1:
        trajectories, inside = [walks[0].trajectory], list(truths)
        floor_map = map_of(walks[0], walks[0].trajectory, parameters)
    else:
        made = merge(walks, parameters).maps
        if not made:
            return {"merged": 1.0}
        named = {walk.name: truth for walk, truth in zip(walks, truths, strict=True)}
        trajectories, inside = list(made[0].trajectories), [named[name] for name in made[0].names]
        floor_map = made[0].floor_map
    stranger, truth = strolled(Stroll(growth.world, growth.stranger, later=True, kind=growth.kind))
    fixes = locate_one_shot(stranger.features, floor_map, LocateParameters())
    walked, true = one_after_another(trajectories, inside)
    found = fix_errors(fixes, truth, alignment_of(walked, true))
    errors_m = position_errors(walked.t_s, walked.world_from_body, true, Alignment.ALIGNED)
    began_s = time.perf_counter()
    add_walk(floor_map, stranger, parameters)
    return {
        "merged": float(len(trajectories)),
        "map error (m)": float(np.median(errors_m)),
        "one-shot error (m)": found.ok.median_m,
        "one-shot Q3 (m)": found.ok.q3_m,
        "answered": found.coverage,
        "spots": float(len(floor_map.xy_m)),
        "memory (MB)": _megabytes(floor_map),
        "one more walk (s)": time.perf_counter() - began_s,
    }


def _megabytes(floor_map: FloorMap) -> float:
    arrays = [value for value in vars(floor_map).values() if isinstance(value, np.ndarray)]
    return sum(each.nbytes for each in [*arrays, *(p.vectors for p in floor_map.payloads)]) / 1e6


def _counted(found: Sequence[Numbers]) -> dict[str, int]:
    return {name: sum(name in each for each in found) for name in OUTCOMES}


def _rounded(numbers: Numbers) -> Row:
    return {
        name: round(value, 3) if np.isfinite(value) else None for name, value in numbers.items()
    }


def _overlapping(outcomes: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
    """The outcomes of all pairs that share ground in the same direction."""
    return {
        name: sum(outcomes.get(common, {}).get(name, 0) for common in OVERLAPPING)
        for name in OUTCOMES
    }


def _together(
    outcomes: Mapping[str, Mapping[str, int]], rows: Sequence[Row], growth: Sequence[Row]
) -> list[Row]:
    """Both tables as one; the overlapping pairs summed up."""
    return _whole([*rows, {"pairs": "all that overlap", **_overlapping(outcomes)}, *growth])


def _whole(rows: Sequence[Row]) -> list[Row]:
    """Rows that have all columns of all; empty where nothing was merged."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return [{name: row.get(name) for name in names} for row in rows]


def _page(
    outcomes: Mapping[str, Mapping[str, int]], rows: Sequence[Row], growth: Sequence[Row]
) -> Page:
    total = _overlapping(outcomes)
    overlapping = max(sum(total.values()), 1)
    wrong = sum(counts["wrong"] for counts in outcomes.values())
    panels = [
        Panel("How pairs came out", outcomes_figure(outcomes, "pairs"), PAIRS_NOTE, wide=True),
        *(_growth_panel(growth, name) for name in ("map error (m)", "one-shot error (m)")),
        *(_growth_panel(growth, name) for name in ("answered", "one more walk (s)")),
        Panel("Pairs", rows_table(rows), wide=True),
        Panel("Maps of several walks", rows_table(growth), GROWTH_NOTE, wide=True),
    ]
    tiles = {
        "of the overlapping merged rightly": f"{total['right'] / overlapping:.0%}",
        "merged wrongly": str(wrong),
        "pairs": str(sum(sum(counts.values()) for counts in outcomes.values())),
    }
    return Page("Merging walks", "unknown starts, one map", panels, tiles=tiles)


PAIRS_NOTE = (
    "Two people each, with routes, rounds and starting corners of their own; nobody knows where "
    "they began, and the second walks on another day with another phone. Right: of the footsteps "
    f"that the map puts together, half were truly within {RIGHT_M:g} m of each other."
)
GROWTH_NOTE = (
    "Map error: median over all footsteps, all walks aligned together. One-shot: a "
    "stranger in 0.6 s, of the windows answered."
)


def _growth_panel(growth: Sequence[Row], name: str) -> Panel:
    curves = {}
    for world in dict.fromkeys(str(row["world"]) for row in growth):
        rows = [row for row in growth if row["world"] == world and row.get(name) is not None]
        numbers = np.array([(row["walks"], row[name]) for row in rows], dtype=np.float64)
        curves[world] = Curve(*numbers.reshape(-1, 2).T)
    ticks = sorted({float(str(row["walks"])) for row in growth})
    return Panel(name.capitalize(), curves_figure(curves, "walks in the map", name, ticks=ticks))
