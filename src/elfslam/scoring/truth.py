"""The truth of a walk, read from the files beside it. Only scoring and studies may look."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from io import StringIO
from pathlib import Path, PurePosixPath

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_text
from elfslam.base.values import Truth
from elfslam.base.zips import opened_zip

Row = tuple[int, list[str]]
"""Line number and fields, so that a refusal can name the line."""

WAYPOINT_HEADER = ["t_s", "x_m", "y_m"]
TUM_COLUMNS = 8
LARGEST = 1e15
"""Beyond any time and place, in any unit; it can still be squared."""


def read_truth(path: Path) -> Truth:
    """Truth from `truth.tum`, `waypoints.csv`, or a recording (folder or .zip) that holds one.

    TUM rows are `t x y z qx qy qz qw`; the heading is the yaw of the quaternion. Waypoints are
    `t_s,x_m,y_m`; their heading is NaN. Raises InputError where the file is missing, malformed,
    or has times that do not increase, and where a recording holds no truth.
    """
    if path.is_dir():
        return _from_folder(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file or folder; pass a truth file or a recording")
    if path.suffix.lower() == ".zip":
        return _from_zip(path)
    return _parsed(read_text(path), str(path))


def _from_folder(folder: Path) -> Truth:
    for name in _PARSERS:
        if (folder / name).is_file():
            return read_truth(folder / name)
    raise _no_truth(str(folder))


def _from_zip(path: Path) -> Truth:
    """The shallowest truth file of the archive (people zip the folder or what lies in it)."""
    with opened_zip(path) as packed:
        members = sorted(packed.entries, key=lambda member: len(member.parts))
        for member in (m for name in _PARSERS for m in members if m.name == name):
            return _parsed(packed.text(packed.entries[member]), f"{path}:{member}")
    raise _no_truth(str(path))


def _no_truth(source: str) -> InputError:
    wanted = " or ".join(_PARSERS)
    return InputError(f"{source}: no truth in this recording; put {wanted} into it")


def _parsed(text: str, source: str) -> Truth:
    """By name where the name tells, else by the look of the rows (commas make waypoints)."""
    name = PurePosixPath(source.replace("\\", "/").rsplit(":", 1)[-1]).name
    parser = _PARSERS.get(name) or (_waypoints if "," in text else _tum)
    t_s, poses = parser(text, source)
    if t_s.size == 0:
        raise InputError(f"{source}: no rows; wanted at least one pose")
    try:
        return Truth(t_s=t_s, world_from_body=poses)
    except InputError as cause:
        raise InputError(f"{source}: {cause}") from cause


def _tum(text: str, source: str) -> tuple[F64, F64]:
    rows = ((number, line.split()) for number, line in _lines(text) if not line.startswith("#"))
    table, numbers = _numbers(rows, TUM_COLUMNS, "t x y z qx qy qz qw", source)
    x, y, z, w = table[:, 4:].T
    bad = abs(np.linalg.norm(table[:, 4:], axis=1) - 1) > 0.01
    if bad.any():
        row = numbers[int(np.argmax(bad))]
        raise InputError(f"{source}: line {row}: quaternion is not of length 1; normalise it")
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return table[:, 0], np.column_stack([table[:, 1:3], heading])


def _waypoints(text: str, source: str) -> tuple[F64, F64]:
    rows = ((number, [part.strip() for part in line.split(",")]) for number, line in _lines(text))
    header, (_, got) = ",".join(WAYPOINT_HEADER), next(rows, (1, ["nothing"]))
    if got != WAYPOINT_HEADER:
        raise InputError(f"{source}: wanted the header {header}, got {','.join(got)[:60]}; add it")
    table, _ = _numbers(rows, len(WAYPOINT_HEADER), header, source)
    return table[:, 0], np.column_stack([table[:, 1:], np.full(len(table), np.nan)])


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines that are not blank, without what is blank about them, and their numbers."""
    stripped = ((number, line.strip()) for number, line in enumerate(StringIO(text), start=1))
    return ((number, line) for number, line in stripped if line)


def _numbers(rows: Iterator[Row], columns: int, wanted: str, source: str) -> tuple[F64, array[int]]:
    """The numbers of all rows (n, columns), and which lines those are (n)."""
    numbers, lines = array("d"), array("q")
    for number, parts in rows:
        read = [_finite(part) for part in parts]
        if len(parts) != columns or None in read:
            got = " ".join(parts)[:60]
            raise InputError(
                f"{source}: line {number}: wanted {columns} numbers ({wanted}), got {got!r}; "
                "repair or remove the line"
            )
        numbers.extend(value for value in read if value is not None)
        lines.append(number)
    return np.array(numbers).reshape(-1, columns), lines


def _finite(text: str) -> float | None:
    """The number that a text is; None where it is none, or beyond belief."""
    try:
        number = float(text)
    except ValueError:
        return None
    # NaN fails the comparison.
    return number if abs(number) <= LARGEST else None


_PARSERS: dict[str, Callable[[str, str], tuple[F64, F64]]] = {
    "truth.tum": _tum,
    "waypoints.csv": _waypoints,
}
"""In the order of preference: full poses before waypoints."""
