"""Rows and page of the mapping errors: every method beside what the paper reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.dots import Dot, dots_by, dots_figure
from studies.finding import Row
from studies.intervals import mean_range
from studies.repeats import Numbers

PAPER_M: Mapping[str, Mapping[str, tuple[float, float, float]]] = {
    "ELF": {
        "living_room": (0.10, 0.10, 0.14), "office": (0.63, 0.63, 0.80), "mall": (0.45, 0.53, 0.69),
    },
    "ELF without pre-training": {
        "living_room": (0.73, 0.82, 1.25), "office": (1.69, 1.68, 1.94), "mall": (1.16, 1.14, 1.42),
    },
    "wifi, paper's": {
        "living_room": (0.44, 0.45, 0.55), "office": (1.52, 1.54, 2.06), "mall": (1.24, 1.26, 1.54),
    },
    "magnetic, paper's": {
        "living_room": (0.56, 0.55, 0.64), "office": (1.14, 1.24, 1.82), "mall": (0.79, 0.81, 1.05),
    },
}  # fmt: skip
"""Median, mean and third quartile, m, of mapping in three real places."""
PLACED = ("declared start", "aligned", "aligned with scale")
"""Where the map lies: as the walker declared, or where it fits the truth best."""
STATISTICS = ("median", "mean", "Q3")
EVIDENCE = ("found", "right", "believed", "believed right")


def mapping_rows(by_world: Mapping[str, Sequence[Numbers]]) -> list[Row]:
    """A row per world, walker and method; `by_world` has the numbers of each walk.

    Errors in metres are means over the walks, the median's with a 95 % interval.
    """
    return [
        {"world": world, "walker": walker, "method": method, **_row(walks, walker, method, world)}
        for world, walks in by_world.items()
        for walker, method in dict.fromkeys(tuple(key.split("|")[:2]) for key in _most(walks))
    ]


def _most(walks: Sequence[Numbers]) -> Numbers:
    """The walk that most methods were tried on."""
    return max(walks, key=len)


def _row(walks: Sequence[Numbers], walker: str, method: str, world: str) -> Row:
    walks = [numbers for numbers in walks if f"{walker}|{method}|aligned|median" in numbers]

    def each(name: str) -> list[float]:
        return [numbers[f"{walker}|{method}|{name}"] for numbers in walks]

    row: Row = {}
    for placed in PLACED:
        means = [np.mean(each(f"{placed}|{name}")) for name in STATISTICS]
        row[f"{placed} (m)"] = " / ".join(f"{mean:.2f}" for mean in means)
        low, high = mean_range(each(f"{placed}|median"))
        row[f"{placed}, median from"] = round(low, 3)
        row[f"{placed}, median to"] = round(high, 3)
    paper = PAPER_M.get(method, {}).get(world)
    row["paper (m)"] = None if paper is None else " / ".join(f"{value:.2f}" for value in paper)
    found, right, believed, held = (sum(each(f"closures|{name}")) for name in EVIDENCE)
    row["closures"] = round(found / len(walks), 1)
    row["right"] = round(right / found, 4) if found else None
    row["believed"] = round(believed / len(walks), 1)
    row["believed, right"] = round(held / believed, 4) if believed else None
    for name in ("within one sigma", "within two sigma", "NEES"):
        row[name] = round(float(np.mean(each(f"uncertainty|{name}"))), 3)
    row["walks"] = len(walks)
    return row


def mapping_page(rows: Sequence[Row]) -> Page:
    """The median errors as dots, aligned, a panel of figures for each kind of walker."""
    figures = [
        Panel(
            f"Mapping error, walkers {walker}",
            dots_figure(_dots(rows, walker), "median error, aligned (m)", "the paper's places"),
            NOTE,
            wide=True,
        )
        for walker in dict.fromkeys(str(row["walker"]) for row in rows)
    ]
    table = [{name: row[name] for name in SHORT} for row in rows]
    panels = [*figures, Panel("Median / mean / Q3", rows_table(table), wide=True)]
    return Page("Mapping errors", "simulated walks, every method on the same line", panels)


NOTE = (
    "Mean over walks of the median error along each, with its 95 % interval. The paper walked in "
    "other rooms: its figures say what order to expect, not more."
)
SHORT = (
    "world", "walker", "method", "declared start (m)", "aligned (m)", "aligned with scale (m)",
    "paper (m)", "closures", "believed, right", "within one sigma", "within two sigma",
)  # fmt: skip


def _dots(rows: Sequence[Row], walker: str) -> dict[str, list[Dot]]:
    return dots_by(
        lambda row: str(row["world"]), lambda row: str(row["method"]),
        [row for row in rows if row["walker"] == walker],
        "aligned (m)", "aligned, median from", "aligned, median to", "paper (m)",
    )  # fmt: skip
