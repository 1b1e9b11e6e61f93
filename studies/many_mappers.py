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
from elfslam.slam.front_end import hear
from elfslam.slam.merging import MappedWalk, MergeParameters, merge, walk_of
from elfslam.slam.merging.grow import map_of
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from elfslam.world.simulate import load_world, simulate
from studies.figures.curves import Curve, curves_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_interval, mean_of
from studies.localization import ALWAYS, ELSEWHERE, ROUNDS, WORLDS, shipped
from studies.located import Stranger, at_its_start, fix_numbers, located_in, stranger
from studies.mapping_errors import CALIBRATED, walkers
from studies.merged_walks import one_after_another
from studies.plain_features import ELF, PLAIN, ROOT, compared_encoders
from studies.repeats import Numbers, finished

SEEDS = tuple(range(10))
"""Of those who map, and of the strangers."""
MAPPERS = (1, 2, 5, 10)
METHODS = (
    *(mode.value for mode in Mode),
    *(f"{feature}, always answered" for feature in (ELF, PLAIN, ROOT)),
)
LAPS = 2
"""Of each mapper, every other one the opposite way round."""


@dataclass(frozen=True)
class Crowd:
    """People who map a world, each from a declared start, and strangers who ask."""

    world: str
    kind: str
    mappers: tuple[int, ...]
    strangers: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Mapper:
    """A walk that was mapped by echoes, as each feature hears it, and the truth."""

    by: Mapping[str, MappedWalk]
    truth: Truth


def measure_many_mappers(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    mappers: Sequence[int] = MAPPERS,
    kind: Kind = PEOPLE,
) -> Finding:
    """Errors of fixes and shares answered, by how many people mapped."""
    tasks = [
        Crowd(world, kind.name, tuple(seeds[:count]), tuple(seeds))
        for world in worlds
        for count in mappers
    ]
    rows = [
        row
        for task, numbers in zip(tasks, finished(_measured, tasks, given), strict=True)
        for row in _rows(task, numbers)
    ]
    return Finding(rows, _page(rows))


def _measured(crowd: Crowd) -> Numbers:
    world, kind = load_world(crowd.world), kind_named(crowd.kind)
    walks = [_mapped(crowd, k) for k in range(len(crowd.mappers))]
    trajectories, floor_map = _merged([walk.by[ELF] for walk in walks])
    inside = [walk for walk in walks if walk.by[ELF].name in trajectories]
    known = [walk.truth for walk in inside]
    walked, true = one_after_another(list(trajectories.values()), known)
    errors_m = position_errors(walked.t_s, walked.world_from_body, true, Alignment.ALIGNED)
    numbers: Numbers = {"map": float(np.median(errors_m)), "merged": float(len(trajectories))}
    maps = {
        feature: [
            map_of(walk.by[feature], trajectories[walk.by[ELF].name], MergeParameters())
            for walk in inside
        ]
        for feature in compared_encoders()
    }
    for seed in crowd.strangers:
        other = stranger(world, seed, ROUNDS, shipped(), kind=kind)
        lost = stranger(load_world(ELSEWHERE.get(crowd.world, "studio")), seed, 1, shipped(),
                        kind=kind)  # fmt: skip
        for method, fixes in _fixes(floor_map, maps, other):
            found = fix_numbers(fixes, other.truth, walked, true)
            numbers |= {f"{seed}|{method}|{name}": value for name, value in found.items()}
        for mode in Mode:
            status = located_in(floor_map, lost, mode, Settings()).status
            numbers[f"{seed}|{mode.value}|elsewhere"] = float(np.mean(status == FixStatus.OK))
    return numbers


def _mapped(crowd: Crowd, number: int) -> Mapper:
    """What one of those who map brings home."""
    world, kind, seed = load_world(crowd.world), kind_named(crowd.kind), crowd.mappers[number]
    recording, truth = simulate(
        world, seed, rounds=LAPS, reverse=number % 2 == 1, walker=kind.walker,
        circumstances=kind.mapping(world.room),
    )  # fmt: skip
    run = map_by_echoes(at_its_start(recording, truth), shipped(), walkers(seed, kind)[CALIBRATED])
    assert run.echoes is not None
    walk = replace(walk_of(run), name=f"walk {seed}")
    return Mapper(
        {
            feature: replace(walk, features=extract_features(run.echoes, encoder))
            for feature, encoder in compared_encoders().items()
        },
        truth,
    )


def _merged(walks: Sequence[MappedWalk]) -> tuple[dict[str, Trajectory], FloorMap]:
    """The walks in one frame by name, and their map."""
    known = MergeParameters()
    if len(walks) == 1:
        return {walks[0].name: walks[0].trajectory}, map_of(walks[0], walks[0].trajectory, known)
    made = merge(walks, known, known_starts=True).maps[0]
    return dict(zip(made.names, made.trajectories, strict=True)), made.floor_map


def _fixes(
    floor_map: FloorMap, maps: Mapping[str, Sequence[FloorMap]], other: Stranger
) -> Iterator[tuple[str, Fixes]]:
    """By the shipped line in each mode; then by each feature, where the most alike spot is."""
    for mode in Mode:
        yield mode.value, located_in(floor_map, other, mode, Settings())
    echoes = hear(other.recording, Settings())
    for feature, encoder in compared_encoders().items():
        features = extract_features(echoes, encoder)
        each = [locate_one_shot(features, single, ALWAYS) for single in maps[feature]]
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


def _rows(crowd: Crowd, numbers: Numbers) -> list[Row]:
    """A row for each way of being located: means over strangers, and the map that they were in."""
    return [_row(crowd, numbers, method) for method in METHODS]


def _row(crowd: Crowd, numbers: Numbers, method: str) -> Row:
    def each(name: str) -> list[float]:
        found = [numbers.get(f"{seed}|{method}|{name}", np.nan) for seed in crowd.strangers]
        return [value for value in found if np.isfinite(value)]

    low, high = mean_interval(each("median"))
    return {
        "world": crowd.world,
        "laps": LAPS * len(crowd.mappers),
        "method": method,
        "median (m)": mean_of(each("median")),
        "from": low,
        "to": high,
        "mean (m)": mean_of(each("mean")),
        "Q3 (m)": mean_of(each("Q3")),
        "answered": mean_of(each("answered")),
        "over 1 m off": mean_of(each("gross")),
        "answered elsewhere": mean_of(each("elsewhere")),
        "map (m)": round(numbers["map"], 3),
        "merged": int(numbers["merged"]),
    }


def _page(rows: Sequence[Row]) -> Page:
    """Errors and shares answered against laps, and the table."""
    panels = [
        Panel(f"{world}: {name}", _curves(rows, world, name), wide=False)
        for world in dict.fromkeys(str(row["world"]) for row in rows)
        for name in ("median (m)", "answered")
    ]
    return Page(
        "Maps of many people",
        "each from a declared start; strangers of another day with another phone",
        [*panels, Panel("All of it", rows_table(rows), wide=True)],
    )


def _curves(rows: Sequence[Row], world: str, name: str) -> go.Figure:
    mine = [row for row in rows if row["world"] == world and row[name] is not None]
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
