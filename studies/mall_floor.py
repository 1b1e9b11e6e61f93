"""All walks of a mall floor in one map: Wi-Fi and the magnetic field between people's walks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose, interpolate_poses, wrap_angle
from elfslam.base.progress import Announce
from elfslam.base.values import Odometry, Orientation, Recording, Truth
from elfslam.baselines.magnetic import LOOKS_AHEAD
from elfslam.baselines.neighbours import (
    NeighbourParameters,
    candidates,
    field_weights,
    field_windows,
    neighbour_closures,
)
from elfslam.baselines.wifi import (
    Fingerprints,
    WifiFingerprintParameters,
    fingerprints,
    wifi_scores,
)
from elfslam.data.mall import read_walk, walks_in
from elfslam.line.motion import MotionParameters, dead_reckon
from elfslam.scoring.figures import DEAD_RECKONING, SLAM
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.walks_figure import floor_of_walks
from studies.finding import Finding, Row
from studies.floor_graph import corrected, thinned, thinned_rows

FLOORS = {"F1": "develop", "F4": "report"}
METHODS = ("dead reckoning", "magnetic", "wifi", "wifi and magnetic")
FIRST_LEG_M = 3.0
NOTE = (
    "Walks of many people at many times, each from its known start with the heading of the phone's "
    "own sensors. Dots: waypoints. Lines lead from each to where the walk is thought to have been."
)
ROWS_NOTE = (
    "Errors at the waypoints after the start, of the walks that the floor's rotation was not "
    "fitted on; nothing is aligned. Found: walks with a closure to another."
)


@dataclass(frozen=True, eq=False)
class FloorWalk:
    """A walk as dead reckoning has it from its known start, and what it passed by."""

    recording: Recording
    truth: Truth
    nodes: Odometry


def measure_mall_floor(
    data: Path | None,
    announce: Announce,
    *,
    floors: Sequence[str] = tuple(FLOORS),
    most_walks: int | None = None,
) -> Finding:
    """A row per floor and method: errors at the waypoints of walks that are solved together.

    `data` holds `mall_walks/*.tar.xz`. `most_walks` takes the first few of each floor alone.
    Raises InputError where they are missing.
    """
    rows: list[Row] = []
    panels: list[Panel] = []
    for floor in floors:
        announce(f"reading {floor}", None)
        walks = floor_walks(archive_of(data, floor), most_walks)
        poses: dict[str, list[F64]] = {}
        for k, method in enumerate(METHODS):
            announce(f"{floor}: {method}", k / len(METHODS))
            poses[method], found = solved(walks, method)
            errors = [
                waypoint_errors(walk, each) for walk, each in zip(walks, poses[method], strict=True)
            ]
            rows.append(_row(floor, FLOORS[floor], method, errors[1::2], found))
        panels += _panels(floor, walks, poses)
    table = Panel("Errors", rows_table(rows), ROWS_NOTE, wide=True)
    return Finding(rows, Page("A floor from everybody's walks", NOTE, [table, *panels]))


def floor_walks(archive: Path, most: int | None) -> list[FloorWalk]:
    """The walks of a floor with two waypoints or more, from their starts.

    The heading is that of the rotation vector, over the whole walk, turned by one angle a floor:
    the mean over every second walk of how its first leg lies against the waypoints.
    """
    walks = unturned_walks(archive, most)
    turn_rad = floor_turn(walks[::2])
    return [turned(walk, turn_rad) for walk in walks]


def unturned_walks(archive: Path, most: int | None) -> list[FloorWalk]:
    """Those walks with the heading as the phone has it, that of the floor's drawing unknown."""
    walks = [read_walk(path) for path in islice(walks_in(archive), most)]
    known = [walk for walk in walks if len(walk.truth.t_s) > 1]
    return [_placed(walk.recording, walk.truth) for walk in known]


def floor_turn(walks: Sequence[FloorWalk]) -> float:
    """The angle in radians by which these walks have to be turned for their first legs to fit."""
    turns = [_first_leg_turn(walk) for walk in walks]
    return float(np.angle(np.exp(1j * np.array(turns)).mean()))


def turned(walk: FloorWalk, turn_rad: float) -> FloorWalk:
    """The walk turned about its start."""
    start = walk.nodes.world_from_body[0]
    own = between(start, walk.nodes.world_from_body)
    poses = compose(start + np.array([0.0, 0.0, turn_rad]), own)
    return replace(walk, nodes=replace(walk.nodes, world_from_body=poses))


def compass_turn(orientation: Orientation, nodes: Odometry) -> float:
    """How far (radians) a walk has to be turned so that its mean heading is the phone's."""
    ahead = _yaw_rad(orientation, nodes.t_s) - nodes.world_from_body[:, 2]
    return float(np.angle(np.exp(1j * ahead).mean()))


def solved(walks: Sequence[FloorWalk], method: str) -> tuple[list[F64], float]:
    """Poses of each walk, and the share of the walks with a closure to another."""
    odometry = [walk.nodes for walk in walks]
    if method == "dead reckoning":
        return [nodes.world_from_body for nodes in odometry], 0.0
    parameters = NeighbourParameters()
    sparse = [thinned(nodes) for nodes in odometry]
    counts = [len(nodes.t_s) for nodes in sparse]
    walk_of = np.repeat(np.arange(len(walks), dtype=np.int64), counts)
    poses = np.vstack([nodes.world_from_body for nodes in sparse])
    near = candidates(poses[:, :2], walk_of, parameters)
    weights = near.astype(np.float64)
    if "magnetic" in method:
        windows = np.vstack([_windows(walk, parameters) for walk in walks])
        weights *= field_weights(windows, poses[:, 2], near, parameters)
    if "wifi" in method:
        weights *= _wifi_weights(walks, near, walk_of) ** parameters.wifi_power
    closures = neighbour_closures(weights, parameters)
    found = np.unique(walk_of[np.concatenate([closures.i, closures.j])])
    return corrected(odometry, closures), len(found) / len(walks)


def waypoint_errors(walk: FloorWalk, poses: F64) -> F64:
    """Distances (k) in metres at the waypoints after the first, in the floor's own frame."""
    at = interpolate_poses(walk.nodes.t_s, poses, walk.truth.t_s[1:])
    return np.asarray(np.linalg.norm(at[:, :2] - walk.truth.world_from_body[1:, :2], axis=1))


def archive_of(data: Path | None, floor: str) -> Path:
    """Where the walks of a floor lie. Raises InputError where there is no data at all."""
    if data is None:
        raise InputError("mall floor: wanted real walks; set ELFSLAM_DATA to the folder of them")
    return data / "mall_walks" / f"site1-{floor}.tar.xz"


def _placed(recording: Recording, truth: Truth) -> FloorWalk:
    if recording.imu is None or recording.orientation is None:
        raise InputError(f"{recording.name}: has no inertial data or orientation; leave it out")
    nodes = dead_reckon(recording.imu, MotionParameters())
    start = np.array([*truth.world_from_body[0, :2], compass_turn(recording.orientation, nodes)])
    moved = compose(start, nodes.world_from_body)
    return FloorWalk(recording, truth, replace(nodes, world_from_body=moved))


def _yaw_rad(orientation: Orientation, at_s: F64) -> F64:
    ahead = Rotation.from_quat(orientation.world_from_phone).as_matrix() @ LOOKS_AHEAD
    yaw_rad = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return np.asarray(np.interp(at_s, orientation.t_s, yaw_rad))


def _first_leg_turn(walk: FloorWalk) -> float:
    """How far the first leg has to be turned to lie as its waypoints do."""
    true = walk.truth.world_from_body[:, :2]
    away_m = np.linalg.norm(true - true[0], axis=1)
    end = int(np.argmax(away_m >= FIRST_LEG_M)) or int(np.argmax(away_m))
    at = interpolate_poses(walk.nodes.t_s, walk.nodes.world_from_body, walk.truth.t_s[[0, end]])
    legs = np.stack([true[end] - true[0], at[1, :2] - at[0, :2]])
    wanted, walked = np.arctan2(legs[:, 1], legs[:, 0])
    return float(wrap_angle(wanted - walked))


def _windows(walk: FloorWalk, parameters: NeighbourParameters) -> F64:
    known = walk.recording
    if known.magnetometer is None:
        raise InputError(f"{known.name}: has no magnetometer; leave it out")
    windows = field_windows(known.magnetometer, known.orientation, walk.nodes, parameters)
    return windows[thinned_rows(walk.nodes)]


def _wifi_weights(walks: Sequence[FloorWalk], near: Bool, walk_of: I64) -> F64:
    """Wi-Fi scores (n, n) of the thinned nodes of those walks that come near each other."""
    parameters = WifiFingerprintParameters()
    heard = [_heard(walk, parameters) for walk in walks]
    scores = np.zeros(near.shape)
    for one in range(len(walks)):
        rows = walk_of == one
        for other in np.unique(walk_of[near[rows].any(axis=0)]):
            here, there = heard[one], heard[other]
            if other > one and here is not None and there is not None:
                block = np.ix_(rows, walk_of == other)
                scores[block] = wifi_scores(here, there, parameters)
    return np.asarray(scores + scores.T)


def _heard(walk: FloorWalk, parameters: WifiFingerprintParameters) -> Fingerprints | None:
    """None where no scan was made."""
    if walk.recording.wifi is None:
        return None
    every = fingerprints(walk.recording.wifi, walk.nodes, parameters)
    rows = np.minimum(thinned_rows(walk.nodes), len(every.rssi_dbm) - 1)
    return Fingerprints(every.bssids, every.rssi_dbm[rows])


def _row(floor: str, use: str, method: str, errors: Sequence[F64], found: float) -> Row:
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
    }


def _panels(floor: str, walks: Sequence[FloorWalk], poses: dict[str, list[F64]]) -> list[Panel]:
    """The floor before and after."""
    shown = {METHODS[0]: DEAD_RECKONING, METHODS[-1]: SLAM}
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
