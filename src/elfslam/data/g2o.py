"""Planar pose graphs as g2o text files, the way the field exchanges them.

Format: Kuemmerle et al. 2011, "g2o: a general framework for graph optimization". Rows
`VERTEX_SE2 id x y heading` and `EDGE_SE2 i j x y heading`, then the upper triangle of the
information matrix. `FIX` rows are skipped: the first pose is held anyway.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import chain
from elfslam.base.values import PoseGraph
from elfslam.data.tables import number_or_nan, read_lines

VERTEX, EDGE, SKIPPED = "VERTEX_SE2", "EDGE_SE2", ("FIX", "#")
UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class Row:
    """A row of the file: where it stands (1 is the first), and its numbers."""

    number: int
    numbers: list[float]


def read_g2o(file: Path) -> PoseGraph:
    """The pose graph of a file; poses are numbered from 0 in the order of their ids.

    The first edge from each pose to the next is a step, all others are closures. Where the file
    holds edges alone, the poses are chained from its steps. Raises InputError, naming the row.
    """
    vertices, edges = _rows(file)
    if not edges:
        raise InputError(f"{file}: has no {EDGE} row; wanted a pose graph with edges")
    table = np.array([edge.numbers for edge in edges])
    known = np.array([vertex.numbers for vertex in vertices]).reshape(-1, 4)
    ids = np.unique(known[:, 0] if vertices else table[:, :2])
    if vertices and len(ids) < len(vertices):
        raise InputError(f"{file}: {VERTEX} rows share an id; remove the repeated ones")
    ends = _ends(file, edges, ids)
    closure = _is_closure(ends)
    measured = table[:, 2:5]
    poses = known[np.argsort(known[:, 0]), 1:]
    if not vertices:
        poses = _chained(file, ends[~closure], measured[~closure], ids)
    return PoseGraph(poses, ends, measured, _information(file, edges), closure)


def write_g2o(file: Path, graph: PoseGraph, world_from_body: F64 | None = None) -> None:
    """Write a graph with its initial poses, or with others (n, 3), solved ones say.

    Every digit is kept. Raises InputError where there is not a pose for each node.
    """
    poses = graph.initial if world_from_body is None else world_from_body
    if poses.shape != graph.initial.shape:
        raise InputError(
            f"graph: got {len(poses)} poses for a graph of {len(graph.initial)}; "
            "pass those of the same walk"
        )
    lines = [f"{VERTEX} {k} {_text(pose)}" for k, pose in enumerate(poses)]
    for (i, j), measured, information in zip(
        graph.edges, graph.measurements, graph.information, strict=True
    ):
        lines.append(f"{EDGE} {i} {j} {_text(measured)} {_text(information[UPPER])}")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _text(numbers: F64) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _rows(file: Path) -> tuple[list[Row], list[Row]]:
    found: dict[str, list[Row]] = {VERTEX: [], EDGE: []}
    for number, line in enumerate(read_lines(file), start=1):
        kind, *cells = line.split() or ["#"]
        if kind.startswith(SKIPPED):
            continue
        if kind not in found:
            raise InputError(f"{file}: row {number} is {kind[:30]}, {_advice(kind)}")
        wanted = 4 if kind == VERTEX else 11
        if len(cells) != wanted:
            raise InputError(
                f"{file}: row {number} has {len(cells)} numbers after {kind}, wanted {wanted}; "
                "the file is damaged there, repair that row"
            )
        found[kind].append(Row(number, [_number(file, number, cell) for cell in cells]))
    return found[VERTEX], found[EDGE]


def _advice(kind: str) -> str:
    if "SE3" in kind or "3D" in kind.upper():
        return f"of a graph in space; wanted {VERTEX} and {EDGE}, project it onto the floor first"
    return f"wanted {VERTEX} or {EDGE}; remove landmarks and whatever else is no pose or move"


def _number(file: Path, row: int, cell: str) -> float:
    number = number_or_nan(cell)
    if not np.isfinite(number):
        raise InputError(
            f"{file}: row {row} has {cell[:30]!r}, wanted a finite number; repair that row"
        )
    return number


def _ends(file: Path, edges: list[Row], ids: F64) -> I64:
    """The poses (e, 2) that edges join, numbered by their place among the ids."""
    named = np.array([edge.numbers[:2] for edge in edges])
    places = np.minimum(np.searchsorted(ids, named), len(ids) - 1)
    bad = (ids[places] != named).any(axis=1) | (named != np.round(named)).any(axis=1)
    bad |= named[:, 0] == named[:, 1]
    if bad.any():
        edge = edges[int(np.argmax(bad))]
        i, j = edge.numbers[:2]
        raise InputError(
            f"{file}: row {edge.number} joins {i:g} and {j:g}, wanted two ids that have a "
            f"{VERTEX} row; add the missing one or remove the edge"
        )
    return places


def _is_closure(ends: I64) -> Bool:
    """Every edge (e) but the first that leads from a pose to the next."""
    onward = np.flatnonzero(ends[:, 1] - ends[:, 0] == 1)
    _, first = np.unique(ends[onward, 0], return_index=True)
    closure = np.ones(len(ends), dtype=np.bool_)
    closure[onward[first]] = False
    return closure


def _chained(file: Path, steps: I64, moves: F64, ids: F64) -> F64:
    missing = np.setdiff1d(np.arange(len(ids) - 1), steps[:, 0])
    if len(missing):
        raise InputError(
            f"{file}: has no {VERTEX} rows and no {EDGE} from {ids[missing[0]]:g} to "
            f"{ids[missing[0] + 1]:g}; add either, so that every pose has a place to start from"
        )
    return chain(np.zeros(3), moves[np.argsort(steps[:, 0])])


def _information(file: Path, edges: list[Row]) -> F64:
    """The information matrices (e, 3, 3). Raises InputError where one is not positive."""
    upper = np.array([edge.numbers[5:] for edge in edges])
    information = np.zeros((len(edges), 3, 3))
    information[:, UPPER[0], UPPER[1]] = information[:, UPPER[1], UPPER[0]] = upper
    bad = np.linalg.eigvalsh(information)[:, 0] <= 0
    if bad.any():
        raise InputError(
            f"{file}: row {edges[int(np.argmax(bad))].number} has an information matrix that is "
            "not positive definite; give each edge finite sigmas"
        )
    return information
