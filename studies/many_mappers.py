"""Strangers located in maps that many people's walks were merged into: errors by laps mapped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import plotly.graph_objects as go

from elfslam.app.settings import Settings
from elfslam.base.choices import Mode
from elfslam.base.values import Fixes, FixStatus, FloorMap, Trajectory, Truth
from elfslam.line.feature import extract_features
from elfslam.line.locate import locate_one_shot
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.merging import MappedWalk, MergeParameters, merge, walk_of
from elfslam.slam.merging.grow import map_of
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from elfslam.world.simulate import load_world
from studies.figures.curves import Curve, curves_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_interval, mean_of
from studies.localization import ELSEWHERE, ROUNDS, WORLDS, shipped
from studies.located import Stranger, at_its_start, fix_numbers, located_in, stranger
from studies.mapping import CALIBRATED, walkers
from studies.merged_walks import one_after_another
from studies.plain_features import ALWAYS, ELF, FEATURES, compared_encoders
from studies.repeats import Numbers, finished
from studies.simulated_walk import simulated_in
from studies.taps import tapped

SEEDS = tuple(range(10))
"""Of those who map, and of the strangers."""
COUNTS = (1, 2, 5, 10)
"""Of those who map."""
TAPS = (0, 4)
"""Places that each of them taps on the plan; without any they declare their start."""
METHODS = (
    *(mode.value for mode in Mode),
    *(f"{feature}, always answered" for feature in FEATURES),
)
MAPPED_WAY, ACROSS = "the mapped way", "across it"
WAYS = (MAPPED_WAY, ACROSS)
"""Where strangers walk, in lanes as those who map do."""
PLACE = ("world", "known by", "strangers walk")
LAPS = 2
"""Of each mapper, every other one the opposite way round."""


@dataclass(frozen=True)
class Crowd:
    """People who map a world, so many places tapped by each on its plan, and who asks.

    Who taps nothing declares a start. Maps are of the first few of them, as `counts` has it.
    """

    world: str
    kind: str
    taps: int
    counts: tuple[int, ...]
    seeds: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Mapper:
    """A walk that was mapped by echoes, as each feature hears it, and the truth."""

    by: Mapping[str, MappedWalk]
    truth: Truth


@dataclass(frozen=True, eq=False)
class Map:
    """The map of some walks, those of the walks by feature, and all walks as one with its truth."""

    floor_map: FloorMap
    by: Mapping[str, Sequence[FloorMap]]
    walked: Trajectory
    truth: Truth
    merged: int


def measure_many_mappers(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    counts: Sequence[int] = COUNTS,
    taps: Sequence[int] = TAPS,
    kind: Kind = PEOPLE,
) -> Finding:
    """Errors of fixes and shares answered, by how many people mapped and what they tapped."""
    tasks = [
        Crowd(world, kind.name, tapped, tuple(counts), tuple(seeds))
        for world in worlds
        for tapped in taps
    ]
    rows = [
        _row(task, count, way, method, numbers)
        for task, numbers in zip(tasks, finished(_measured, tasks, given), strict=True)
        for count in counts
        for way in WAYS
        for method in METHODS
    ]
    return Finding(rows, _page(rows))


def _measured(crowd: Crowd) -> Numbers:
    world, kind = load_world(crowd.world), kind_named(crowd.kind)
    elsewhere = load_world(ELSEWHERE.get(crowd.world, "studio"))
    walks = [_mapped(crowd, number) for number in range(max(crowd.counts))]
    maps = {count: _map(walks[:count]) for count in crowd.counts}
    numbers: Numbers = {}
    for count, made in maps.items():
        errors_m = position_errors(
            made.walked.t_s, made.walked.world_from_body, made.truth, Alignment.ALIGNED
        )
        found = {"map": float(np.median(errors_m)), "merged": float(made.merged)}
        numbers |= {f"{count}|{name}": value for name, value in found.items()}
    for seed in crowd.seeds:
        lost = stranger(elsewhere, seed, 1, shipped(), kind=kind)
        for way in WAYS:
            other = stranger(
                world, seed, ROUNDS, shipped(), kind=kind, on_mapped_way=way == MAPPED_WAY
            )
            for count, made in maps.items():
                found = _asked(made, other, lost)
                numbers |= {f"{count}|{seed}|{way}|{name}": each for name, each in found.items()}
    return numbers


def _asked(made: Map, other: Stranger, lost: Stranger) -> Numbers:
    """Errors of a stranger by each method, and what is answered to somebody who is not there."""
    numbers: Numbers = {}
    for method, fixes in _fixes(made, other):
        found = fix_numbers(fixes, other.truth, made.walked, made.truth)
        numbers |= {f"{method}|{name}": value for name, value in found.items()}
    for mode in Mode:
        status = located_in(made.floor_map, lost, mode, Settings()).status
        numbers[f"{mode.value}|elsewhere"] = float(np.mean(status == FixStatus.OK))
    return numbers


def _mapped(crowd: Crowd, number: int) -> Mapper:
    """What one of those who map brings home."""
    world, kind, seed = load_world(crowd.world), kind_named(crowd.kind), crowd.seeds[number]
    recording, truth = simulated_in(world, seed, LAPS, kind, reverse=number % 2 == 1)
    if crowd.taps:
        recording = replace(recording, checkpoints=tapped(truth, crowd.taps, seed))
    else:
        recording = at_its_start(recording, truth)
    run = map_by_echoes(recording, shipped(), walkers(seed, kind)[CALIBRATED])
    assert run.echoes is not None
    walk = replace(walk_of(run), name=f"walk {seed}")
    by = {
        feature: replace(walk, features=extract_features(run.echoes, encoder))
        for feature, encoder in compared_encoders().items()
    }
    return Mapper(by, truth)


def _map(walks: Sequence[Mapper]) -> Map:
    """The walks as one map, by echoes as the line has it, and by each feature walk by walk."""
    trajectories, floor_map = _merged([walk.by[ELF] for walk in walks])
    inside = [walk for walk in walks if walk.by[ELF].name in trajectories]
    walked, truth = one_after_another(
        [trajectories[walk.by[ELF].name] for walk in inside], [walk.truth for walk in inside]
    )
    single = {
        feature: [
            map_of(walk.by[feature], trajectories[walk.by[ELF].name], MergeParameters())
            for walk in inside
        ]
        for feature in compared_encoders()
    }
    return Map(floor_map, single, walked, truth, len(inside))


def _merged(walks: Sequence[MappedWalk]) -> tuple[dict[str, Trajectory], FloorMap]:
    """The walks in one frame by name, and their map."""
    known = MergeParameters()
    if len(walks) == 1:
        return {walks[0].name: walks[0].trajectory}, map_of(walks[0], walks[0].trajectory, known)
    made = merge(walks, known, known_starts=True).maps[0]
    return dict(zip(made.names, made.trajectories, strict=True)), made.floor_map


def _fixes(made: Map, other: Stranger) -> Iterator[tuple[str, Fixes]]:
    """By the shipped line in each mode; then by each feature, where the most alike spot is."""
    for mode in Mode:
        yield mode.value, located_in(made.floor_map, other, mode, Settings())
    for feature, encoder in compared_encoders().items():
        features = extract_features(other.echoes, encoder)
        each = [locate_one_shot(features, single, ALWAYS) for single in made.by[feature]]
        yield f"{feature}, always answered", _most_alike(each)


def _most_alike(fixes: Sequence[Fixes]) -> Fixes:
    """Of fixes in several maps at the same times the one of the highest score, time by time."""
    best = np.nan_to_num(np.array([each.score for each in fixes]), nan=-np.inf).argmax(axis=0)
    rows = np.arange(len(best))

    columns = ("status", "xy_m", "heading_rad", "covariance_m2", "score")
    chosen = {
        name: np.array([getattr(each, name) for each in fixes])[best, rows] for name in columns
    }
    return replace(fixes[0], **chosen)


def _row(crowd: Crowd, count: int, way: str, method: str, numbers: Numbers) -> Row:
    """Means over strangers, the median's with a 95 % interval, and the map that they were in."""

    def each(name: str) -> list[float]:
        asked = [f"{count}|{seed}|{way}|{method}|{name}" for seed in crowd.seeds]
        found = [numbers.get(key, np.nan) for key in asked]
        return [value for value in found if np.isfinite(value)]

    low, high = mean_interval(each("median"))
    return {
        "world": crowd.world,
        "known by": f"{crowd.taps} taps" if crowd.taps else "declared starts",
        "laps": LAPS * count,
        "strangers walk": way,
        "method": method,
        "median (m)": mean_of(each("median")),
        "from": low,
        "to": high,
        "mean (m)": mean_of(each("mean")),
        "Q3 (m)": mean_of(each("Q3")),
        "answered": mean_of(each("answered")),
        "over 1 m off": mean_of(each("gross")),
        "answered elsewhere": mean_of(each("elsewhere")),
        "map (m)": round(numbers[f"{count}|map"], 3),
        "merged": int(numbers[f"{count}|merged"]),
    }


def _page(rows: Sequence[Row]) -> Page:
    """Errors and shares answered against laps, and the table."""
    places = dict.fromkeys(tuple(str(row[name]) for name in PLACE) for row in rows)
    panels = [
        Panel(f"{', '.join(place)}: {name}", _curves(rows, place, name))
        for place in places
        for name in ("median (m)", "answered")
    ]
    return Page(
        "Maps of many people",
        "strangers of another day with another phone",
        [*panels, Panel("All of it", rows_table(rows), wide=True)],
    )


def _curves(rows: Sequence[Row], place: tuple[str, ...], name: str) -> go.Figure:
    here = [row for row in rows if tuple(str(row[key]) for key in PLACE) == place]
    mine = [row for row in here if row[name] is not None]
    curves = {
        method: Curve(
            *np.array([(row["laps"], row[name]) for row in mine if row["method"] == method], float)
            .reshape(-1, 2)
            .T
        )
        for method in METHODS
    }
    ticks = sorted({float(str(row["laps"])) for row in mine})
    return curves_figure(curves, "laps mapped", name, ticks=ticks)
