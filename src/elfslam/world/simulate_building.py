"""A building and a seed in, a recording over several floors and its truth out."""

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from elfslam.base.arguments import Seed, checked
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import LevelPassage, Recording, Truth
from elfslam.world.barometer import read_barometer
from elfslam.world.building import MultiFloorWorld, Storey, check_plan, nearest_on_route
from elfslam.world.building_walk import (
    BuildingWalk,
    course_of,
    levels_of,
    place_changes,
    walk_through,
)
from elfslam.world.circumstances import Circumstances
from elfslam.world.device import BMI160, ImuGrade
from elfslam.world.imu import read_imu
from elfslam.world.kinds import Kind
from elfslam.world.recorder import WorldVisit, record_visits
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import LONGEST_S, WALKERS, Rounds, simulate, truth_of
from elfslam.world.stroll import lane_of, random_person
from elfslam.world.walker import Motion, Walker, random_walker, smooth_lap
from elfslam.world.world_file import World

ATTEMPTS = 4
"""To draw a query's way across a floor that leaves no door of a passage out."""


@checked
def simulate_building(
    building: MultiFloorWorld,
    seed: Seed,
    *,
    plan: Sequence[int] = (),
    rounds: Rounds = 2,
    rate_hz: int = 44_100,
    reverse: bool = False,
    walker: str = WALKERS[0],
    sound: bool = True,
    sensors: Collection[Sensor] = (),
    grade: ImuGrade = BMI160,
    circumstances: Circumstances | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[Recording, Truth]:
    """A walk of `rounds` laps on each floor of the plan, which is the building's by default.

    As `simulate`, with a barometer besides; the truth knows levels. Raises InputError for floors
    that are not there or not joined, and for a walk of more than two hours; ParameterError for
    what only worlds of one floor have.
    """
    if others := set(sensors) - {Sensor.BAROMETER}:
        raise ParameterError(
            f"sensors {', '.join(sorted(others))}: of these a building has {Sensor.BAROMETER} "
            "alone; leave the others out"
        )
    plan = tuple(plan) or building.plan
    check_plan(building, plan)
    generator = np.random.default_rng([seed, 1])
    someone = _someone(walker, building, generator)
    _check_duration(building, plan, rounds, someone)
    course = course_of(building, plan, rounds, generator, reverse=reverse)
    walk = walk_through(someone, course, generator)
    today = circumstances or Circumstances()
    wind = np.random.default_rng([seed, 51])
    barometer = read_barometer(walk.motion, wind, _doors_s(walk), building.entrances_m)
    imu = read_imu(walk.motion, grade, generator)
    audio, played_t_s, gain_db = None, None, None
    if sound:
        audio, played_t_s, gain_db = record_visits(
            visits_of(walk, today), someone, above_ground(walk), rate_hz, seed, generator, progress
        )
    recording = Recording(
        name=building.name,
        device=f"{today.device}, {grade.name}",
        audio=audio,
        imu=imu,
        barometer=barometer,
        played_t_s=played_t_s if today.jitter_s or today.softer_db else None,
        gain_db=gain_db if today.softer_db else None,
    )
    return recording, replace(truth_of(walk.motion), levels=levels_of(walk))


def simulate_place(
    place: World | MultiFloorWorld, seed: int, *, plan: Sequence[int] = (), **walk: Any
) -> tuple[Recording, Truth]:
    """A walk in a world or through a building, by the keywords of either.

    Raises ParameterError for a plan of a world of one floor, and as they do.
    """
    if isinstance(place, MultiFloorWorld):
        return simulate_building(place, seed, plan=plan, **walk)
    if plan:
        raise ParameterError(f"plan: world {place.name!r:.60} has one floor; leave it out")
    return simulate(place, seed, **walk)


def usual_day(
    place: World | MultiFloorWorld, whose: Kind, seed: int, *, asking: bool
) -> tuple[Circumstances, World | MultiFloorWorld]:
    """What is so on the day of a kind of walk, and the place with the ways of that walk."""
    first = place.storeys[0].world if isinstance(place, MultiFloorWorld) else place
    if not asking:
        return whose.mapping(first.room), place
    if isinstance(place, World):
        return whose.asking(first.room), whose.asking_place(place, seed)
    storeys = tuple(_with_ways_of(place, storey, whose, seed) for storey in place.storeys)
    return whose.asking(first.room), replace(place, storeys=storeys)


def _with_ways_of(building: MultiFloorWorld, storey: Storey, whose: Kind, seed: int) -> Storey:
    """The floor with the ways of a query, the usual ones where none drawn passes every door."""
    doors = [link for link in building.links if storey.level in link.levels]
    for attempt in range(ATTEMPTS):
        world = whose.asking_place(storey.world, seed + 1_000_000 * attempt)
        asked = replace(storey, world=world)
        with suppress(InputError):
            for link in doors:
                nearest_on_route(asked, link, world.route_m)
            return asked
    return storey


def _someone(kind: str, building: MultiFloorWorld, generator: np.random.Generator) -> Walker:
    if kind not in WALKERS:
        raise ParameterError(f"walker {kind!r}: wanted {' or '.join(WALKERS)}; correct it")
    if kind == WALKERS[0]:
        return random_walker(generator)
    return random_person(generator, lane_of(building.storeys[0].world.room))


def _check_duration(
    building: MultiFloorWorld, plan: Sequence[int], rounds: int, walker: Walker
) -> None:
    laps_m = (smooth_lap(building.storey(level).world.route_m)[1] for level in plan)
    if rounds * sum(laps_m) > LONGEST_S * walker.speed_mps:
        raise InputError(
            f"building {building.name!r:.60}: {rounds} rounds on {len(plan)} floors take more than "
            f"{LONGEST_S / 3600:g} hours; walk fewer"
        )


def _doors_s(walk: BuildingWalk) -> list[float]:
    """When a door of stairs or a lift opens."""
    return [
        there[0]
        for here, there in pairwise(place_changes(walk))
        if {here[1].passage, there[1].passage} & {LevelPassage.STAIRS, LevelPassage.LIFT}
    ]


def visits_of(walk: BuildingWalk, today: Circumstances) -> list[WorldVisit]:
    """From when on sound is heard in which world; nobody else is on stairs and in lifts."""
    alone = replace(today, state="", day=0, people=0, other_phones=0, lived_in=False)
    return [
        WorldVisit(t_s, place.world, alone if place.passage else today)
        for t_s, place in place_changes(walk)
    ]


def above_ground(walk: BuildingWalk) -> Motion:
    """The motion with heights above the ground under the feet."""
    height_m = walk.motion.position_m - np.outer(walk.ground_m, [0.0, 0.0, 1.0])
    return replace(walk.motion, position_m=height_m)
