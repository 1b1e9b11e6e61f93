"""Rows of means with their intervals, and such rows as curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from elfslam.base.arrays import F64
from elfslam.scoring.bootstrap import interval
from studies.figures.curves import Curve
from studies.finding import Row


def mean_range(blocks: Iterable[float | F64]) -> tuple[float, float]:
    """Where the mean of values, or of blocks of them, lies with 95 %, by resampling these."""
    each = [np.atleast_1d(block) for block in blocks]
    return interval(each, lambda some: float(some.mean()), np.random.default_rng(0))


def mean_interval(values: Sequence[float]) -> tuple[float | None, float | None]:
    """The same to three places; None where there is nothing."""
    if not values:
        return None, None
    low, high = mean_range(values)
    return round(low, 3), round(high, 3)


def mean_of(values: Sequence[float]) -> float | None:
    """The mean to three places; None where there is nothing."""
    return round(float(np.mean(values)), 3) if values else None


def mean_row(
    varied: str, at: float | None, measure: str, values: F64 | Sequence[float], over: str
) -> Row:
    """The mean of some values (n), and its 95 % interval by resampling them."""
    low, high = mean_range(values)
    return {
        "varied": varied,
        "at": at,
        "measure": measure,
        "mean": round(float(np.mean(values)), 4),
        "from": round(low, 4),
        "to": round(high, 4),
        "over": f"{len(values)} {over}",
    }


def curve_of(rows: Sequence[Row]) -> Curve:
    """Rows of one measure as a curve."""
    columns = ("at", "mean", "from", "to")
    x, y, low, high = (np.array([row[name] for row in rows], float) for name in columns)
    return Curve(x, y, low, high)


def by_measure(rows: Sequence[Row]) -> list[Row]:
    """The same in short: a row for each value of what is varied, a column for each measure.

    All need the same measures.
    """
    found: dict[tuple[object, ...], Row] = {}
    for row in rows:
        known = {name: row[name] for name in ("varied", "at", "over")}
        texts = [f"{row[name]:.3f}" for name in ("mean", "from", "to")]
        short = found.setdefault(tuple(known.values()), {**known, "at": _plain(row["at"])})
        short[str(row["measure"])] = f"{texts[0]} ({texts[1]} to {texts[2]})"
    return list(found.values())


def _plain(at: object) -> object:
    return at if at is None else f"{at:g}"
