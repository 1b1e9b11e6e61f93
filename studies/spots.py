"""How fine and how many spots can be told apart: the paper's measurement study, section 3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.room import Room
from elfslam.world.walkable import standing_room
from elfslam.world.world_file import World, load_world
from studies.figures.curves import curves_figure
from studies.finding import Finding, Given, Row
from studies.intervals import by_measure, curve_of, mean_row
from studies.repeats import Numbers, finished
from studies.stability import measure_stability
from studies.still_phone import listener_in, visit

SPACING, COUNT = "spacing (m)", "spots"
NEAREST = "nearest spot (m)"
NEIGHBOURS = 16
"""Spots told apart where their spacing is varied."""
AWAY_M, TURNED_RAD = 0.05, np.deg2rad(3.0)
"""How far from the first visit's place and heading a phone is held at another."""
VISITS = {"same visit": (0.0, 0.0), "another visit": (AWAY_M, TURNED_RAD)}
TABLE_NOTE = (
    f"Another visit: within {100 * AWAY_M:g} cm of the first, turned by "
    f"{np.rad2deg(TURNED_RAD):g} degrees, one standard deviation. A guess: a spot named at random. "
    "Intervals: 95 %, over repeats."
)
STABLE_SPOTS = 32
DRAWS = 100


@dataclass(frozen=True)
class Point:
    """A spacing (m) or a number of spots, and how often it is measured."""

    varied: str
    at: float
    repeats: int


@dataclass(frozen=True)
class Recipe:
    """What each classifier learns from and is asked: echoes per spot, and how long it learns."""

    learnt: int = 40
    asked: int = 20
    batch: int = 32
    epochs: int = 4
    fewest_steps: int = 120

    def epochs_for(self, spots: int) -> int:
        """Passes over the echoes of so many spots: few spots need more of them."""
        steps = max(spots * self.learnt // self.batch, 1)
        return max(self.epochs, -(-self.fewest_steps // steps))


@dataclass(frozen=True)
class Repeat:
    """One classifier; other repeats of the point have other spots, echoes and first weights."""

    point: Point
    number: int
    recipe: Recipe


POINTS = (
    *(Point(SPACING, at, 20) for at in (0.25, 0.5, 1.0, 2.0, 3.0)),
    *(Point(COUNT, at, 20) for at in (8, 16, 32)),
    Point(COUNT, 64, 10),
    Point(COUNT, 128, 6),
)


def measure_spots(
    given: Given,
    *,
    points: Sequence[Point] = POINTS,
    recipe: Recipe = Recipe(),
    stable_spots: int = STABLE_SPOTS,
) -> Finding:
    """How often a ResNet-18 names the right spot, and how far off the named one lies.

    Then how stable the echo's spectrum is at one spot.
    """
    world = load_world("lab")
    tasks = [
        Repeat(point, number, recipe)
        for number in range(max((point.repeats for point in points), default=0))
        for point in points
        if number < point.repeats
    ]
    numbers = finished(measure_repeat, tasks, given)
    given.announce("stability", None)
    steady, panels = measure_stability(world, stable_spots)
    named = _rows(points, tasks, numbers)
    return Finding(named + steady, _page(points, named, steady, panels, recipe))


def measure_repeat(repeat: Repeat) -> Numbers:
    """Train one classifier on a visit to its spots; ask it there and at another visit."""
    from studies.fingerprint import FingerprintParameters as Known
    from studies.fingerprint import named_spots, score_fingerprint, train_fingerprint

    world, recipe = load_world("lab"), repeat.recipe
    varied = int(repeat.point.varied == COUNT)
    generator = np.random.default_rng([repeat.number, varied, round(100 * repeat.point.at)])
    spots_m, listener = spots_of(repeat.point, world, generator), listener_in(world.room)
    known = Known(recipe.epochs_for(len(spots_m)), recipe.batch, threads=1)
    traces = visit(listener, spots_m, recipe.learnt, generator)
    spot = np.repeat(np.arange(len(spots_m)), recipe.learnt)
    network = train_fingerprint(traces, spot, known, seed=repeat.number)
    asked = np.repeat(np.arange(len(spots_m)), recipe.asked)
    found: Numbers = {}
    for name, (away_m, turned_rad) in VISITS.items():
        heard = visit(listener, spots_m, recipe.asked, generator, away_m, turned_rad)
        score = score_fingerprint(named_spots(network, heard), asked, spots_m)
        found |= {f"recognised, {name}": score.top_1, f"error (m), {name}": score.mean_error_m}
    return found | _geometry(spots_m)


def spots_of(point: Point, world: World, generator: np.random.Generator) -> F64:
    """The spots (n, 2): some of the marked ones, or neighbours so far apart."""
    if point.varied == COUNT:
        return np.asarray(generator.choice(world.spots_m, int(point.at), replace=False))
    return spots_apart(world.room, point.at, NEIGHBOURS, generator)


def spots_apart(room: Room, spacing_m: float, count: int, generator: np.random.Generator) -> F64:
    """The free places (count, 2) of a lattice that lie nearest to one of them, drawn anew.

    Raises InputError for a room that has not so many.
    """
    across, along = np.ceil(room.size_m[:2] / spacing_m).astype(int) + 1
    lattice = np.stack(np.meshgrid(np.arange(across), np.arange(along)), axis=-1).reshape(-1, 2)
    for _ in range(DRAWS):
        places = room.corner_m + spacing_m * (lattice + generator.uniform(0, 1, 2) - 1)
        free = places[standing_room(room, places)]
        if len(free) >= count:
            far_m = np.linalg.norm(free - free[generator.integers(len(free))], axis=1)
            return np.asarray(free[np.argsort(far_m, kind="stable")[:count]])
    raise InputError(f"spots: wanted {count} free places {spacing_m:g} m apart; ask for fewer")


def _geometry(spots_m: F64) -> Numbers:
    """How far it is to the nearest spot, and to one that is guessed."""
    apart_m = np.linalg.norm(spots_m[:, None] - spots_m[None], axis=2)
    others = apart_m + np.diag(np.full(len(spots_m), np.inf))
    nearest_m, guess_m = float(others.min(axis=1).mean()), float(apart_m.mean())
    return {"error (m), a guess": guess_m, NEAREST: nearest_m}


def _rows(
    points: Sequence[Point], tasks: Sequence[Repeat], numbers: Sequence[Numbers]
) -> list[Row]:
    """A row for every point and measure."""
    rows = []
    for point in points:
        own = [each for task, each in zip(tasks, numbers, strict=True) if task.point == point]
        for measure in own[0]:
            values = [each[measure] for each in own]
            rows.append(mean_row(point.varied, point.at, measure, values, "repeats"))
    return rows


def _page(
    points: Sequence[Point],
    named: list[Row],
    steady: list[Row],
    panels: list[Panel],
    recipe: Recipe,
) -> Page:
    drawn = [
        _panel(varied, measure, named)
        for varied in dict.fromkeys(point.varied for point in points)
        for measure in ("recognised", "error (m)")
    ]
    subtitle = (
        f"ResNet-18 with a 7x7 stem of stride 2 and a pool; {recipe.learnt} echoes of each spot "
        f"learnt, {recipe.asked} asked at each visit; simulated lab of 16 x 28 m"
    )
    shown = by_measure([row for row in named if row["measure"] != NEAREST])
    table = Panel("Spots told apart", rows_table(shown), TABLE_NOTE, wide=True)
    details = {"Table of the spectra": rows_table(by_measure(steady))}
    return Page(
        "How fine, how many, how stable", subtitle, [table, *drawn, *panels], details=details
    )


def _panel(varied: str, measure: str, rows: list[Row]) -> Panel:
    chosen = {
        name: [r for r in rows if r["varied"] == varied and r["measure"] == f"{measure}, {name}"]
        for name in VISITS
    }
    curves = {name: curve_of(some) for name, some in chosen.items()}
    ticks = curves["same visit"].x.tolist()
    words = {"recognised": "Spots recognised", "error (m)": "Mean error"}[measure]
    what = {SPACING: f"{NEIGHBOURS} spots", COUNT: "Marked spots, drawn at random"}[varied]
    y_title = "share of echoes" if measure == "recognised" else "m"
    figure = curves_figure(curves, varied, y_title, ticks=ticks)
    title = f"{words} against {varied.removesuffix(' (m)')}"
    return Panel(title, figure, f"{what}. Bands: 95 %.")
