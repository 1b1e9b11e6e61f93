"""Rows and page of the sensitivity of localization: a row per change, amount and mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.curves import Curve, curves_figure
from studies.figures.dots import dots_by, dots_figure
from studies.finding import Row
from studies.intervals import mean_interval, mean_of
from studies.localization_table import STATISTICS
from studies.plain_features import FEATURES
from studies.repeats import Numbers

TITLES = {
    "seconds": ("Length of the sequence", "sound used for one fix (s)"),
    "people": ("People walking about", "people beside the holder of the phone"),
    "day": ("Ageing of the map", "days after mapping"),
    "sound": ("Audible noise", "what else is to be heard"),
    "moved": ("Moved furniture", "pieces moved since mapping"),
    "volume": ("Volume", "share of the phone's full level"),
    "phone": ("Another phone", "device that is located"),
}
PAPER_M: Mapping[str, Mapping[str, float]] = {
    "people": {"6": 0.57, "8": 0.6},
    "day": {"0": 0.10, "20": 0.11, "30": 0.12},
    "volume": {"1": 0.10, "0.2": 0.18},
}
"""Medians that the paper gives for one-shot fixes in its living room."""
NAMED = ("sound", "phone")
MODES = {
    "one-shot": "one-shot", "trajectory": "from 8 footsteps", "track": "tracker",
    **{feature: f"{feature}, always answered" for feature in FEATURES},
}  # fmt: skip
NOTE = "Mean over walks of the median error of the answered queries, with its 95 % interval."


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
    """Error and answers side by side for what has an amount, dots for what has a name."""
    curves, dots = [], []
    for world in dict.fromkeys(str(row["world"]) for row in rows):
        here = [row for row in rows if row["world"] == world]
        for change in dict.fromkeys(str(row["change"]) for row in here):
            chosen = [row for row in here if row["change"] == change]
            title = f"{TITLES[change][0]}, {world}"
            if change in NAMED:
                dots.append(_named(title, chosen))
            else:
                curves += [_errors(title, change, world, chosen), _answers(change, chosen)]
    table = Panel("Every amount", rows_table(list(rows)), wide=True)
    subtitle = "a simulated stranger in a map of an ordinary day"
    return Page("Sensitivity of localization", subtitle, [*curves, *dots, table])


def _named(title: str, rows: Sequence[Row]) -> Panel:
    dots = dots_by(
        lambda row: MODES[str(row["mode"])], lambda row: str(row["amount"]),
        rows, "median (m)", "median from", "median to",
    )  # fmt: skip
    return Panel(title, dots_figure(dots, "median error (m)", "the paper"), NOTE, wide=True)


def _errors(title: str, change: str, world: str, rows: Sequence[Row]) -> Panel:
    known = [row for row in rows if row["median (m)"] is not None]
    names = ("median (m)", "median from", "median to")
    curves = {MODES[mode]: _curve(some, *names) for mode, some in _by_mode(known).items()}
    if change in PAPER_M and world == "living_room":
        theirs = PAPER_M[change]
        at = np.array([float(amount) for amount in theirs])
        curves["the paper, one-shot"] = Curve(at, np.array(list(theirs.values())))
    figure = curves_figure(curves, TITLES[change][1], "median error (m)")
    figure.update_yaxes(rangemode="tozero")
    return Panel(title, figure, NOTE)


def _answers(change: str, rows: Sequence[Row]) -> Panel:
    curves = {MODES[mode]: _curve(some, "answered") for mode, some in _by_mode(rows).items()}
    figure = curves_figure(curves, TITLES[change][1], "share of queries answered")
    figure.update_yaxes(range=[0.0, 1.05])
    return Panel("Answered", figure, "The others are refused as ambiguous or as an unknown place.")


def _by_mode(rows: Sequence[Row]) -> dict[str, list[Row]]:
    modes = dict.fromkeys(str(row["mode"]) for row in rows)
    return {mode: [row for row in rows if row["mode"] == mode] for mode in modes}


def _curve(rows: Sequence[Row], *names: str) -> Curve:
    """The columns called `names` (value, and perhaps from and to) over the amount."""
    columns = [np.array([float(str(row[name])) for row in rows]) for name in ("amount", *names)]
    order = np.argsort(columns[0])
    return Curve(*(column[order] for column in columns))
