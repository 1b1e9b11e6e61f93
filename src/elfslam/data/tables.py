"""Tables of numbers as CSV files; whatever is wrong is named with its file and row.

Five ways to write a CSV are read alike: cells parted by comma, tab or semicolon with a decimal
point, by tab or semicolon with a decimal comma, as spreadsheets of half the world save it.
"""

import csv
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base import text_files
from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError

LINE_ENDS = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
"""Where `str.splitlines` ends a line."""
TIME_FORMAT = "%.6f"
NUMBER_FORMAT = "%.9g"
MOST_LINES = 5_000_000
"""Seven hours at 200 Hz; each is an object of its own, a hundred bytes if not more."""
LONGEST_LINE = 100_000
"""Characters of a row of numbers; thousands of columns have fewer."""
SEPARATORS = (";", "\t", ",")


@dataclass(frozen=True, eq=False)
class CsvText:
    """The names of a CSV's columns; its rows, whose cells commas part, with decimal points."""

    file: Path
    names: tuple[str, ...]
    body: str

    def numbers(self, columns: Sequence[str]) -> F64:
        """The named columns (rows, columns). Raises InputError as `read_table`."""
        missing = [name for name in columns if name not in self.names]
        if missing:
            raise InputError(
                f"{self.file}: column {missing[0]} is missing, got {','.join(self.names)[:80]}"
            )
        if not self.body:
            raise InputError(
                f"{self.file}: has a header and no rows; delete it if the sensor was off"
            )
        lines = lines_of(self.body, self.file)
        return parse_rows(
            self.file, lines, [self.names.index(name) for name in columns], first_row=2
        )


def read_text(file: Path) -> str:
    """The text of a file, lines ended by "\\n". Raises InputError where unreadable or empty."""
    text = text_files.read_text(file).replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise InputError(f"{file}: is empty; delete it if there is nothing to say")
    return text


def read_lines(file: Path) -> list[str]:
    """The lines of a text file, without blank ones at its end.

    Raises InputError as `read_text`, and where there are more than `MOST_LINES`.
    """
    return lines_of(read_text(file).rstrip(), file)


def lines_of(text: str, file: Path) -> list[str]:
    """The lines of a text from a file. Raises InputError for more than `MOST_LINES`."""
    if sum(map(text.count, LINE_ENDS)) > MOST_LINES:
        raise InputError(f"{file}: has more than {MOST_LINES} lines; cut it in parts")
    return text.splitlines()


def read_csv(file: Path) -> CsvText:
    """A CSV in any of the five ways. Raises InputError as `read_text`, and where it is none."""
    head, _, body = read_text(file).rstrip().partition("\n")
    separator = separator_of(head)
    names = tuple(name.strip() for name in cells_of(file, head, separator))
    if '"' in body:
        rows = (cells_of(file, line, separator) for line in lines_of(body, file))
        body, separator = "\n".join(map("\t".join, rows)), "\t"
    # One column alone needs no separator: then a comma is that of its decimals.
    first_row = body.partition("\n")[0]
    if separator != "," or (len(names) == 1 and "." not in first_row):
        body = body.replace(",", ".").replace(separator, ",")
    elif 1 < len(names) < (cells := len(first_row.rstrip(",").split(","))) - 1:
        raise InputError(
            f"{file}: row 2 has {cells} cells for {len(names)} columns; where the comma is "
            "decimal part cells by semicolons, save it again"
        )
    return CsvText(file, names, body)


def separator_of(head: str) -> str:
    """What parts the cells of a CSV with that first line."""
    bare = "".join(head.split('"')[::2])
    return next((each for each in SEPARATORS if each in bare), ",")


def cells_of(file: Path, line: str, separator: str) -> list[str]:
    """The cells of a line, some perhaps in quotes. Raises InputError."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error as cause:
        raise InputError(f"{file}: cannot be read as CSV ({cause}); export it again") from cause


def read_named_rows(file: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """The rows of a CSV file by column name; cells may be in quotes, absent ones are empty.

    Raises InputError for a missing column, and as `read_lines`.
    """
    lines = read_lines(file)
    rows = csv.DictReader(lines, restval="", delimiter=separator_of(lines[0]))
    try:
        missing = [name for name in columns if name not in (rows.fieldnames or ())]
        if missing:
            raise InputError(f"{file}: column {missing[0]} is missing; wanted {','.join(columns)}")
        return list(rows)
    except csv.Error as cause:
        raise InputError(f"{file}: cannot be read as CSV ({cause}); check the file") from cause


def number_in(cell: str) -> float:
    """A finite number, its decimal mark a point or a comma. Raises ValueError."""
    number = float(cell.replace(",", "."))
    if not math.isfinite(number):
        raise ValueError(cell)
    return number


def number_or_nan(cell: str) -> float:
    """The number in a cell; NaN where there is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def numbers_in(line: str) -> list[float]:
    """The numbers of a line that white space parts; none where one of them is no number."""
    try:
        return [float(cell) for cell in line.split()]
    except ValueError:
        return []


def read_header(file: Path) -> tuple[str, ...]:
    """The column names of a CSV file. Raises InputError as `read_csv`."""
    head = read_text(file).partition("\n")[0]
    return tuple(name.strip() for name in cells_of(file, head, separator_of(head)))


def read_table(file: Path, columns: Sequence[str]) -> F64:
    """The named columns (rows, columns) of a CSV file, in the order asked for.

    Raises InputError for a missing column, a cell that is no finite number, a row with too few
    cells, and a table without rows; the message names the row, the header being row 1.
    """
    return read_csv(file).numbers(columns)


def parse_rows(
    file: Path, lines: Sequence[str], columns: Sequence[int], *, first_row: int, comma: bool = True
) -> F64:
    """Numbers (rows, columns) from lines whose cells are parted by commas, or by white space."""
    delimiter = "," if comma else None
    _check_length(file, lines, first_row)
    try:
        numbers = np.loadtxt(lines, delimiter=delimiter, usecols=columns, comments=None, ndmin=2)
    except (ValueError, IndexError):
        numbers = np.empty((0, len(columns)))
    # Blank lines in between are skipped by loadtxt; then rows and lines disagree.
    if len(numbers) != len(lines) or not np.isfinite(numbers).all():
        _refuse_bad_row(file, lines, columns, first_row, delimiter)
    return np.asarray(numbers, dtype=np.float64)


def _check_length(file: Path, lines: Sequence[str], first_row: int) -> None:
    """Refuse a row that is no row: numpy takes its length several times over."""
    for row, line in enumerate(lines, start=first_row):
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"{file}: row {row} has {len(line)} characters, wanted at most {LONGEST_LINE}; "
                "the file is damaged there, remove that row"
            )


def _refuse_bad_row(
    file: Path, lines: Sequence[str], columns: Sequence[int], first_row: int, delimiter: str | None
) -> None:
    for row, line in enumerate(lines, start=first_row):
        cells = line.split(delimiter)
        if len(cells) <= max(columns):
            raise InputError(
                f"{file}: row {row} has {len(cells)} cells, wanted {max(columns) + 1}; "
                "the file is cut off or damaged there, remove that row"
            )
        for column in columns:
            if not math.isfinite(number_or_nan(cells[column])):
                raise InputError(
                    f"{file}: row {row} has {cells[column].strip()[:30]!r}, wanted a finite "
                    "number; remove or repair that row"
                )
    raise InputError(f"{file}: cannot be read as numbers; check the file")


def check_times(file: Path, t_s: F64, *, first_row: int = 2) -> None:
    """Raises InputError, naming the row, where time repeats or runs backward."""
    steps = np.diff(t_s)
    if (steps > 0).all():
        return
    k = int(np.argmax(steps <= 0)) + 1
    kind = "repeats" if steps[k - 1] == 0 else "runs backward"
    raise InputError(
        f"{file}: time {kind} at row {k + first_row} ({t_s[k - 1]:.6f} then {t_s[k]:.6f} s); "
        "sort the rows and drop the repeated ones"
    )


def check_size(file: Path, values: F64, largest: float, unit: str, *, first_row: int = 2) -> None:
    """Raises InputError, naming the row (the header is row 1), where a value is beyond belief."""
    beyond = np.flatnonzero((np.abs(values) > largest).any(axis=1))
    if len(beyond):
        worst = values[beyond[0], np.argmax(np.abs(values[beyond[0]]))]
        raise InputError(
            f"{file}: row {beyond[0] + first_row} has {worst:g} {unit}, wanted at most "
            f"{largest:g}; remove or repair that row, or convert the unit"
        )


def in_order(t_s: Sequence[float] | F64) -> Bool:
    """Which rows (n) make up the longest run of times that never goes backward.

    A single time that leaps ahead leaves that run alone, however many rows it overtakes.
    """
    ends: list[float] = []
    rows: list[int] = []
    before: list[int] = []
    for row, time_s in enumerate(t_s):
        length = bisect_right(ends, time_s)
        ends[length : length + 1] = [time_s]
        rows[length : length + 1] = [row]
        before.append(rows[length - 1] if length else -1)
    kept = np.zeros(len(before), dtype=np.bool_)
    row = rows[-1] if rows else -1
    while row >= 0:
        kept[row], row = True, before[row]
    return kept


def read_timed_table(file: Path, columns: Sequence[str]) -> tuple[F64, F64]:
    """Times (n) from column t_s, strictly increasing, and the other columns (n, columns)."""
    numbers = read_table(file, ["t_s", *columns])
    check_times(file, numbers[:, 0])
    return numbers[:, 0], numbers[:, 1:]


def write_timed_table(file: Path, columns: Sequence[str], t_s: F64, values: F64) -> None:
    """A CSV file with t_s (microseconds kept) and the other columns (nine digits kept)."""
    formats = [TIME_FORMAT] + [NUMBER_FORMAT] * len(columns)
    table = np.column_stack([t_s, values])
    header = ",".join(["t_s", *columns])
    np.savetxt(file, table, fmt=formats, delimiter=",", header=header, comments="")
