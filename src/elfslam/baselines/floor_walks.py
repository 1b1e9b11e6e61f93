"""A floor from many people's walks (crowdsourcing): solved together by Wi-Fi and magnetic field.

Each lies as dead reckoning has it, headed by its phone's own sensors. The one angle between these
and the floor comes from the walks themselves: places that hear the same Wi-Fi are the same.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import C128, F64, I64
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose
from elfslam.base.values import (
    Closures,
    FloorMap,
    Odometry,
    Orientation,
    Payload,
    PoseGraph,
    Recording,
    Trajectory,
)
from elfslam.baselines.magnetic import LOOKS_AHEAD
from elfslam.baselines.maps import rssi_payload, stretch_map
from elfslam.baselines.neighbours import (
    NeighbourParameters,
    candidates,
    field_weights,
    field_windows,
    neighbour_closures,
)
from elfslam.baselines.wifi import (
    Fingerprints,
    PlaceParameters,
    WifiFingerprintParameters,
    fingerprints,
    place_scores,
    wifi_places,
)
from elfslam.stages.graph import GraphParameters, optimise
from elfslam.stages.motion import MotionParameters, compass_heading, dead_reckon

THINNED = 4
"""Every so many footsteps a walk is compared and corrected, 2.8 m apart."""


@dataclass(frozen=True)
class StartSigma:
    """How exactly the start of a walk is known."""

    position_m: float = 0.3
    heading_rad: float = 0.2


def thinned_rows(walk: Odometry) -> I64:
    """The nodes of a walk that stand for all."""
    return np.arange(0, len(walk.t_s), THINNED)


def thinned(walk: Odometry) -> Odometry:
    """The walk at those nodes; variances of the moves between add up."""
    rows = thinned_rows(walk)
    summed = np.vstack([np.zeros(3), np.cumsum(walk.step_sigma**2, axis=0)])[rows]
    sigma = np.sqrt(np.diff(summed, axis=0))
    return replace(
        walk, t_s=walk.t_s[rows], world_from_body=walk.world_from_body[rows], step_sigma=sigma
    )


def joint_graph(
    walks: Sequence[Odometry], closures: Closures, start: StartSigma | None = None
) -> PoseGraph:
    """One graph of walks that all begin in the world's frame; closures count nodes through.

    Node 0 is the world's origin, to which each walk's first pose is tied as exactly as it is
    known.
    """
    start = start or StartSigma()
    known = [start.position_m, start.position_m, start.heading_rad]
    edges, measurements, sigmas = [], [], []
    first = 1
    for walk in walks:
        poses, rows = walk.world_from_body, first + np.arange(len(walk.t_s))
        edges += [np.array([[0, first]]), np.column_stack([rows[:-1], rows[1:]])]
        measurements += [poses[:1], between(poses[:-1], poses[1:])]
        sigmas += [np.array([known]), walk.step_sigma]
        first += len(rows)
    sigma = np.vstack(sigmas)
    return PoseGraph(
        initial=np.vstack([np.zeros((1, 3)), *[walk.world_from_body for walk in walks]]),
        edges=np.vstack([*edges, np.column_stack([closures.i, closures.j]) + 1]),
        measurements=np.vstack([*measurements, closures.i_from_j]),
        information=np.concatenate(
            [np.eye(3) / sigma[:, None] ** 2, np.linalg.inv(closures.covariance).reshape(-1, 3, 3)]
        ),
        is_closure=np.arange(len(sigma) + len(closures.i)) >= len(sigma),
    )


def corrected(
    walks: Sequence[Odometry], closures: Closures, start: StartSigma | None = None
) -> list[Trajectory]:
    """The trajectory of every walk after all have been solved together at their thinned nodes.

    Pulls are weak and many, none of them decides: they are not judged one by one.
    """
    graph = joint_graph([thinned(walk) for walk in walks], closures, start)
    count = np.arange(len(graph.initial), dtype=np.float64)
    solved = optimise(graph, count, GraphParameters(robust=False, noise_rounds=0))
    ends = np.cumsum([1, *[len(thinned_rows(walk)) for walk in walks]])
    return [
        _carried(walk, solved.world_from_body[first:last], solved.covariance[first:last])
        for walk, first, last in zip(walks, ends[:-1], ends[1:], strict=True)
    ]


def _carried(walk: Odometry, poses: F64, covariance: F64) -> Trajectory:
    """All poses of a walk, each moved as the thinned node before it was, and as sure."""
    rows, every = thinned_rows(walk), np.arange(len(walk.t_s))
    before = np.searchsorted(rows, every, side="right") - 1
    own = between(walk.world_from_body[rows][before], walk.world_from_body)
    moved = compose(poses[before], own)
    return Trajectory(walk.t_s, moved, covariance[before], np.ones(0), "OK")


LEVELS = "field:levels"
NORTH_OF_COMPASS_RAD = np.pi / 2
"""A compass has x to the east."""
TOLD_RAD = 0.2
"""An angle that is known worse than this is not worth turning a floor by."""
PLANE = np.array([1, 1j])


@dataclass(frozen=True)
class FloorParameters:
    """How footsteps are headed, and what places of a floor are compared by."""

    motion: MotionParameters = field(default_factory=MotionParameters)
    wifi: WifiFingerprintParameters = field(default_factory=WifiFingerprintParameters)
    neighbours: NeighbourParameters = field(default_factory=NeighbourParameters)
    places: PlaceParameters = field(default_factory=PlaceParameters)


@dataclass(frozen=True, eq=False)
class FloorWalk:
    """A walk as dead reckoning has it from its start, and what it passed by.

    One `by_compass` is headed as its phone's sensors say; others as was declared.
    """

    recording: Recording
    nodes: Odometry
    by_compass: bool


AnyWalk = TypeVar("AnyWalk", bound=FloorWalk)


@dataclass(frozen=True)
class FloorTurn:
    """How far walks have to be turned from their compasses to the frame of their starts."""

    turn_rad: float
    sigma_rad: float


UNTOLD = FloorTurn(0.0, float("inf"))


def floor_walk(recording: Recording, motion: MotionParameters) -> FloorWalk:
    """The walk from its declared start, or the origin.

    Raises InputError where it has no inertial data, or where nothing tells its heading.
    """
    if recording.imu is None:
        raise InputError(f"{recording.name}: has no inertial data; leave it out")
    x_m, y_m, heading_rad = recording.start_pose or (0.0, 0.0, np.nan)
    if np.isfinite(heading_rad):
        nodes = dead_reckon(recording.imu, motion, (x_m, y_m, heading_rad))
        return FloorWalk(recording, nodes, by_compass=False)
    nodes = dead_reckon(recording.imu, motion)
    start = np.array([x_m, y_m, _phone_turn(recording, nodes, motion)])
    poses = compose(start, nodes.world_from_body)
    return FloorWalk(recording, replace(nodes, world_from_body=poses), by_compass=True)


def heading_by_phone(walk: FloorWalk, motion: MotionParameters) -> FloorWalk:
    """The walk turned to head as its phone's own sensors say. Raises InputError where none does."""
    return turned(walk, _phone_turn(walk.recording, walk.nodes, motion))


def turned(walk: AnyWalk, turn_rad: float) -> AnyWalk:
    """The walk turned about its start."""
    start = walk.nodes.world_from_body[0]
    own = between(start, walk.nodes.world_from_body)
    poses = compose(start + np.array([0.0, 0.0, turn_rad]), own)
    return replace(walk, nodes=replace(walk.nodes, world_from_body=poses))


def compass_turn(orientation: Orientation, nodes: Odometry) -> float:
    """How far (radians) a walk has to be turned so that its mean heading is the phone's."""
    ahead = _yaw_rad(orientation, nodes.t_s) - nodes.world_from_body[:, 2]
    return float(np.angle(np.exp(1j * ahead).mean()))


def wifi_scores_between(walks: Sequence[FloorWalk], parameters: WifiFingerprintParameters) -> F64:
    """Wi-Fi scores (n, n) between the thinned nodes of different walks; 0 within a walk."""
    walk_of = _walk_of(walks)
    heard = [_heard(walk, parameters) for walk in walks]
    nowhere = [np.zeros((len(each.rssi_dbm), 2)) for each in heard]
    places = wifi_places(heard, nowhere, parameters)
    scores = np.vstack([place_scores(each, places, parameters) for each in heard])
    return np.asarray(np.where(walk_of[:, None] == walk_of, 0.0, scores))


def floor_turn(walks: Sequence[FloorWalk], parameters: FloorParameters) -> FloorTurn:
    """The angle from the phones' compasses to the floor: places alike by Wi-Fi coincide best.

    Weighted Procrustes: nodes lie at fixed + R free, so that a pair that is the same place has
    R (free_i - free_j) = fixed_j - fixed_i, and the sum of conj(left) right has the angle of R.
    Its variance is that between walks (sandwich estimate), or what the rest of the pairs makes of
    as many errors as there are walks, whichever is larger. Starts that all lie together tell
    nothing: then the turn is 0 and its sigma infinite.
    """
    walk_of, own, start = _walk_of(walks), *_own_and_start(walks)
    by_compass = np.array([walk.by_compass for walk in walks])[walk_of]
    free, fixed = np.where(by_compass, own, 0), np.where(by_compass, start, start + own)
    alike = wifi_scores_between(walks, parameters.wifi)
    i, j, weight = _most_alike(alike, parameters.neighbours)
    walked, apart = free[i] - free[j], fixed[j] - fixed[i]
    by_walk = np.zeros(len(walks), dtype=np.complex128)
    np.add.at(by_walk, walk_of[i], weight * np.conj(walked) * apart)
    total = by_walk.sum()
    if not abs(total):
        return UNTOLD
    turn = total / abs(total)
    between_walks = ((by_walk * np.conj(turn)).imag ** 2).sum()
    rest = (weight * abs(apart - turn * walked) ** 2).sum() / len(walks)
    sigma_rad = float(np.sqrt(max(between_walks, rest * abs(total))) / abs(total))
    return FloorTurn(float(np.angle(turn)), sigma_rad) if sigma_rad < TOLD_RAD else UNTOLD


def solved(
    walks: Sequence[FloorWalk], by: Collection[Modality], parameters: FloorParameters
) -> tuple[list[Trajectory], float]:
    """Trajectories of the walks, solved together, and the share of them joined to another.

    Raises InputError where a walk has not what places are to be known by.
    """
    known, walk_of = parameters.neighbours, _walk_of(walks)
    poses = np.vstack([thinned(walk.nodes).world_from_body for walk in walks])
    near = candidates(poses[:, :2], walk_of, known)
    weights = near.astype(np.float64)
    if Modality.MAGNETIC in by:
        levels = [field_levels(walk, known)[thinned_rows(walk.nodes)] for walk in walks]
        weights *= field_weights(np.concatenate(levels), poses[:, 2], near, known)
    if Modality.WIFI in by:
        weights *= wifi_scores_between(walks, parameters.wifi) ** known.wifi_power
    closures = neighbour_closures(weights, known)
    found = np.unique(walk_of[np.concatenate([closures.i, closures.j])])
    return corrected([walk.nodes for walk in walks], closures), len(found) / len(walks)


def floor_map(
    walks: Sequence[FloorWalk],
    trajectories: Sequence[Trajectory],
    by: Collection[Modality],
    parameters: FloorParameters,
) -> FloorMap:
    """A spot for every stretch between footsteps, with payloads `wifi` and `magnetic` as named.

    Raises InputError where a walk has not what places are to be known by.
    """
    payloads = []
    if Modality.WIFI in by:
        heard = [_all_heard(walk, parameters.wifi) for walk in walks]
        payloads.append(rssi_payload(heard, parameters.wifi))
    if Modality.MAGNETIC in by:
        levels = [field_levels(walk, parameters.neighbours)[:-1] for walk in walks]
        payloads.append(_levels_payload(np.concatenate(levels)))
    sources = tuple(walk.recording.name for walk in walks)
    return stretch_map(trajectories, payloads, sources)


def field_levels(walk: FloorWalk, parameters: NeighbourParameters) -> F64:
    """The field (n, w, 2) about each node. Raises InputError where the walk has none."""
    known = walk.recording
    if known.magnetometer is None:
        raise InputError(f"{known.name}: has no magnetometer; leave it out")
    return field_windows(known.magnetometer, known.orientation, walk.nodes, parameters)


def _phone_turn(recording: Recording, nodes: Odometry, motion: MotionParameters) -> float:
    """How far a walk has to be turned to head as its phone says. Raises InputError."""
    north_rad = motion.magnetic_north_rad - NORTH_OF_COMPASS_RAD
    if recording.orientation is not None:
        return north_rad + compass_turn(recording.orientation, nodes)
    if recording.imu is None or recording.magnetometer is None:
        raise InputError(
            f"{recording.name}: has neither orientation nor magnetometer to tell its heading; "
            "declare that of its start, or leave it out"
        )
    compass = compass_heading(recording.imu, recording.magnetometer, motion)
    return north_rad + compass.heading_rad - float(nodes.world_from_body[0, 2])


def _yaw_rad(orientation: Orientation, at_s: F64) -> F64:
    ahead = Rotation.from_quat(orientation.world_from_phone).as_matrix() @ LOOKS_AHEAD
    yaw_rad = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return np.asarray(np.interp(at_s, orientation.t_s, yaw_rad))


def _levels_payload(levels: F64) -> Payload:
    name = f"{LEVELS}:{levels.shape[1]}x{levels.shape[2]}"
    return Payload("magnetic", name, levels.reshape(len(levels), -1).astype(np.float32))


def _walk_of(walks: Sequence[FloorWalk]) -> I64:
    """The number (n) of the walk that each thinned node belongs to."""
    counts = [len(thinned_rows(walk.nodes)) for walk in walks]
    return np.repeat(np.arange(len(walks), dtype=np.int64), counts)


def _own_and_start(walks: Sequence[FloorWalk]) -> tuple[C128, C128]:
    """Thinned nodes (n) from the start of their walk, and that start, as complex numbers."""
    nodes = [walk.nodes.world_from_body[thinned_rows(walk.nodes), :2] @ PLANE for walk in walks]
    starts = [np.full(len(each), each[0]) for each in nodes]
    return np.concatenate(nodes) - np.concatenate(starts), np.concatenate(starts)


def _most_alike(similarity: F64, parameters: NeighbourParameters) -> tuple[I64, I64, F64]:
    """For each node the few that are most like it: pairs (k) and their weights."""
    count = min(parameters.count, len(similarity))
    best = np.argpartition(-similarity, count - 1, axis=1)[:, :count]
    i, j = np.repeat(np.arange(len(similarity)), count), best.ravel()
    return i, j, similarity[i, j] ** parameters.wifi_power


def _heard(walk: FloorWalk, parameters: WifiFingerprintParameters) -> Fingerprints:
    """What is heard at the thinned nodes."""
    every = _all_heard(walk, parameters)
    rows = np.minimum(thinned_rows(walk.nodes), len(every.rssi_dbm) - 1)
    return Fingerprints(every.bssids, every.rssi_dbm[rows])


def _all_heard(walk: FloorWalk, parameters: WifiFingerprintParameters) -> Fingerprints:
    """What is heard at every stretch; nothing where the walk has no scans."""
    if walk.recording.wifi is None:
        return Fingerprints((), np.zeros((len(walk.nodes.t_s) - 1, 0)))
    return fingerprints(walk.recording.wifi, walk.nodes, parameters)
