"""Rows and page of the errors off the line: by lanes, by laps, and by laps per metre of width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.curves import Curve, curves_figure
from studies.finding import Row
from studies.intervals import mean_interval, mean_of
from studies.lap_answers import OFFSETS_M
from studies.lap_echoes import Crowd
from studies.repeats import Numbers

WIDTH = 4.0
"""Of what people walk on, in standard deviations of their lanes: 95 % of them."""
MEDIAN, GROSS = "median (m)", "over 1 m off"
METRES = {"type": "log", "tickvals": (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)}
"""Errors of decimetres and of ten metres side by side."""
RECALLS = {"recall at 1 %": "", "recall of eight at 0.1 %": "eight|"}
NOTE = "Band: 95 %, by resampling walks."
SHORT = (
    "world", "kind", "asked by", "lane (m)", "laps", "feature", MEDIAN, GROSS, "threshold",
    "answered", "answered, median (m)", "answered, over 1 m off",
)  # fmt: skip


class Asked(NamedTuple):
    """What a row is of."""

    world: str
    kind: str
    asked_by: str
    lane_m: float
    laps: int


def laps_rows(
    crowds: Sequence[Crowd],
    numbers: Sequence[Numbers],
    thresholds: Mapping[str, Mapping[str, float]],
) -> list[Row]:
    """A row per world, sound, who asks, lane, laps and feature: means over seeds, intervals."""
    found: dict[Asked, list[Numbers]] = {}
    for crowd, each in zip(crowds, numbers, strict=True):
        for laps in crowd.laps:
            asked = Asked(crowd.world, crowd.kind, crowd.asked_by, crowd.lane_m, laps)
            found.setdefault(asked, []).append(each)
    return [
        _row(asked, name, threshold, seeds)
        for asked, seeds in sorted(found.items(), key=lambda item: _order(crowds, item[0]))
        for name, threshold in thresholds[asked.kind].items()
    ]


def _order(crowds: Sequence[Crowd], asked: Asked) -> tuple[int, float, int]:
    """Worlds and who asks as they were given, then lanes, then laps."""
    places = list(dict.fromkeys((crowd.world, crowd.kind, crowd.asked_by) for crowd in crowds))
    return places.index(asked[:3]), asked.lane_m, asked.laps


def _row(asked: Asked, name: str, threshold: float, seeds: Sequence[Numbers]) -> Row:
    world, kind, asked_by, lane_m, laps = asked

    def each(what: str) -> list[float]:
        values = [numbers[f"{laps}|{name}|{what}"] for numbers in seeds]
        return [value for value in values if np.isfinite(value)]

    return {
        "world": world,
        "kind": kind,
        "asked by": asked_by,
        "lane (m)": lane_m,
        "laps": laps,
        "laps per m": round(laps / (WIDTH * lane_m), 2),
        "feature": name,
        **_with_interval(MEDIAN, each("median")),
        **_with_interval(GROSS, each("gross")),
        "threshold": threshold,
        "answered": mean_of(each("answered")),
        "answered, median (m)": mean_of(each("answered|median")),
        "answered, over 1 m off": mean_of(each("answered|gross")),
        **{
            f"{recall}, {low_m:g} to {high_m:g} m": _recall(
                seeds, f"{laps}|{name}|{of}", f"{high_m:g}"
            )
            for recall, of in RECALLS.items()
            for low_m, high_m in pairwise(OFFSETS_M)
        },
        "seeds": len(seeds),
    }


def _with_interval(name: str, values: Sequence[float]) -> Row:
    low, high = mean_interval(values)
    return {name: mean_of(values), f"{name}, from": low, f"{name}, to": high}


def _recall(seeds: Sequence[Numbers], prefix: str, offset: str) -> float | None:
    """The share found of all places of so much offset; None where there is none."""
    near, found = (
        sum(numbers.get(f"{prefix}{what}|{offset}", 0.0) for numbers in seeds)
        for what in ("near", "found")
    )
    return round(found / near, 3) if near else None


def laps_page(rows: Sequence[Row]) -> Page:
    """Errors and gross errors against laps and lanes, by world; laps per metre; the table."""
    panels = []
    for venue in dict.fromkeys(_venue(row) for row in rows):
        there = [row for row in rows if _venue(row) == venue]
        title = f"{venue[0]}, {venue[1]}".replace("_", " ")
        lane_m, few = _crossing(there)
        by_laps = [row for row in there if row["lane (m)"] == lane_m]
        by_lane = [row for row in there if row["laps"] == few]
        if len({row["laps"] for row in by_laps}) > 1:
            panels += _panels(f"{title}: lanes of {lane_m} m", by_laps, "laps")
        if len({row["lane (m)"] for row in by_lane}) > 1:
            panels += _panels(f"{title}: {few} laps", by_lane, "lane (m)")
    panels += _per_metre(rows)
    table = rows_table([{name: row[name] for name in SHORT} for row in rows])
    panels.append(Panel("Figures", table, "Means over seeds.", wide=True))
    return Page(
        "Off the line", "0.6 s of a stranger's walk by the most alike of mapped spots", panels
    )


def _venue(row: Row) -> tuple[object, object, object]:
    return row["world"], row["kind"], row["asked by"]


def _crossing(rows: Sequence[Row]) -> tuple[object, object]:
    """The lane in which most counts of laps were mapped, and the count that most lanes have."""

    def most(varied: str, counted: str) -> object:
        values = dict.fromkeys(row[varied] for row in rows)
        return max(values, key=lambda v: len({r[counted] for r in rows if r[varied] == v}))

    return most("lane (m)", "laps"), most("laps", "lane (m)")


def _panels(title: str, rows: Sequence[Row], varied: str) -> list[Panel]:
    """The median error and the share over a metre off, a curve for each feature."""
    made = []
    for measure in (MEDIAN, GROSS):
        curves = _curves(rows, varied, measure, "feature")
        figure = curves_figure(curves, varied, measure, ticks=_values(rows, varied))
        figure.update_yaxes(**(METRES if measure == MEDIAN else {"rangemode": "tozero"}))
        made.append(Panel(title, figure, NOTE))
    return made


def _per_metre(rows: Sequence[Row]) -> list[Panel]:
    """For each feature the error against laps per metre of width, a curve for each world."""
    made, crowded = [], _with_many_laps(rows)
    for name in dict.fromkeys(str(row["feature"]) for row in crowded):
        of_feature = [row for row in crowded if row["feature"] == name]
        curves = _curves(of_feature, "laps per m", MEDIAN, "world")
        figure = curves_figure(curves, "laps per metre of width", MEDIAN, ticks=(1, 2, 5, 10, 20))
        figure.update_yaxes(**METRES)
        made.append(Panel(f"{name}: laps per metre", figure, "A width is four lanes (sd)."))
    return made


def _with_many_laps(rows: Sequence[Row]) -> list[Row]:
    """The rows of lanes in which several counts of laps were mapped."""

    def crowd(row: Row) -> tuple[object, ...]:
        return *_venue(row), row["lane (m)"]

    counts: dict[tuple[object, ...], set[object]] = {}
    for row in rows:
        counts.setdefault(crowd(row), set()).add(row["laps"])
    return [row for row in rows if len(counts[crowd(row)]) > 1]


def _curves(rows: Sequence[Row], varied: str, measure: str, by: str) -> dict[str, Curve]:
    columns = (varied, measure, f"{measure}, from", f"{measure}, to")
    return {
        str(name).replace("_", " "): Curve(
            *np.array([[row[key] for key in columns] for row in rows if row[by] == name], float).T
        )
        for name in dict.fromkeys(row[by] for row in rows)
    }


def _values(rows: Sequence[Row], varied: str) -> list[float]:
    return sorted({float(str(row[varied])) for row in rows})
