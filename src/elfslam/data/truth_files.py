"""The truth of a walk, which scoring alone reads: written here, or found of marks on the floor.

Whoever stands still on each mark needs no clock: the pauses are gaps between footsteps.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Imu, Truth
from elfslam.data.atomic_files import new_file
from elfslam.data.level_files import write_levels
from elfslam.data.position_files import write_tum
from elfslam.data.tables import parse_rows, read_lines, write_timed_table
from elfslam.stages.motion import MotionParameters, find_footsteps

POSES = "truth.tum"
WAYPOINTS = "waypoints.csv"
TRUE_LEVELS = "truth_levels.csv"
TRUTH_FILES = (POSES, WAYPOINTS, TRUE_LEVELS)


def write_truth(truth: Truth, folder: Path) -> None:
    """truth.tum where every heading is known, else waypoints.csv; nothing for an empty truth.

    Beside it truth_levels.csv, where the truth knows floors.
    """
    if len(truth.t_s) == 0:
        return
    if truth.levels is not None:
        write_levels(truth.levels, folder / TRUE_LEVELS)
    poses = truth.world_from_body
    is_whole = np.isfinite(poses).all()
    with new_file(folder / (POSES if is_whole else WAYPOINTS)) as partial:
        if is_whole:
            write_tum(partial, truth.t_s, poses)
        else:
            write_timed_table(partial, ["x_m", "y_m"], truth.t_s, poses[:, :2])


MARK_COLUMNS = ["name", "x_m", "y_m"]
SHORTEST_PAUSE_S = 2.0
"""Longer than between any two footsteps of a walk, shorter than the three seconds asked for."""


def read_marks(file: Path) -> dict[str, tuple[float, float]]:
    """Position (x_m, y_m) by name from a CSV `name,x_m,y_m`. Raises InputError."""
    lines = read_lines(file)
    if [cell.strip() for cell in lines[0].split(",")] != MARK_COLUMNS:
        raise InputError(f"{file}: header is {lines[0][:60]!r}, wanted {','.join(MARK_COLUMNS)}")
    xy_m = parse_rows(file, lines[1:], [1, 2], first_row=2) if len(lines) > 1 else np.empty((0, 2))
    names = [line.split(",")[0].strip() for line in lines[1:]]
    twice = [name for name, times in Counter(names).items() if times > 1]
    if twice or not names:
        what = f"has {twice[0]!r:.60} twice" if twice else "has no marks"
        raise InputError(f"{file}: {what}; give every mark one row and a name of its own")
    return {name: (float(x), float(y)) for name, (x, y) in zip(names, xy_m, strict=True)}


def pauses_s(imu: Imu) -> F64:
    """When the walker stood still, (k, 2): from one footstep to the next that is late.

    The time before the first footstep and after the last counts too. Raises InputError for
    motion without footsteps.
    """
    steps = find_footsteps(imu, MotionParameters())
    edges = np.concatenate([imu.t_s[:1], steps, imu.t_s[-1:]])
    spans = np.column_stack([edges[:-1], edges[1:]])
    return np.asarray(spans[spans[:, 1] - spans[:, 0] >= SHORTEST_PAUSE_S])


def stood_on(imu: Imu, marks: Mapping[str, tuple[float, float]], visited: Sequence[str]) -> Truth:
    """The truth of a walk that stood still on the named marks, in that order, and nowhere else.

    Raises InputError for a name that no mark has, and where the walker stood still more or
    less often than names are given.
    """
    unknown = [name for name in visited if name not in marks]
    if unknown:
        raise InputError(f"mark {unknown[0]!r} is not among {', '.join(marks)}; correct the name")
    spans = pauses_s(imu)
    if len(spans) != len(visited):
        found = ", ".join(f"{first:.0f}-{last:.0f}" for first, last in spans)
        raise InputError(
            f"the walker stood still {len(spans)} times (at {found or 'no'} s), wanted "
            f"{len(visited)}, one for each mark; correct the list, or write waypoints.csv by hand"
        )
    xy_m = np.array([marks[name] for name in visited])
    return Truth(spans.mean(axis=1), np.column_stack([xy_m, np.full(len(xy_m), np.nan)]))
