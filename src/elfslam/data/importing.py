"""Other people's logs, whatever their format, as recordings with their truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Recording, Truth
from elfslam.data.getsensordata import read_getsensordata
from elfslam.data.log_files import files_in, is_zip
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
CHIRPING = frozenset((LogFormat.PHYPHOX,))
"""Of programs that can play chirps; the sound of others holds no echoes of them."""
FILES: Mapping[LogFormat, Callable[[Path], Iterator[Path]]] = {
    LogFormat.MALL: walks_in,
    LogFormat.MAGNETIC: partial(files_in, ending=".mat"),
    LogFormat.GETSENSORDATA: partial(files_in, ending=".txt"),
}
"""The files, each of one walk, at a path that may hold many."""


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
    """Every recording at `path`; `generator` drifts odometry that would else be the truth.

    Raises InputError where `path` itself is no log of that format, or a broken archive.
    """
    if log_format not in FILES:
        yield _read_one(log_format, path, generator)
        return
    for file in FILES[log_format](path):
        try:
            item = _read_one(log_format, file, generator)
        except InputError as error:
            if file == path:
                raise
            yield Refused(file.name, str(error).replace(f"{file.parent}/", ""))
            continue
        yield item


def _read_one(log_format: LogFormat, path: Path, generator: np.random.Generator) -> Imported:
    if log_format is LogFormat.MALL:
        walk = read_walk(path)
        return Imported(walk.recording, _unless_empty(walk.truth), walk.damaged_lines)
    if log_format is LogFormat.MAGNETIC:
        return Imported(*read_magnetic(path, generator), 0)
    if log_format is LogFormat.GETSENSORDATA:
        log = read_getsensordata(path)
        return Imported(log.recording, _unless_empty(log.truth), log.damaged_lines)
    return Imported(ONE_RECORDING[log_format](path), None, 0)


def _unless_empty(truth: Truth) -> Truth | None:
    return truth if len(truth.t_s) else None


def takes_many(log_format: LogFormat, path: Path) -> bool:
    """Whether there may be several recordings of this format at `path`."""
    if log_format is LogFormat.MALL:
        return True
    return log_format in FILES and (path.is_dir() or is_zip(path))
