"""Tables of a TOML file: values checked one by one, refusals that say which line they mean."""

import difflib
import math
import re
from collections.abc import Collection, Mapping, Sized
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import parse_toml

LARGEST_M = 500.0
"""No coordinate or length of a world is beyond this."""
MOST_ITEMS = 1000
"""Of a list: tables of one kind, corners of one line."""

_HEADER = re.compile(r"\s*\[\[?\s*([A-Za-z][\w-]*)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r'\s*"?([A-Za-z][\w-]*)"?\s*[.=]')
Lines = Mapping[str, int]


@dataclass(frozen=True)
class Table:
    """One table of a file: its values, the lines of its keys, and under "" its own line.

    `inner` has the lines of the tables in it, by kind and number from 1.
    """

    file: str
    label: str
    values: Mapping[str, Any]
    lines: Lines
    inner: Mapping[tuple[str, int], Lines] = field(default_factory=dict)

    def refusal(self, complaint: str, key: str = "") -> InputError:
        """The error to raise: file, line of the key, element and complaint."""
        line = self.lines.get(key, self.lines[""])
        label = f", {self.label}" if self.label else ""
        return InputError(f"{self.file} line {line}{label}: {complaint}")


def read_table(text: str, file: str) -> Table:
    """The whole of a TOML text. Raises InputError with the line where it is none."""
    try:
        values = parse_toml(text, "")
    except InputError as cause:
        found = re.search(r"at line (\d+)", str(cause))
        line = found[1] if found else len(text.splitlines())
        raise InputError(f"{file} line {line}{cause}") from cause
    lines = _line_numbers(text)
    return Table(file, "", values, lines[("", 0)], lines)


def _line_numbers(text: str) -> dict[tuple[str, int], dict[str, int]]:
    lines: dict[tuple[str, int], dict[str, int]] = {("", 0): {"": 1}}
    here, counts = lines["", 0], dict[str, int]()
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            kind = header[1]
            counts[kind] = counts.get(kind, 0) + 1
            here = lines[kind, counts[kind]] = {"": number}
            lines["", 0].setdefault(kind, number)
        elif key := _KEY.match(line):
            here.setdefault(key[1], number)
    return lines


def tables(parent: Table, kind: str, name: str = "name") -> list[Table]:
    """The `[[kind]]` tables, each labelled by its number and its name."""
    rows = parent.values.get(kind, [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise parent.refusal(
            f"{kind}: wanted [[{kind}]] tables, got {rows!r:.40}; double the brackets", kind
        )
    _check_count(parent, kind, rows, MOST_ITEMS)
    return [
        Table(parent.file, _label(kind, k, row.get(name)), row, _lines_of(parent, kind, k))
        for k, row in enumerate(rows, 1)
    ]


def table(parent: Table, kind: str) -> Table:
    """The `[kind]` table; empty where there is none."""
    values = parent.values.get(kind, {})
    if not isinstance(values, dict):
        raise parent.refusal(
            f"{kind}: wanted a [{kind}] table, got {values!r:.40}; correct it", kind
        )
    return Table(parent.file, kind, values, _lines_of(parent, kind, 1))


def inline(parent: Table, key: str, values: object, label: str) -> Table:
    """A table `{...}` inside the value of a key."""
    if not isinstance(values, dict):
        raise parent.refusal(f"{label}: wanted a table in braces, got {values!r:.40}", key)
    prefix = f"{parent.label}, " if parent.label else ""
    line = parent.lines.get(key, parent.lines[""])
    return Table(parent.file, prefix + label, values, {"": line})


def _label(kind: str, number: int, name: object) -> str:
    return f'{kind} {number} "{name}"' if isinstance(name, str) else f"{kind} {number}"


def _lines_of(parent: Table, kind: str, number: int) -> Lines:
    own = parent.inner.get((kind, number))
    return own or {"": parent.lines.get(kind, parent.lines[""])}


def check_keys(given: Table, known: Collection[str]) -> None:
    """Refuse a key that nobody knows, with the nearest that is known."""
    for key in given.values:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            advice = f"did you mean {near[0]!r}?" if near else "remove it"
            raise given.refusal(f"knows no {key!r:.60}; wanted {', '.join(known)}; {advice}", key)


def text(given: Table, key: str, default: str | None = None) -> str:
    """A text that is not empty."""
    value = _value(given, key, default)
    if not isinstance(value, str) or not value.strip():
        raise given.refusal(f"{key} is {value!r:.40}, wanted a text in quotes; correct it", key)
    return value


def number(
    given: Table,
    key: str,
    default: float | None = None,
    *,
    low: float = -LARGEST_M,
    high: float = LARGEST_M,
) -> float:
    """A finite number between two bounds."""
    value = _value(given, key, default)
    if not _is_number(value, low, high):
        wanted = f"wanted a number from {low:g} to {high:g}"
        raise given.refusal(f"{key} is {value!r:.60}, {wanted}; correct it", key)
    return float(value)


def whole(given: Table, key: str, default: int | None = None, *, low: int, high: int) -> int:
    """A whole number between two bounds."""
    value = _value(given, key, default)
    if not isinstance(value, int) or not _is_number(value, low, high):
        wanted = f"wanted a whole number from {low} to {high}"
        raise given.refusal(f"{key} is {value!r:.60}, {wanted}; correct it", key)
    return value


def vector(
    given: Table,
    key: str,
    size: int,
    default: tuple[float, ...] | None = None,
    *,
    low: float = -LARGEST_M,
    high: float = LARGEST_M,
) -> F64:
    """A list of so many finite numbers between two bounds."""
    value = _value(given, key, None if default is None else list(default))
    if not _is_vector(value, size, low, high):
        wanted = f"wanted {size} numbers from {low:g} to {high:g}"
        raise given.refusal(f"{key} is {value!r:.60}, {wanted}; correct it", key)
    return np.array(value, dtype=np.float64)


def points(given: Table, key: str, value: object, most: int = MOST_ITEMS) -> F64:
    """Points in plan (n, 2); `value` lies somewhere under the key."""
    if not isinstance(value, list) or not value:
        raise given.refusal(f"{key} is {value!r:.60}, wanted a list of [x, y]; correct it", key)
    _check_count(given, key, value, most)
    for k, point in enumerate(value, 1):
        if not _is_vector(point, 2, -LARGEST_M, LARGEST_M):
            raise given.refusal(
                f"{key}: point {k} is {point!r:.60}, wanted [x, y] of at most {LARGEST_M:g} m; "
                "correct it", key,
            )  # fmt: skip
    return np.array(value, dtype=np.float64)


def rows(given: Table, key: str, most: int = MOST_ITEMS) -> list[Any]:
    """A list, empty where there is none."""
    value = given.values.get(key, [])
    if not isinstance(value, list):
        raise given.refusal(f"{key} is {value!r:.60}, wanted a list; put it in brackets", key)
    _check_count(given, key, value, most)
    return value


def _check_count(given: Table, key: str, items: Sized, most: int) -> None:
    if len(items) > most:
        raise given.refusal(f"{key} has {len(items)}, wanted {most} at most; take some out", key)


def _value(given: Table, key: str, default: object) -> Any:
    value = given.values.get(key, default)
    if value is None:
        raise given.refusal(f"lacks {key}; add it")
    return value


def _is_number(value: object, low: float, high: float) -> bool:
    is_real = isinstance(value, int | float) and not isinstance(value, bool)
    return is_real and math.isfinite(value) and low <= value <= high  # type: ignore[arg-type,operator]


def _is_vector(value: object, size: int, low: float, high: float) -> bool:
    return (
        isinstance(value, list)
        and len(value) == size
        and all(_is_number(item, low, high) for item in value)
    )
