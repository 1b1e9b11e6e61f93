"""All walks of a mall floor in one map: Wi-Fi and the magnetic field between people's walks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.choices import Modality
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Truth
from elfslam.baselines.floor_walks import (
    FloorParameters,
    FloorTurn,
    FloorWalk,
    floor_turn,
    floor_walk,
    solved,
    turned,
)
from elfslam.data.importing import declared_start
from elfslam.data.log_files import Imported
from elfslam.data.mall import read_walk, walks_in
from elfslam.line.motion import MotionParameters
from elfslam.scoring.figures import DEAD_RECKONING, SLAM
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.walks_figure import floor_of_walks
from studies.finding import Finding, Given, Row

FLOORS = {"F1": "develop", "F4": "report"}
RECKONED, TOGETHER = "dead reckoning", "wifi and magnetic"
METHODS: Mapping[str, tuple[Modality, ...]] = {
    RECKONED: (),
    "magnetic": (Modality.MAGNETIC,),
    "wifi": (Modality.WIFI,),
    TOGETHER: (Modality.WIFI, Modality.MAGNETIC),
}
NOTE = (
    "Walks of many people at many times, each from its known start with the heading of the phone's "
    "own sensors. Dots: waypoints. Lines lead from each to where the walk is thought to have been."
)
ROWS_NOTE = (
    "Errors at the waypoints after the start; nothing is aligned, and the angle from compass to "
    "floor is what the walks themselves tell. Found: walks with a closure to another."
)


@dataclass(frozen=True, eq=False)
class SurveyedWalk(FloorWalk):
    """A walk whose waypoints are known; the first is its declared start."""

    truth: Truth


def measure_mall_floor(
    given: Given, *, floors: Sequence[str] = tuple(FLOORS), most_walks: int | None = None
) -> Finding:
    """A row per floor and method: errors at the waypoints of walks that are solved together.

    `data` holds `mall_walks/*.tar.xz`. `most_walks` takes the first few of each floor alone.
    Raises InputError where they are missing.
    """
    rows: list[Row] = []
    panels: list[Panel] = []
    parameters = FloorParameters()
    for floor in floors:
        given.announce(f"reading {floor}", None)
        walks = surveyed_walks(archive_of(given.data, floor), most_walks)
        turn = floor_turn(walks, parameters)
        walks = [turned(walk, turn.turn_rad) for walk in walks]
        poses: dict[str, list[F64]] = {}
        for k, method in enumerate(METHODS):
            given.announce(f"{floor}: {method}", k / len(METHODS))
            poses[method], found = _solved(walks, METHODS[method])
            errors = [
                waypoint_errors(walk, each) for walk, each in zip(walks, poses[method], strict=True)
            ]
            rows.append(_row(floor, FLOORS[floor], method, errors, found, turn))
        panels += _panels(floor, walks, poses)
    table = Panel("Errors", rows_table(rows), ROWS_NOTE, wide=True)
    return Finding(rows, Page("A floor from everybody's walks", NOTE, [table, *panels]))


def surveyed_walks(archive: Path, most: int | None) -> list[SurveyedWalk]:
    """The walks of a floor with two waypoints or more, headed by their phones."""
    walks = [read_walk(path) for path in islice(walks_in(archive), most)]
    return [_surveyed(walk, walk.truth) for walk in walks if walk.truth and len(walk.truth.t_s) > 1]


def _surveyed(walk: Imported, truth: Truth) -> SurveyedWalk:
    """The walk from its first waypoint."""
    known = floor_walk(declared_start(walk), MotionParameters())
    return SurveyedWalk(known.recording, known.nodes, known.by_compass, truth)


def _solved(walks: Sequence[SurveyedWalk], by: Sequence[Modality]) -> tuple[list[F64], float]:
    """Poses of each walk, and the share of the walks with a closure to another."""
    if not by:
        return [walk.nodes.world_from_body for walk in walks], 0.0
    trajectories, found = solved(walks, by, FloorParameters())
    return [each.world_from_body for each in trajectories], found


def waypoint_errors(walk: SurveyedWalk, poses: F64) -> F64:
    """Distances (k) in metres at the waypoints after the first, in the floor's own frame."""
    at = interpolate_poses(walk.nodes.t_s, poses, walk.truth.t_s[1:])
    return np.asarray(np.linalg.norm(at[:, :2] - walk.truth.world_from_body[1:, :2], axis=1))


def archive_of(data: Path | None, floor: str) -> Path:
    """Where the walks of a floor lie. Raises InputError where there is no data at all."""
    if data is None:
        raise InputError("mall floor: wanted real walks; set ELFSLAM_DATA to the folder of them")
    return data / "mall_walks" / f"site1-{floor}.tar.xz"


def _row(
    floor: str, use: str, method: str, errors: Sequence[F64], found: float, turn: FloorTurn
) -> Row:
    each = np.concatenate(errors)
    return {
        "floor": floor,
        "used to": use,
        "method": method,
        "walks": len(errors),
        "waypoints": len(each),
        "median (m)": round(float(np.median(each)), 2),
        "mean (m)": round(float(each.mean()), 2),
        "third quartile (m)": round(float(np.quantile(each, 0.75)), 2),
        "found (%)": round(100 * found),
        "turned (degrees)": f"{np.rad2deg(turn.turn_rad):.1f} +- {np.rad2deg(turn.sigma_rad):.1f}",
    }


def _panels(floor: str, walks: Sequence[SurveyedWalk], poses: dict[str, list[F64]]) -> list[Panel]:
    """The floor before and after."""
    shown = {RECKONED: DEAD_RECKONING, TOGETHER: SLAM}
    panels = []
    for method, color in shown.items():
        at = [
            interpolate_poses(walk.nodes.t_s, each, walk.truth.t_s)[:, :2]
            for walk, each in zip(walks, poses[method], strict=True)
        ]
        true = [walk.truth.world_from_body[:, :2] for walk in walks]
        figure = floor_of_walks([each[:, :2] for each in poses[method]], at, true, color)
        panels.append(Panel(f"{floor}, {method}", figure))
    return panels
