"""How fine and how many spots can be told apart: the paper's measurement study, section 4.1.

The classifier is the supervised fingerprint, which needs labelled echoes of every spot.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.world.room import Room, standing_room
from elfslam.world.world_file import World, load_world
from studies.results import Record, averaged
from studies.still_phone import listener_in, visit
from studies.study import Study, StudyContext, finished

SPACING, COUNT = "m apart", "spots"
RECOGNISED, MEAN_M = "recognised", "mean error (m)"
GUESS = "a spot named at random"
NEIGHBOURS = 16
"""Spots told apart where their spacing is varied."""
AWAY_M, TURNED_RAD = 0.05, np.deg2rad(3.0)
"""How far from the first visit's place and heading a phone is held at another."""
VISITS = {"same visit": (0.0, 0.0), "another visit": (AWAY_M, TURNED_RAD)}


DRAWS = 100


@dataclass(frozen=True)
class Point:
    """A spacing (m) or a number of spots, and how often it is measured."""

    varied: str
    at: float
    repeats: int

    @property
    def condition(self) -> str:
        """As records have it."""
        return f"{self.at:g} {self.varied}"


@dataclass(frozen=True)
class Recipe:
    """Echoes of each spot that a classifier learns and is queried with, and how long it learns."""

    learnt: int = 40
    queried: int = 20
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
    context: StudyContext, *, points: Sequence[Point] = POINTS, recipe: Recipe = Recipe()
) -> list[Record]:
    """How often a ResNet-18 names the right spot, and how far off the named one lies."""
    tasks = [
        Repeat(point, number, recipe)
        for number in range(max((point.repeats for point in points), default=0))
        for point in points
        if number < point.repeats
    ]
    repeats = finished(measure_repeat, tasks, context)
    records: list[Record] = []
    for point in points:
        own = [each for task, each in zip(tasks, repeats, strict=True) if task.point == point]
        records += averaged(own, range(len(own)))
    return records


def measure_repeat(repeat: Repeat) -> list[Record]:
    """Train one classifier on a visit to its spots; query it there and at another visit."""
    from studies.fingerprint import FingerprintParameters as Known
    from studies.fingerprint import named_spots, score_fingerprint, train_fingerprint

    world, recipe, point = load_world("lab"), repeat.recipe, repeat.point
    varied = int(point.varied == COUNT)
    generator = np.random.default_rng([repeat.number, varied, round(100 * point.at)])
    spots_m, listener = spots_of(point, world, generator), listener_in(world.room)
    known = Known(recipe.epochs_for(len(spots_m)), recipe.batch, threads=1)
    traces = visit(listener, spots_m, recipe.learnt, generator)
    spot = np.repeat(np.arange(len(spots_m)), recipe.learnt)
    network = train_fingerprint(traces, spot, known, seed=repeat.number)
    queried = np.repeat(np.arange(len(spots_m)), recipe.queried)
    records = []
    for name, (away_m, turned_rad) in VISITS.items():
        echoes = visit(listener, spots_m, recipe.queried, generator, away_m, turned_rad)
        score = score_fingerprint(named_spots(network, echoes), queried, spots_m)
        records += [
            Record(name, RECOGNISED, score.top_1, world="lab", condition=point.condition),
            Record(name, MEAN_M, score.mean_error_m, world="lab", condition=point.condition),
        ]
    apart_m = float(np.linalg.norm(spots_m[:, None] - spots_m[None], axis=2).mean())
    return [*records, Record(GUESS, MEAN_M, apart_m, world="lab", condition=point.condition)]


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


STUDY = Study(
    "How close and how many may spots be that are told apart by their echoes?",
    measure_spots, minutes=75, needs=("torch",), long=True,
    fast={"points": (Point(SPACING, 1.0, 1), Point(COUNT, 2, 2)),
          "recipe": Recipe(learnt=6, queried=2, batch=6, epochs=1, fewest_steps=1)},
)  # fmt: skip
