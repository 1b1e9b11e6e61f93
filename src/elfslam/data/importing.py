"""Other people's logs, whatever their format, as recordings with their truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Recording, Truth
from elfslam.data.getsensordata import read_getsensordata
from elfslam.data.magnetic import read_magnetic
from elfslam.data.mall import read_walk, walks_in
from elfslam.data.phyphox import read_phyphox
from elfslam.data.ronin import read_ronin
from elfslam.data.sensorlogger import read_sensorlogger


class LogFormat(StrEnum):
    """Formats that can be imported."""

    MALL = "mall"
    MAGNETIC = "magnetic"
    SENSORLOGGER = "sensorlogger"
    PHYPHOX = "phyphox"
    GETSENSORDATA = "getsensordata"
    RONIN = "ronin"


ONE_RECORDING: Mapping[LogFormat, Callable[[Path], Recording]] = {
    LogFormat.SENSORLOGGER: read_sensorlogger,
    LogFormat.PHYPHOX: read_phyphox,
    LogFormat.RONIN: read_ronin,
}
"""Readers of formats that hold one recording and no truth."""


@dataclass(frozen=True, eq=False)
class Imported:
    """One recording, its truth where the log has it, and how many lines were damaged."""

    recording: Recording
    truth: Truth | None
    damaged_lines: int


@dataclass(frozen=True)
class Refused:
    """A log among many that could not be read, and why."""

    name: str
    reason: str


def declared_start(item: Imported) -> Recording:
    """The recording that begins where its first waypoint says, as who walked it would declare.

    It leaves the heading open. Raises InputError where there is no waypoint.
    """
    if item.truth is None:
        raise InputError(f"{item.recording.name}: has no waypoint that tells its start")
    x_m, y_m = item.truth.world_from_body[0, :2]
    return replace(item.recording, start_pose=(float(x_m), float(y_m), np.nan))


def read_logs(
    log_format: LogFormat, path: Path, generator: np.random.Generator
) -> Iterator[Imported | Refused]:
    """Every recording at `path`; `generator` drifts odometry that would else be the truth."""
    if log_format is LogFormat.MALL:
        for file in walks_in(path):
            try:
                walk = read_walk(file)
            except InputError as error:
                if file == path:
                    raise
                yield Refused(file.name, str(error))
                continue
            truth = walk.truth if len(walk.truth.t_s) else None
            yield Imported(walk.recording, truth, walk.damaged_lines)
    elif log_format is LogFormat.MAGNETIC:
        recording, truth = read_magnetic(path, generator)
        yield Imported(recording, truth, 0)
    elif log_format is LogFormat.GETSENSORDATA:
        log = read_getsensordata(path)
        yield Imported(log.recording, log.truth if len(log.truth.t_s) else None, log.damaged_lines)
    else:
        yield Imported(ONE_RECORDING[log_format](path), None, 0)


def takes_many(log_format: LogFormat) -> bool:
    """Whether one path of this format can hold several recordings."""
    return log_format is LogFormat.MALL
