"""Runs and maps as files that other programs open."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path

from elfslam.base.errors import InputError, StoreError
from elfslam.data.folders import new_file
from elfslam.data.g2o import write_g2o
from elfslam.data.runs import ENCODER, FACTS, read_run
from elfslam.data.tum import write_tum
from elfslam.line.graph import build_graph
from elfslam.slam import Run


class Format(StrEnum):
    """What a run or a map can become."""

    TUM = "tum"
    G2O = "g2o"
    ONNX = "onnx"


def export(source: Path, out: Path, to: Format) -> None:
    """Write a run as a file of another format, whole or not at all.

    Raises InputError where the run does not hold what the format asks for, StoreError where it
    cannot be read or the file cannot be written.
    """
    if out.is_dir():
        raise StoreError(f"{out}: is a folder; name the file that is to be written")
    EXPORTS[to](source, out)


def _tum(source: Path, out: Path) -> None:
    """The straightened trajectory."""
    trajectory = _run(source).trajectory
    with new_file(out) as partial:
        write_tum(partial, trajectory.t_s, trajectory.world_from_body)


def _g2o(source: Path, out: Path) -> None:
    """The pose graph: steps and all closures, the straightened poses as first guess."""
    run = _run(source)
    graph = build_graph(run.odometry, run.closures)
    write_g2o(out, graph, run.trajectory.world_from_body)


def _onnx(source: Path, out: Path) -> None:
    """The encoder that others are located by."""
    encoder = source / ENCODER
    if not encoder.is_file():
        raise InputError(f"{source}: holds no {ENCODER}; map it by its echoes (--by elf) first")
    with new_file(out) as partial:
        shutil.copyfile(encoder, partial)


def _run(source: Path) -> Run:
    if not (source / FACTS).is_file():
        raise InputError(f"{source}: wanted a run folder, found no {FACTS}; name one")
    return read_run(source)


EXPORTS: Mapping[Format, Callable[[Path, Path], None]] = {
    Format.TUM: _tum,
    Format.G2O: _g2o,
    Format.ONNX: _onnx,
}
