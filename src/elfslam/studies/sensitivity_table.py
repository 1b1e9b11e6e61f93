"""Rows and page of the sensitivity of localization: a row per change, amount and mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.score.curves import Curve, curves_figure
from elfslam.score.dots import Dot, dots_figure
from elfslam.score.page import Page, Panel, rows_table
from elfslam.studies.finding import Row
from elfslam.studies.localization_table import STATISTICS, mean_interval, mean_of
from elfslam.studies.repeats import Numbers

TITLES = {
    "seconds": ("Length of the sequence", "sound used for one fix (s)"),
    "people": ("People walking about", "people beside the holder of the phone"),
    "day": ("Ageing of the map", "days after mapping"),
    "sound": ("Audible noise", "what else is to be heard"),
    "moved": ("Moved furniture", "pieces moved since mapping"),
    "volume": ("Volume", "share of the phone's full level"),
    "phone": ("Another phone", "device that is located"),
    "phone, calibrated": ("Another phone, calibrated", "device that is located"),
}
PAPER_M: Mapping[str, Mapping[str, float]] = {
    "people": {"6": 0.57, "8": 0.6},
    "day": {"0": 0.10, "20": 0.11, "30": 0.12},
    "volume": {"1": 0.10, "0.2": 0.18},
}
"""Medians that the paper gives for one-shot fixes in its living room."""
NOTE = (
    "Mean over walks of the median error of answered queries, with its 95 % interval; the share of "
    "queries answered stands in the table."
)


def sensitivity_rows(by_world: Mapping[str, Sequence[Numbers]]) -> list[Row]:
    """A row per world, change, amount and mode; means over the walks that had an answer."""
    return [
        {"world": world, "change": change, "amount": amount, "mode": mode,
         **_row(walks, "|".join((change, amount, mode)))}
        for world, walks in by_world.items()
        for change, amount, mode in dict.fromkeys(tuple(key.split("|")[:3]) for key in walks[0])
    ]  # fmt: skip


def _row(walks: Sequence[Numbers], key: str) -> Row:
    def each(name: str) -> list[float]:
        values = [numbers.get(f"{key}|{name}", np.nan) for numbers in walks]
        return [value for value in values if np.isfinite(value)]

    low, high = mean_interval(each("median"))
    statistics: Row = {f"{name} (m)": mean_of(each(name)) for name in STATISTICS}
    return {
        **statistics,
        "median from": low,
        "median to": high,
        "answered": mean_of(each("answered")),
        "ambiguous": mean_of(each("ambiguous")),
        "over 1 m off": mean_of(each("gross")),
        "walks": len(walks),
    }


def sensitivity_page(rows: Sequence[Row]) -> Page:
    """A panel per change: curves where it has an amount, dots where it has a name."""
    panels = []
    for world in dict.fromkeys(str(row["world"]) for row in rows):
        here = [row for row in rows if row["world"] == world and row["median (m)"] is not None]
        for change in dict.fromkeys(str(row["change"]) for row in here):
            chosen = [row for row in here if row["change"] == change]
            panels.append(_panel(f"{TITLES[change][0]}, {world}", change, chosen))
    table = Panel("Every amount", rows_table(list(rows)), wide=True)
    subtitle = "a simulated stranger in a map of an ordinary day"
    return Page("Sensitivity of localization", subtitle, [*panels, table])


def _panel(title: str, change: str, rows: Sequence[Row]) -> Panel:
    x_title = TITLES[change][1]
    if change in ("sound", "phone", "phone, calibrated"):
        names = {"one-shot": "from 0.6 s", "trajectory": "8 footsteps", "track": "tracker"}
        dots = {
            names[mode]: [_dot(row) for row in rows if row["mode"] == mode]
            for mode in dict.fromkeys(str(row["mode"]) for row in rows)
        }
        return Panel(title, dots_figure(dots, "median error (m)", "the paper"), NOTE, wide=True)
    curves = {
        mode: _curve([row for row in rows if row["mode"] == mode])
        for mode in dict.fromkeys(str(row["mode"]) for row in rows)
    }
    if change in PAPER_M and "living_room" in title:
        theirs = PAPER_M[change]
        at = np.array([float(amount) for amount in theirs])
        curves["the paper, one-shot"] = Curve(at, np.array(list(theirs.values())))
    return Panel(title, curves_figure(curves, x_title, "median error (m)"), NOTE)


def _curve(rows: Sequence[Row]) -> Curve:
    names = ("amount", "median (m)", "median from", "median to")
    columns = [np.array([float(str(row[name])) for row in rows]) for name in names]
    order = np.argsort(columns[0])
    x, y, low, high = (column[order] for column in columns)
    return Curve(x, y, low, high)


def _dot(row: Row) -> Dot:
    value, low, high = (
        float(str(row[name])) for name in ("median (m)", "median from", "median to")
    )
    return Dot(str(row["amount"]), value, low, high)
