"""A world and a seed in, a recording and its truth out: what a phone would bring home."""

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Annotated

import numpy as np

from elfslam.base.arguments import Seed, Such, checked
from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import Recording, Truth
from elfslam.world.circumstances import Circumstances
from elfslam.world.device import BMI160, ImuGrade
from elfslam.world.doors import entrances_m
from elfslam.world.imu import read_imu
from elfslam.world.recorder import record_walk
from elfslam.world.sensors import Sensor, read_surroundings, sense
from elfslam.world.stroll import lane_of, random_person, stroll
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, Walker, random_walker, walk
from elfslam.world.wifi import WifiParameters
from elfslam.world.world_file import World, load_world, walked_room, world_names

__all__ = ["World", "load_world", "simulate", "world_names"]

Rounds = Annotated[int, Such(lambda rounds: rounds > 0, "integer from 1 on")]
WALKERS = ("surveyor", "person")
"""Who walks laps on one line, and who strays from it."""
TRUTH_RATE_HZ = 50.0
LONGEST_S = 2 * 3600.0
"""Of a walk; it is held in memory at 400 poses and 48,000 samples a second."""


@checked
def simulate(
    world: World,
    seed: Seed,
    *,
    rounds: Rounds = 5,
    rate_hz: int = 44_100,
    reverse: bool = False,
    walker: str = WALKERS[0],
    sound: bool = True,
    sensors: Collection[Sensor] = (),
    grade: ImuGrade = BMI160,
    circumstances: Circumstances | None = None,
    wifi: WifiParameters | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[Recording, Truth]:
    """A walk of `rounds` laps: a recording without any truth in it, and the truth apart.

    `walker` is one of `WALKERS`. `circumstances` say what else is so that day; they change neither
    walker nor route.

    The same world and seed give the same bytes. `reverse` walks the route the other way round;
    without `sound` the slow part is left out; `sensors` come on top and change nothing else.
    `progress` hears the share done. Raises InputError where the world lacks what a sensor needs,
    and for a walk of more than two hours; ParameterError for another walker.
    """
    generator = np.random.default_rng([seed, 1])
    route_m = world.route_m[::-1] if reverse else world.route_m
    someone, motion = _walked(world, route_m, rounds, walker, generator)
    around = replace(
        world.surroundings or read_surroundings({}, world.room, 0),
        entrances_m=entrances_m(world.doors, world.room),
    )
    readings = sense(around, motion, seed, sensors, wifi or WifiParameters())
    today = circumstances or Circumstances()
    imu = read_imu(motion, grade, generator)
    audio, played_t_s, gain_db = None, None, None
    if sound:
        audio, played_t_s, gain_db = record_walk(
            world, today, someone, motion, rate_hz, seed, generator, progress
        )
    recording = Recording(
        name=world.name,
        device=f"{today.device}, {grade.name}",
        audio=audio,
        imu=imu,
        played_t_s=played_t_s if today.jitter_s or today.softer_db else None,
        gain_db=gain_db if today.softer_db else None,
        **readings,
    )
    return recording, truth_of(motion)


def _walked(
    world: World, route_m: F64, rounds: int, kind: str, generator: np.random.Generator
) -> tuple[Walker, Motion]:
    if kind not in WALKERS:
        raise ParameterError(f"walker {kind!r}: wanted {' or '.join(WALKERS)}; correct it")
    if kind == WALKERS[0]:
        surveyor = random_walker(generator)
        _check_duration(world, rounds, surveyor)
        return surveyor, walk(surveyor, route_m, rounds, generator)
    person = random_person(generator, lane_of(world.room))
    _check_duration(world, rounds, person)
    return person, stroll(person, route_m, rounds, walked_room(world), generator)


def _check_duration(world: World, rounds: int, walker: Walker) -> None:
    lap_m = np.linalg.norm(world.route_m - np.roll(world.route_m, 1, axis=0), axis=1).sum()
    most = LONGEST_S * walker.speed_mps / float(lap_m)
    if rounds > most:
        raise InputError(
            f"world {world.name!r:.60}: rounds of {lap_m:.0f} m, wanted {most:.0f} at most, which "
            f"take {LONGEST_S / 3600:g} hours; walk fewer"
        )


def truth_of(motion: Motion) -> Truth:
    """Where the walker was, and which way they went, as often as it is scored."""
    step = round(KINEMATICS_RATE_HZ / TRUTH_RATE_HZ)
    poses = np.column_stack([motion.position_m[:, :2], motion.heading_rad])
    return Truth(motion.t_s[::step], poses[::step])
