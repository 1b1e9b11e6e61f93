"""Real floors: four fifths of the walks make the map, the others are located in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.choices import Modality
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Fixes, Trajectory, WifiScans
from elfslam.baselines.floor_places import (
    FloorPlaces,
    at_each_place,
    floor_places,
    known_by,
    whole_walk,
)
from elfslam.baselines.floor_walks import FloorParameters, floor_map, floor_turn, solved, turned
from elfslam.scoring.bootstrap import interval
from elfslam.scoring.figures import SLAM
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.walks_figure import floor_of_walks
from studies.finding import Finding, Given, Row
from studies.labelled_neighbours import labelled_neighbours
from studies.mall_floor import FLOORS, SurveyedWalk, archive_of, surveyed_walks
from studies.repeats import Numbers, finished

SPLITS = 5
MAPPED_BY = (Modality.WIFI, Modality.MAGNETIC)
SOERENSEN, EUCLIDEAN = "Wi-Fi, labelled, Soerensen", "Wi-Fi, labelled, Euclidean"
ONE_PLACE, LIVE = "Wi-Fi, one place", "Wi-Fi, live"
TRAJECTORY, WITH_FIELD = "Wi-Fi, whole walk", "Wi-Fi and magnetic, whole walk"
METHODS = (SOERENSEN, EUCLIDEAN, ONE_PLACE, LIVE, TRAJECTORY, WITH_FIELD)
NOTE = (
    "Every fifth walk is located in the map that the others make. Mapped walks begin at a known "
    "place, those to be located anywhere. Labelled rivals know where every mapped scan was made."
)
ROWS_NOTE = (
    "Errors at all waypoints that got an answer, of every walk once; in brackets 95 %, over walks. "
    "Labelled: the three most alike scans, whose true positions are known. One place: what is "
    "heard around the waypoint. Live: what was known by then. Whole walk: all of it, afterwards."
)
MAP_NOTE = (
    "Dots: waypoints. Red lines lead to where they are thought to be; these are joined to "
    "walks. By: "
)


@dataclass(frozen=True)
class Split:
    """The walks of a floor of which every fifth, from `which` on, is held out."""

    floor: str
    which: int


def measure_mall_fifths(
    given: Given, *, floors: Sequence[str] = tuple(FLOORS), most_walks: int | None = None
) -> Finding:
    """A row per floor and method: errors at the waypoints of walks that are held out in turn.

    `data` holds `mall_walks/*.tar.xz`. Raises InputError where they are missing.
    """
    tasks = [Split(floor, which) for floor in floors for which in range(SPLITS)]
    measure = partial(_measured, data=given.data, most_walks=most_walks)
    numbers = finished(measure, tasks, given)
    rows: list[Row] = []
    panels: list[Panel] = []
    for floor in floors:
        found: Numbers = {}
        for task, each in zip(tasks, numbers, strict=True):
            found |= each if task.floor == floor else {}
        walks = _walks_on(floor, given.data, most_walks)
        rows += [
            fifths_row(floor, method, walks, _found(found, method, walks)) for method in METHODS
        ]
        panels.append(_panel(floor, walks, _found(found, TRAJECTORY, walks)))
    table = Panel("Errors", rows_table(rows), ROWS_NOTE, wide=True)
    return Finding(rows, Page("Located on a floor that others mapped", NOTE, [table, *panels]))


def located_walks(archive: Path, most: int | None) -> list[SurveyedWalk]:
    """The walks of a floor with two waypoints and Wi-Fi, as `surveyed_walks` has them."""
    walks = surveyed_walks(archive, most)
    kept = [walk for walk in walks if walk.recording.wifi is not None]
    if len(kept) < SPLITS:
        raise InputError(f"{archive}: got {len(kept)} walks with Wi-Fi, wanted {SPLITS} or more")
    return kept


def split_walks(
    walks: Sequence[SurveyedWalk], which: int
) -> tuple[list[SurveyedWalk], dict[int, SurveyedWalk]]:
    """The walks to be mapped, and by their number those that are held out.

    All are turned by the angle of the floor that the mapped walks tell.
    """
    mapped = [walk for number, walk in enumerate(walks) if number % SPLITS != which]
    turn_rad = floor_turn(mapped, FloorParameters()).turn_rad
    held = {number: turned(walks[number], turn_rad) for number in range(which, len(walks), SPLITS)}
    return [turned(walk, turn_rad) for walk in mapped], held


def positions(
    mapped: Sequence[SurveyedWalk], places: FloorPlaces, held: Sequence[SurveyedWalk]
) -> dict[str, list[F64]]:
    """Where each method has each held-out walk at its waypoints (k, 2), NaN for no answer."""
    known = [(_scans(walk), walk.truth) for walk in mapped]
    asked = [(_scans(walk), walk.truth) for walk in held]
    by_wifi = replace(places, levels=None)
    return {
        SOERENSEN: list(labelled_neighbours(asked, known, "Soerensen")),
        EUCLIDEAN: list(labelled_neighbours(asked, known, "Euclidean")),
        ONE_PLACE: [_between_fixes(at_each_place(walk, places), walk) for walk in held],
        LIVE: [_live(walk, by_wifi) for walk in held],
        TRAJECTORY: [_at_waypoints(walk, whole_walk(walk, by_wifi)) for walk in held],
        WITH_FIELD: [_at_waypoints(walk, whole_walk(walk, places)) for walk in held],
    }


def _between_fixes(fixes: Fixes, walk: SurveyedWalk) -> F64:
    """Positions (k, 2) at the waypoints, between the fixes before and after."""
    good, at_s = np.isfinite(fixes.xy_m[:, 0]), walk.truth.t_s
    if not good.any():
        return np.full((len(at_s), 2), np.nan)
    t_s, xy_m = fixes.t_s[good], fixes.xy_m[good]
    return np.column_stack([np.interp(at_s, t_s, column) for column in xy_m.T])


def _live(walk: SurveyedWalk, places: FloorPlaces) -> F64:
    """Positions (k, 2), each the last footstep of what was known by then."""
    counts = np.searchsorted(walk.nodes.t_s, walk.truth.t_s, side="right")
    known = [known_by(walk, places, int(count)) for count in counts]
    nowhere = np.full(2, np.nan)
    return np.array([nowhere if each is None else each.world_from_body[-1, :2] for each in known])


def _at_waypoints(walk: SurveyedWalk, found: Trajectory | None) -> F64:
    if found is None:
        return np.full((len(walk.truth.t_s), 2), np.nan)
    return interpolate_poses(found.t_s, found.world_from_body, walk.truth.t_s)[:, :2]


def fifths_row(floor: str, method: str, walks: Sequence[SurveyedWalk], found: Sequence[F64]) -> Row:
    """Errors of one method over all walks, from its positions (k, 2) at their waypoints."""
    errors = [
        np.linalg.norm(at - walk.truth.world_from_body[:, :2], axis=1)
        for walk, at in zip(walks, found, strict=True)
    ]
    each = np.concatenate(errors)
    answered = [some[np.isfinite(some)] for some in errors]
    given = np.concatenate(answered)
    row: Row = {
        "floor": floor,
        "used to": FLOORS.get(floor, "develop"),
        "method": method,
        "walks": len(walks),
        "waypoints": len(each),
        "answered (%)": round(100 * len(given) / len(each), 1),
    }
    for name, statistic in STATISTICS.items():
        low, high = interval(answered, statistic, np.random.default_rng(0))
        row[f"{name} (m)"] = f"{statistic(given):.1f} [{low:.1f}, {high:.1f}]"
    return row


STATISTICS: Mapping[str, Callable[[F64], float]] = {
    "median": lambda errors: float(np.median(errors)),
    "mean": lambda errors: float(np.mean(errors)),
    "third quartile": lambda errors: float(np.quantile(errors, 0.75)),
}


@cache
def _walks_on(floor: str, data: Path | None, most: int | None) -> list[SurveyedWalk]:
    return located_walks(archive_of(data, floor), most)


def _measured(split: Split, data: Path | None, most_walks: int | None) -> Numbers:
    mapped, held = split_walks(_walks_on(split.floor, data, most_walks), split.which)
    parameters = FloorParameters()
    trajectories, _ = solved(mapped, MAPPED_BY, parameters)
    known = floor_map(mapped, trajectories, MAPPED_BY, parameters)
    places = floor_places(known, MAPPED_BY, parameters)
    found = positions(mapped, places, list(held.values()))
    return {
        f"{method}|{number}|{k}|{axis}": float(value)
        for method, walks in found.items()
        for number, at in zip(held, walks, strict=True)
        for k, point in enumerate(at)
        for axis, value in zip("xy", point, strict=True)
    }


def _found(numbers: Numbers, method: str, walks: Sequence[SurveyedWalk]) -> list[F64]:
    """The positions (k, 2) of one method at the waypoints of each walk."""
    return [
        np.array(
            [
                [numbers[f"{method}|{number}|{k}|{axis}"] for axis in "xy"]
                for k in range(len(walk.truth.t_s))
            ]
        )
        for number, walk in enumerate(walks)
    ]


def _panel(floor: str, walks: Sequence[SurveyedWalk], found: Sequence[F64]) -> Panel:
    true = [walk.truth.world_from_body[:, :2] for walk in walks]
    return Panel(
        f"{floor}, located", floor_of_walks(found, found, true, SLAM), MAP_NOTE + TRAJECTORY
    )


def _scans(walk: SurveyedWalk) -> WifiScans:
    assert walk.recording.wifi is not None
    return walk.recording.wifi
