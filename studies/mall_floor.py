"""All walks of a mall floor in one map: Wi-Fi and the magnetic field between people's walks."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Truth
from elfslam.baselines.floor_walks import (
    FloorParameters,
    FloorWalk,
    floor_turn,
    floor_walk,
    solved,
    turned,
)
from elfslam.data.importing import declared_start
from elfslam.data.log_files import Imported
from elfslam.data.mall import read_walk, walks_in
from elfslam.scoring.errors import interval
from elfslam.stages.motion import MotionParameters
from studies.results import Record
from studies.study import Study, StudyContext

ARCHIVE = "mall_walks/site1-{}.tar.xz"
FLOORS: Mapping[str, str] = {"F1": "developed on", "F4": "reported"}
"""What each floor was used to: the condition."""
RECKONED, TOGETHER = "dead reckoning", "wifi and magnetic"
METHODS: Mapping[str, tuple[Modality, ...]] = {
    RECKONED: (),
    "magnetic": (Modality.MAGNETIC,),
    "wifi": (Modality.WIFI,),
    TOGETHER: (Modality.WIFI, Modality.MAGNETIC),
}
STATISTICS: Mapping[str, Callable[[F64], float]] = {
    "median error (m)": lambda errors: float(np.median(errors)),
    "mean error (m)": lambda errors: float(np.mean(errors)),
    "third quartile (m)": lambda errors: float(np.quantile(errors, 0.75)),
}


@dataclass(frozen=True, eq=False)
class SurveyedWalk(FloorWalk):
    """A walk whose waypoints are known; the first is its declared start."""

    truth: Truth


def measure_mall_floor(
    context: StudyContext, *, floors: Sequence[str] = tuple(FLOORS), most_walks: int | None = None
) -> list[Record]:
    """Errors at the waypoints after the start, nothing aligned, of walks solved together.

    `most_walks` takes the first few of each floor alone. Raises InputError where there are none.
    """
    records: list[Record] = []
    parameters = FloorParameters()
    for floor in floors:
        context.announce(f"reading {floor}", None)
        walks = surveyed_walks(archive_of(context.data, floor), most_walks)
        turn = floor_turn(walks, parameters)
        walks = [turned(walk, turn.turn_rad) for walk in walks]
        for k, method in enumerate(METHODS):
            context.announce(f"{floor}: {method}", k / len(METHODS))
            poses = _solved(walks, METHODS[method])
            errors = [waypoint_errors(*pair) for pair in zip(walks, poses, strict=True)]
            records += error_records(floor, method, errors)
    return records


def use_of(floor: str) -> str:
    """What a floor was used to; every other one was developed on."""
    return FLOORS.get(floor, FLOORS["F1"])


def error_records(floor: str, method: str, errors: Sequence[F64]) -> Iterator[Record]:
    """Median, mean and third quartile of all errors (k) of walks, with intervals over walks."""
    for metric, statistic in STATISTICS.items():
        low, high = interval(errors, statistic, np.random.default_rng(0))
        yield Record(method, metric, statistic(np.concatenate(errors)), low, high, world=floor,
                     condition=use_of(floor))  # fmt: skip


def surveyed_walks(archive: Path, most: int | None) -> list[SurveyedWalk]:
    """The walks of a floor with two waypoints or more, headed by their phones."""
    walks = [read_walk(path) for path in islice(walks_in(archive), most)]
    return [_surveyed(walk, walk.truth) for walk in walks if walk.truth and len(walk.truth.t_s) > 1]


def _surveyed(walk: Imported, truth: Truth) -> SurveyedWalk:
    """The walk from its first waypoint."""
    known = floor_walk(declared_start(walk), MotionParameters())
    return SurveyedWalk(known.recording, known.nodes, known.by_compass, truth)


def _solved(walks: Sequence[SurveyedWalk], by: Sequence[Modality]) -> list[F64]:
    """Poses of each walk."""
    if not by:
        return [walk.nodes.world_from_body for walk in walks]
    trajectories, _ = solved(walks, by, FloorParameters())
    return [each.world_from_body for each in trajectories]


def waypoint_errors(walk: SurveyedWalk, poses: F64) -> F64:
    """Distances (k) in metres at the waypoints after the first, in the floor's own frame."""
    at = interpolate_poses(walk.nodes.t_s, poses, walk.truth.t_s[1:])
    return np.asarray(np.linalg.norm(at[:, :2] - walk.truth.world_from_body[1:, :2], axis=1))


def archive_of(data: Path | None, floor: str) -> Path:
    """Where the walks of a floor lie. Raises InputError where there is no data at all."""
    if data is None:
        raise InputError("mall floor: wanted real walks; set ELFSLAM_DATA to the folder of them")
    return data / ARCHIVE.format(floor)


STUDY = Study(
    "How far off are all walks of a mall floor, solved together by Wi-Fi and magnetic field?",
    measure_mall_floor, minutes=3, data=tuple(map(ARCHIVE.format, FLOORS)),
    fast={"floors": ("F1",), "most_walks": 8},
)  # fmt: skip
