"""Real floors: four fifths of the walks make the map, the others are located in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from elfslam.app.workers import Workers
from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.progress import Announce
from elfslam.base.values import WifiScans
from elfslam.scoring.bootstrap import interval
from elfslam.scoring.figures import SLAM
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.walks_figure import floor_of_walks
from studies.finding import Finding, Row
from studies.held_out import (
    FloorPlaces,
    at_each_place,
    floor_places,
    live,
    whole_walk,
    whole_walk_by_field,
)
from studies.labelled_neighbours import labelled_neighbours
from studies.mall_floor import (
    FLOORS,
    FloorWalk,
    archive_of,
    floor_turn,
    solved,
    turned,
    unturned_walks,
)
from studies.repeats import Numbers, finished

SPLITS = 5
MAPPED_BY = "wifi and magnetic"
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
    data: Path | None,
    announce: Announce,
    kept: Path | None = None,
    *,
    workers: Workers | None = None,
    floors: Sequence[str] = tuple(FLOORS),
    most_walks: int | None = None,
) -> Finding:
    """A row per floor and method: errors at the waypoints of walks that are held out in turn.

    `data` holds `mall_walks/*.tar.xz`. Raises InputError where they are missing.
    """
    tasks = [Split(floor, which) for floor in floors for which in range(SPLITS)]
    measure = partial(_measured, data=data, most_walks=most_walks)
    numbers = finished(measure, tasks, announce, kept=kept, workers=workers)
    rows: list[Row] = []
    panels: list[Panel] = []
    for floor in floors:
        found: Numbers = {}
        for task, each in zip(tasks, numbers, strict=True):
            found |= each if task.floor == floor else {}
        walks = _walks_on(floor, data, most_walks)
        rows += [
            fifths_row(floor, method, walks, _found(found, method, walks)) for method in METHODS
        ]
        panels.append(_panel(floor, walks, _found(found, TRAJECTORY, walks)))
    table = Panel("Errors", rows_table(rows), ROWS_NOTE, wide=True)
    return Finding(rows, Page("Located on a floor that others mapped", NOTE, [table, *panels]))


def located_walks(archive: Path, most: int | None) -> list[FloorWalk]:
    """The walks of a floor with two waypoints and Wi-Fi, as `unturned_walks` has them."""
    walks = unturned_walks(archive, most)
    kept = [walk for walk in walks if walk.recording.wifi is not None]
    if len(kept) < SPLITS:
        raise InputError(f"{archive}: got {len(kept)} walks with Wi-Fi, wanted {SPLITS} or more")
    return kept


def split_walks(
    walks: Sequence[FloorWalk], which: int
) -> tuple[list[FloorWalk], dict[int, FloorWalk]]:
    """The walks to be mapped, and by their number those that are held out.

    All are turned by the angle of the floor, which every second of the mapped walks tells.
    """
    mapped = [walk for number, walk in enumerate(walks) if number % SPLITS != which]
    turn_rad = floor_turn(mapped[::2])
    held = {number: turned(walks[number], turn_rad) for number in range(which, len(walks), SPLITS)}
    return [turned(walk, turn_rad) for walk in mapped], held


def positions(
    mapped: Sequence[FloorWalk], places: FloorPlaces, held: Sequence[FloorWalk]
) -> dict[str, list[F64]]:
    """Where each method has each held-out walk at its waypoints (k, 2), NaN for no answer."""
    known = [(_scans(walk), walk.truth) for walk in mapped]
    asked = [(_scans(walk), walk.truth) for walk in held]
    return {
        SOERENSEN: list(labelled_neighbours(asked, known, "Soerensen")),
        EUCLIDEAN: list(labelled_neighbours(asked, known, "Euclidean")),
        ONE_PLACE: [at_each_place(walk, places, walk.truth.t_s) for walk in held],
        LIVE: [live(walk, places, walk.truth.t_s) for walk in held],
        TRAJECTORY: [_at_waypoints(walk, whole_walk(walk, places)) for walk in held],
        WITH_FIELD: [_at_waypoints(walk, whole_walk_by_field(walk, places)) for walk in held],
    }


def _at_waypoints(walk: FloorWalk, poses: F64) -> F64:
    return interpolate_poses(walk.nodes.t_s, poses, walk.truth.t_s)[:, :2]


def fifths_row(floor: str, method: str, walks: Sequence[FloorWalk], found: Sequence[F64]) -> Row:
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
def _walks_on(floor: str, data: Path | None, most: int | None) -> list[FloorWalk]:
    return located_walks(archive_of(data, floor), most)


def _measured(split: Split, data: Path | None, most_walks: int | None) -> Numbers:
    mapped, held = split_walks(_walks_on(split.floor, data, most_walks), split.which)
    poses, _ = solved(mapped, MAPPED_BY)
    places = floor_places(mapped, poses)
    found = positions(mapped, places, list(held.values()))
    return {
        f"{method}|{number}|{k}|{axis}": float(value)
        for method, walks in found.items()
        for number, at in zip(held, walks, strict=True)
        for k, point in enumerate(at)
        for axis, value in zip("xy", point, strict=True)
    }


def _found(numbers: Numbers, method: str, walks: Sequence[FloorWalk]) -> list[F64]:
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


def _panel(floor: str, walks: Sequence[FloorWalk], found: Sequence[F64]) -> Panel:
    true = [walk.truth.world_from_body[:, :2] for walk in walks]
    return Panel(
        f"{floor}, located", floor_of_walks(found, found, true, SLAM), MAP_NOTE + TRAJECTORY
    )


def _scans(walk: FloorWalk) -> WifiScans:
    assert walk.recording.wifi is not None
    return walk.recording.wifi
