"""Superimposition: one map for all orientations, after the paper's section on floor maps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.app.workers import silent_elsewhere
from elfslam.base.progress import Announce
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.kinds import SURVEYOR, Kind
from studies.figures.curves import Curve, curves_figure
from studies.figures.elf_figures import strips_figure
from studies.finding import Finding, Given, Row
from studies.floor_spots import SETS, SHARES, TOGETHER, Spots, measure_floor
from studies.intervals import mean_row
from studies.opposite_ways import MAPPED, PLACED, Ways, measure_ways
from studies.repeats import Numbers, finished

MEASURES = ("mean", "median", "Q3", "over 1 m")
PAPER_M = {"one direction|different direction": 3.2, "superimposed": 0.24, "supervised": 0.56}
"""Mean errors of the paper's 4,000 simulated spots."""
SEEDS = tuple(range(10))
CURVES = (
    ("superimposed", SETS[2]),
    ("one direction", "different direction"),
    ("mean of all directions", SETS[2]),
    ("all directions kept apart", SETS[2]),
    ("supervised", SETS[2]),
)
SPOTS_NOTE = (
    "Fixes from six echoes. Places off the grid and headings between the four that were learnt; of "
    "the map of one direction, its own spots asked in the three others."
)
STRIPS_NOTE = (
    "A row for each of four directions at one spot, a column for each of the 128 numbers, the same "
    "order in both. After superimposition the rows agree better."
)
WAYS_NOTE = "Fixes from six echoes of a third person, all walks together."

Task = Spots | Ways


def measure_superimposition(
    given: Given,
    *,
    floors: Sequence[Spots] = (Spots(),),
    ways: Sequence[Ways] | None = None,
    kind: Kind = SURVEYOR,
) -> Finding:
    """Errors with and without superimposition: both ways round a room, and on thousands of spots.

    Trainings are kept beside `kept` and go on from there.
    """
    folder = (given.kept or Path("superimposition.partial")).parent / "superimposition"
    walked_ways = ways if ways is not None else [Ways(seed=s, kind=kind.name) for s in SEEDS]
    tasks: list[Task] = [*walked_ways, *floors]
    measure = partial(_measured, folder=folder, announce=silent_elsewhere(given.announce))
    numbers = finished(measure, tasks, given)
    pairs = list(zip(tasks, numbers, strict=True))
    on_spots = [(task, found) for task, found in pairs if isinstance(task, Spots)]
    walked = [found for task, found in pairs if isinstance(task, Ways)]
    rows = [row for task, found in on_spots for row in _spot_rows(task, found)]
    return Finding(rows + _way_rows(walked), _page(on_spots, walked, rows))


def _measured(task: Task, folder: Path, announce: Announce) -> Numbers:
    if isinstance(task, Spots):
        return measure_floor(task, folder, announce)
    return measure_ways(task, folder, announce)


def _spot_rows(task: Spots, numbers: Numbers) -> list[Row]:
    """A row for each map, what it was asked and from how many echoes."""
    names = dict.fromkeys(key.rsplit("|", 1)[0] for key in numbers if key.endswith("|median"))
    place = f"{task.world}, {task.spots} spots"
    return [
        {
            **_row(place, name, {m: numbers[f"{name}|{m}"] for m in MEASURES}),
            "paper, mean (m)": _paper_m(name),
        }
        for name in names
    ]


def _way_rows(walked: Sequence[Numbers]) -> list[Row]:
    """The same over all walks: means of each walk's mean, median and so on."""
    if not walked:
        return []
    names = dict.fromkeys(key.rsplit("|", 1)[0] for key in walked[0] if key.endswith("|median"))
    place = f"both ways round, {len(walked)} pairs of walks"
    rows = []
    for name in names:
        means = {m: float(np.mean([each[f"{name}|{m}"] for each in walked])) for m in MEASURES}
        medians = [each[f"{name}|median"] for each in walked]
        spread = mean_row("", None, "", medians, "walks")
        interval = {"median, 95 %": f"{spread['from']:.3f} to {spread['to']:.3f}"}
        rows.append({**_row(place, name, means), **interval})
    return rows


def _paper_m(key: str) -> float | str:
    """The paper's mean error for this map, where it was asked the same."""
    return next((error_m for name, error_m in PAPER_M.items() if key.startswith(name)), "")


def _row(place: str, key: str, errors: Numbers) -> Row:
    """A row of a map, what it was asked and from how many echoes: all three are in its key."""
    name, asked, together = key.split("|")
    return {
        "place": place,
        "map": name,
        "asked": asked,
        "echoes": together,
        **{m if m == "over 1 m" else f"{m} (m)": round(errors[m], 3) for m in MEASURES},
    }


def _page(
    on_spots: Sequence[tuple[Spots, Numbers]], walked: Sequence[Numbers], rows: list[Row]
) -> Page:
    panels = [panel for task, found in on_spots for panel in _spot_panels(task, found)]
    if walked:
        panels += [_ways_panel(walked, placed) for placed in PLACED]
        panels.append(Panel("Both ways round", rows_table(_way_rows(walked)), wide=True))
    if rows:
        panels.append(Panel("Spots", rows_table(rows), wide=True))
    subtitle = "Simulated phones; no trace that is asked was learnt from"
    return Page("One map for all orientations", subtitle, panels)


def _spot_panels(task: Spots, numbers: Numbers) -> list[Panel]:
    curves = {
        f"{name}, {asked}": _shares(numbers, f"{name}|{asked}|{TOGETHER}")
        for name, asked in CURVES
        if f"{name}|{asked}|{TOGETHER}|q0" in numbers
    }
    figure = curves_figure(curves, "error (m)", "share of fixes", ticks=(0.01, 0.1, 1.0, 10.0))
    spread = {asked: _shares(numbers, f"superimposed|{asked}|{TOGETHER}") for asked in SETS}
    inside = curves_figure(spread, "error (m)", "share of fixes", ticks=(0.01, 0.1, 1.0))
    elfs = {
        f"{when} superimposition: similarity {numbers[f'likeness|{when}|A']:.2f}": np.array(
            [[numbers[f"A|{when}|{k}|{i}"] for i in range(128)] for k in range(4)]
        )
        for when in ("before", "after")
    }
    return [
        Panel(f"{task.spots} spots in the {task.world}", figure, SPOTS_NOTE),
        Panel("Superimposed: heard before and never", inside, "Fixes from six echoes."),
        Panel("Spot A's ELFs in four directions", strips_figure(elfs), STRIPS_NOTE, wide=True),
    ]


def _ways_panel(walked: Sequence[Numbers], placed: str) -> Panel:
    names = dict.fromkeys(key.split("|")[0] for key in walked[0] if f"|{placed}|" in key)
    curves = {name: _pooled(walked, f"{name}|{placed}|{TOGETHER}") for name in names}
    figure = curves_figure(curves, "error (m)", "share of fixes", ticks=(0.01, 0.1, 1.0, 10.0))
    title = "Opposite ways, maps as walked" if placed == MAPPED else "Opposite ways, maps true"
    return Panel(title, figure, WAYS_NOTE)


def _shares(numbers: Numbers, name: str) -> Curve:
    error_m = np.array([numbers[f"{name}|q{k}"] for k in range(len(SHARES))])
    return Curve(error_m, SHARES)


def _pooled(walked: Sequence[Numbers], name: str) -> Curve:
    """Quantiles of the quantiles of all walks, which have about as many fixes each."""
    every = [numbers[f"{name}|q{k}"] for numbers in walked for k in range(len(SHARES))]
    return Curve(np.quantile(every, SHARES), SHARES)
