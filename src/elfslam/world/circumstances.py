"""What differs between two recordings in one world: day, furniture, people, phone and noise."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import ParameterError
from elfslam.world import interference
from elfslam.world.device import Device, built_in_device
from elfslam.world.diffuse import diffuse_echoes
from elfslam.world.doors import with_doors
from elfslam.world.materials import Material, material
from elfslam.world.paths import Reach
from elfslam.world.phone import Engine, air_at, image_echoes
from elfslam.world.pulses import Air
from elfslam.world.room import Block, Room
from elfslam.world.scattering import as_measured, scattering_of
from elfslam.world.world_file import World, in_state

Sound = Callable[[int, int, np.random.Generator], F32]

SOUNDS: Mapping[str, Sound] = MappingProxyType(
    {
        "speech": partial(interference.speech_like, level=0.02),
        "music": partial(interference.music_like, level=0.02),
        "clicks": partial(interference.clicks, level=0.005),
    }
)
"""What else is to be heard, by name; the levels are those of a talk beside the phone."""
DIFFUSE = "diffuse"
ENGINES = ("images", DIFFUSE, "pyroomacoustics")
"""Mirror images with clutter, mirror images with a diffuse field, and the second engine."""
SOLID_REACH = Reach(order=3, plan_order=3, block_order=3, beside_block=3)
"""For the second engine, whose work grows with the number of faces to the power of the order."""
MOST_PEOPLE = 50
MOST_PHONES = 8
LONGEST_JITTER_S = 0.035
"""Chirps a period of 100 ms apart are then at least the 65 ms apart that a frame takes."""
SOFTEST_DB = 20.0

WARMTH_C = 1.5
"""Standard deviation of the room's temperature from day to day."""
DRAWN_C = 20.0
"""As the world was drawn, where it tells no temperature: the one that the pipeline assumes."""
INDOORS_C = (17.0, 26.0)
OFF_C = 0.5
"""At least by so much a lived-in room is warmer or colder than assumed."""
MOVED_PER_DAY = 1 / 60
"""Share of the low furniture that is no longer in its place after a day; half of it at most."""
MOVED_M = 0.06
MOVED_RAD = np.deg2rad(3.0)
LOW_FURNITURE_M = 1.3
KEEP_AWAY_M = 0.6
"""People let the holder of the phone pass at this distance."""


@dataclass(frozen=True)
class Circumstances:
    """The circumstances of a recording.

    `state` names one of the world's states of the furniture, `day` counts from when the world was
    drawn, `volume` is the share of the phone's full level. A place that is `lived_in` has its doors
    as that day finds them and a temperature of its own, from the first day on. Each chirp is played
    at a random moment of the first `jitter_s` of its period, and by chance as loud as can be or
    `softer_db` softer. Raises ParameterError for what cannot be.
    """

    state: str = ""
    day: int = 0
    people: int = 0
    device: str = "simulated phone"
    volume: float = 1.0
    sounds: tuple[str, ...] = ()
    other_phones: int = 0
    engine: str = "images"
    jitter_s: float = 0.0
    softer_db: float = 0.0
    lived_in: bool = False

    def __post_init__(self) -> None:
        _require("day", self.day, 0, 36_500)
        _require("people", self.people, 0, MOST_PEOPLE)
        _require("other phones", self.other_phones, 0, MOST_PHONES)
        _require("jitter", self.jitter_s, 0.0, LONGEST_JITTER_S)
        _require("softer chirps", self.softer_db, 0.0, SOFTEST_DB)
        _require("volume", self.volume, 0.001, 1.0)
        for sound in self.sounds:
            if sound not in SOUNDS:
                raise ParameterError(f"sound {sound!r}: wanted {', '.join(SOUNDS)}; correct it")
        if self.engine not in ENGINES:
            raise ParameterError(
                f"engine {self.engine!r}: wanted {' or '.join(ENGINES)}; correct it"
            )


def parse_sounds(text: str) -> tuple[str, ...]:
    """The sounds in a list such as "speech,clicks"; none in an empty one."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _require(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ParameterError(f"{name}: wanted {low} to {high}, got {value}; correct it")


def engine_of(circumstances: Circumstances, room: Room, threads: int) -> Engine:
    """The engine that was asked for, in this room; ours on so many threads."""
    if circumstances.engine == "images":
        return partial(image_echoes, threads=threads)
    if circumstances.engine == DIFFUSE:
        return partial(
            diffuse_echoes, scattering=scattering_of(room), person=material("person"),
            threads=threads,
        )  # fmt: skip
    from elfslam.world import pyroom

    return pyroom.image_echoes


def reach_of(circumstances: Circumstances) -> Reach:
    """How far paths are followed: as far as the engine can in a furnished room."""
    return SOLID_REACH if circumstances.engine == "pyroomacoustics" else Reach()


def closed_solids(room: Room) -> Room:
    """The room as the second engine can model it.

    What stands on the floor reaches up to the ceiling, what hangs is left out, and all is smooth.
    """
    blocks = tuple(
        replace(
            block,
            size_m=np.append(block.size_m[:2], room.height_m),
            surface=_smooth(block.surface),
            clutter_per_m2=0.0,
        )
        for block in room.blocks
        if block.base_m == 0
    )
    walls = tuple(_smooth(wall) for wall in room.walls)
    floor, ceiling = _smooth(room.floor), _smooth(room.ceiling)
    return replace(room, walls=walls, floor=floor, ceiling=ceiling, blocks=blocks)


def _smooth(surface: Material) -> Material:
    return replace(surface, scattering=0.0)


def device_of(circumstances: Circumstances) -> Device:
    """The phone at the volume that was asked for."""
    device = built_in_device(circumstances.device)
    return replace(device, level=device.level * circumstances.volume)


def room_on(world: World, circumstances: Circumstances) -> Room:
    """The room in the asked state, with what has been moved a little by that day, and its doors."""
    room = in_state(world, circumstances.state).room if circumstances.state else world.room
    if circumstances.day:
        room = _after_days(room, circumstances.day)
    if circumstances.lived_in:
        room = with_doors(room, world.doors, world.ways_m, circumstances.day)
    return room_in(room, circumstances)


def room_in(room: Room, circumstances: Circumstances) -> Room:
    """The room as the asked engine models it."""
    if circumstances.engine == DIFFUSE:
        return as_measured(room)
    return room if circumstances.engine == "images" else closed_solids(room)


def _after_days(room: Room, day: int) -> Room:
    generator = np.random.default_rng([room.seed, day, 1])
    share = min(day * MOVED_PER_DAY, 0.5)
    blocks = tuple(_moved(room, block, share, generator) for block in room.blocks)
    return replace(room, blocks=blocks)


def _moved(room: Room, block: Block, share: float, generator: np.random.Generator) -> Block:
    is_moved = generator.uniform() < share
    shift, turn = generator.normal(0, MOVED_M, 2), generator.normal(0, MOVED_RAD)
    stays = block.clutter_per_m2 == 0 or block.top_m > LOW_FURNITURE_M
    if stays or not is_moved:
        return block
    moved = replace(block, centre_m=block.centre_m + shift, turn_rad=block.turn_rad + turn)
    return moved if room.holds(moved.corners_m).all() else block


def air_on(world: World, day: int, *, lived_in: bool = False) -> Air:
    """The air of that day; day 0 is as the world says, but where people live."""
    told_c, humidity = world.climate.temperature_c, world.climate.humidity_percent
    warmth_c = np.random.default_rng([world.room.seed, day, 2]).normal(0, WARMTH_C)
    if lived_in:
        return air_at(_lived_in_c(told_c, world.room.seed, warmth_c), humidity)
    return air_at((DRAWN_C if told_c is None else told_c) + (warmth_c if day else 0.0), humidity)


def _lived_in_c(told_c: float | None, seed: int, warmth_c: float) -> float:
    if told_c is None:
        liked_c = np.random.default_rng([seed, 6]).uniform(*INDOORS_C)
        today_c = float(np.clip(liked_c + warmth_c, *INDOORS_C))
    else:
        today_c = told_c + warmth_c
    off_c = today_c - DRAWN_C
    return DRAWN_C + float(np.copysign(max(abs(off_c), OFF_C), off_c))


def whereabouts(world: World, people: int, seed: int, t_s: F64, phone_xy_m: F64) -> F64:
    """Where each of the others is at each time (n, people, 2); they step aside for the phone.

    They walk the world's routes of people to and fro, and the phone's own, round and round, where
    it has none.
    """
    generator = np.random.default_rng([seed, 4])
    laps = [_to_and_fro(route) for route in world.people.routes_m] or [world.route_m]
    where = np.zeros((len(t_s), people, 2))
    for k in range(people):
        lap = laps[int(generator.integers(len(laps)))]
        speed = world.people.speed_mps * generator.uniform(0.8, 1.2) * generator.choice([-1, 1])
        where[:, k] = _along(lap, generator.uniform(0.0, 1.0), speed * t_s)
        where[:, k] += generator.normal(0, 0.15, 2)
    away = where - phone_xy_m[:, None, :]
    distance = np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-6)
    return np.asarray(where + away / distance * np.maximum(KEEP_AWAY_M - distance, 0.0))


def _to_and_fro(route_m: F64) -> F64:
    """The closed route that leads along an open one and back on it."""
    return np.vstack([route_m, route_m[-2:0:-1]])


def _along(route_m: F64, start: float, way_m: F64) -> F64:
    """Places (n, 2) on a closed route after so many metres, from a share of its length on."""
    closed = np.vstack([route_m, route_m[:1]])
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    now = (start * at_m[-1] + way_m) % at_m[-1]
    return np.column_stack([np.interp(now, at_m, closed[:, axis]) for axis in range(2)])
