"""On which floor a walk was: `levels.csv` of a run, `truth_levels.csv` where it is known.

Rows `t_s,level,passage`: from then until the next row, `level` is empty between floors, and
`passage` says by what (stairs, lift, escalator) or is empty.
"""

import csv
from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.text_files import read_text
from elfslam.base.values import LevelPassage, Levels
from elfslam.data.atomic_files import new_file

LEVELS = "levels.csv"
"""As a run finds them."""
HEADER = ["t_s", "level", "passage"]


def write_levels(levels: Levels, file: Path) -> None:
    """The rows of a walk's levels as a CSV."""
    with new_file(file) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        for t_s, level, passage in zip(levels.t_s, levels.level, levels.passages, strict=True):
            writer.writerow([f"{t_s:.6f}", "" if np.isnan(level) else f"{level:g}", passage or ""])


def read_levels(file: Path) -> Levels:
    """The levels of a walk. Raises InputError naming file and row."""
    header, *rows = list(csv.reader(read_text(file).splitlines())) or [[]]
    if [name.strip() for name in header] != HEADER or not rows:
        raise InputError(f"{file}: wanted the columns {','.join(HEADER)} and a row; got {header}")
    read = [_row(file, number, cells) for number, cells in enumerate(rows, start=2)]
    t_s, level, passages = zip(*read, strict=True)
    if (np.diff(t_s) <= 0).any():
        raise InputError(f"{file}: time runs backward; sort the rows")
    return Levels(np.array(t_s), np.array(level), passages)


def _row(file: Path, number: int, cells: list[str]) -> tuple[float, float, LevelPassage | None]:
    try:
        t_s, level, passage = (cell.strip() for cell in cells)
        when_s = float(t_s)
        where = float(level) if level else np.nan
        by = LevelPassage(passage) if passage else None
    except ValueError:
        when_s = where = np.nan
        by = None
    if not np.isfinite(when_s) or np.isinf(where):
        raise InputError(
            f"{file}: row {number} is {','.join(cells)!r:.60}, wanted seconds, a level or nothing, "
            f"and {', '.join(LevelPassage)} or nothing; correct it"
        )
    return when_s, where, by
