"""Rows and page of the localization errors: every way beside what the paper reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.dots import Dot, dots_by, dots_figure
from studies.finding import Row
from studies.intervals import mean_interval, mean_of
from studies.repeats import Numbers

PAPER_M: Mapping[tuple[str, str], Mapping[str, tuple[float, float, float]]] = {
    ("ELF", "one-shot"): {
        "living_room": (0.10, 0.29, 0.14), "office": (0.54, 0.60, 0.80), "mall": (0.42, 0.79, 0.67),
    },
    ("wifi, paper's", "one-shot"): {
        "living_room": (1.67, 2.17, 3.30), "office": (3.44, 4.27, 6.16), "mall": (3.04, 3.86, 5.22),
    },
    ("magnetic, paper's", "one-shot"): {
        "living_room": (1.06, 2.31, 3.93), "office": (2.19, 3.95, 5.38),
        "mall": (12.48, 13.36, 19.28),
    },
    ("ELF", "trajectory"): {
        "living_room": (0.10, 0.22, 0.64), "office": (0.41, 0.54, 0.97), "mall": (0.47, 0.53, 0.86),
    },
    ("wifi, paper's", "trajectory"): {
        "living_room": (0.54, 0.73, 1.13), "office": (1.74, 1.86, 3.09), "mall": (1.46, 1.90, 3.73),
    },
    ("magnetic, paper's", "trajectory"): {
        "living_room": (0.56, 0.56, 0.78), "office": (1.75, 1.81, 2.39),
        "mall": (8.70, 8.29, 14.59),
    },
}  # fmt: skip
"""Median, mean and third quartile, m, of localization in three real places."""
TITLES = {"one-shot": "From 0.6 s of sound", "trajectory": "From footsteps and sound"}
STATISTICS = ("median", "mean", "Q3")
NOTE = (
    "Mean over walks of the median error of the answered queries along each, with its 95 % "
    "interval, after the best rigid fit of the map's own walk. The paper's places are other rooms."
)


def localization_rows(by_world: Mapping[str, Sequence[Numbers]]) -> list[Row]:
    """A row per world, method and mode; `by_world` has the numbers of each walk.

    Means over the walks in which there was an answer, the median's with a 95 % interval.
    """
    return [
        {"world": world, "method": method, "mode": mode, **_row(walks, method, mode, world)}
        for world, walks in by_world.items()
        for method, mode in dict.fromkeys(tuple(key.split("|")[:2]) for key in walks[0])
    ]


def _row(walks: Sequence[Numbers], method: str, mode: str, world: str) -> Row:
    def each(name: str) -> list[float]:
        values = [numbers.get(f"{method}|{mode}|{name}", np.nan) for numbers in walks]
        return [value for value in values if np.isfinite(value)]

    paper = PAPER_M.get((method, mode), {}).get(world)
    low, high = mean_interval(each("median"))
    return {
        "error (m)": _joined([each(name) for name in STATISTICS]),
        "median from": low,
        "median to": high,
        "paper (m)": None if paper is None else " / ".join(f"{value:.2f}" for value in paper),
        "answered": mean_of(each("answered")),
        "ambiguous": mean_of(each("ambiguous")),
        "over 1 m off": mean_of(each("gross")),
        "answered elsewhere": mean_of(each("elsewhere")),
        "anchored (m)": _joined([each(f"anchored|{name}") for name in STATISTICS]),
        "NEES": mean_of(each("NEES")),
        "walks": len(walks),
    }


def _joined(columns: Sequence[Sequence[float]]) -> str | None:
    if not all(columns):
        return None
    return " / ".join(f"{np.mean(column):.2f}" for column in columns)


def localization_page(rows: Sequence[Row]) -> Page:
    """The median errors as dots, from sound alone and with footsteps, and the table."""
    figures = [
        Panel(
            TITLES[mode],
            dots_figure(_dots(rows, mode), "median error (m)", "the paper's places"),
            NOTE,
            wide=True,
        )
        for mode in ("one-shot", "trajectory")
    ]
    shown = [{name: row[name] for name in SHORT} for row in rows]
    panels = [*figures, Panel("Median / mean / Q3", rows_table(shown), wide=True)]
    return Page("Localization errors", "a simulated stranger in the map of another walk", panels)


SHORT = (
    "world", "method", "mode", "error (m)", "paper (m)", "answered", "ambiguous", "over 1 m off",
    "answered elsewhere", "NEES",
)  # fmt: skip


def _dots(rows: Sequence[Row], mode: str) -> dict[str, list[Dot]]:
    """By world; the tracker stands among the trajectories."""
    shown = {"one-shot": ("one-shot",), "trajectory": ("trajectory", "track")}[mode]
    return dots_by(
        lambda row: str(row["world"]),
        lambda row: "ELF, tracker" if row["mode"] == "track" else str(row["method"]),
        [row for row in rows if row["mode"] in shown],
        "error (m)", "median from", "median to", "paper (m)",
    )  # fmt: skip
