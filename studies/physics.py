"""Laws of acoustics that our echoes must obey: how far off they are, and what is accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS
from elfslam.world.materials import Material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, air_at, image_echoes
from elfslam.world.pulses import BASEBAND_HZ, C64
from elfslam.world.room import Room, shoebox
from elfslam.world.scene import scene_of
from studies.fidelity import REACH, random_ends, random_polygon, random_shoebox
from studies.results import Record
from studies.study import Study, StudyContext

ROOMS = 20
ABSORPTIONS = (0.4, 0.5, 0.6)
DECAY_SIZES_M = ((4.0, 4.3, 3.8), (5.0, 4.6, 4.8), (3.2, 3.0, 3.5))
DECAY_PLACES = 200
DECAY_DB = (-5.0, -25.0)
DECAY_REACH = Reach(longest_m=34.0, order=24, plan_order=24)
"""A frame's length of sound, with all reflections within it."""
DISTANCES_M = (0.5, 1.0, 2.0, 4.0, 8.0)


def measure_physics(
    context: StudyContext, *, rooms: int = ROOMS, places: int = DECAY_PLACES
) -> list[Record]:
    """How far our echoes are from each law (the condition) at worst, and what is accepted."""
    records = []
    for size_m in DECAY_SIZES_M:
        for absorption in ABSORPTIONS:
            context.announce(f"decay in a room of {size_m} m", None)
            off = decay_s(size_m, absorption, places) / eyring_s(size_m, absorption) - 1
            name = f"decay by Eyring, {' x '.join(map(str, size_m))} m, absorption {absorption}"
            records += _of_law(name, "%", 100 * abs(off), 10.0)
    context.announce("laws in random rooms", None)
    records += _of_law("level falls as 1/r", "dB", _spreading_error_db(), 0.1)
    for kind, draw in (("shoeboxes", random_shoebox), ("polygons with blocks", random_polygon)):
        swapped = max(reciprocity_error(draw, seed) for seed in range(rooms))
        moved = max(motion_error(draw, seed) for seed in range(rooms))
        records += _of_law(f"reciprocity, {kind}", "share of the level", swapped, 1e-6)
        records += _of_law(f"rotation and shift, {kind}", "share of the level", moved, 1e-5)
    return records


def _of_law(law: str, unit: str, off: float, accepted: float) -> list[Record]:
    return [
        Record("ours", f"deviation ({unit})", off, condition=law),
        Record("accepted", f"deviation ({unit})", accepted, condition=law),
    ]


# --- decay ---


def eyring_s(size_m: tuple[float, float, float], absorption: float) -> float:
    """Time in which sound falls by 60 dB in a diffuse field, walls and air taken together.

    Eyring, J. Acoust. Soc. Am. 1, 1930, with the air of Knudsen, ibid. 3, 1931.
    """
    x, y, z = size_m
    surface_m2, air = 2 * (x * y + y * z + z * x), air_at()
    area_m2 = -surface_m2 * np.log(1 - absorption) + 8 * air.attenuation_per_m * x * y * z
    return float(24 * np.log(10) * x * y * z / (air.speed_mps * area_m2))


def decay_s(size_m: tuple[float, float, float], absorption: float, places: int) -> float:
    """The same from sound: backward integration (Schroeder, 1965) of a mean over places."""
    room = shoebox(np.array(size_m), (Material("surface", absorption, 0.0, "uniform"),) * 6)
    generator = np.random.default_rng(17)
    speaker, microphone = generator.uniform(0.5, np.array(size_m) - 0.5, (2, places, 3))
    ends = _omnidirectional(speaker, microphone)
    heard = image_echoes(
        scene_of(room), ends, np.zeros((places, 0, 2)), air_at(), DECAY_REACH, threads=2
    )
    left = np.cumsum((np.abs(heard) ** 2).mean(axis=0)[::-1])[::-1]
    level_db = 10 * np.log10(left / left[0])
    within = (level_db < DECAY_DB[0]) & (level_db > DECAY_DB[1])
    t_s = np.arange(BAND_BINS) / BASEBAND_HZ
    return float(-60 / np.polyfit(t_s[within], level_db[within], 1)[0])


def _omnidirectional(speaker: F64, microphone: F64) -> Transducers:
    count = len(speaker)
    axis, ahead = np.tile([1.0, 0.0, 0.0], (count, 1)), np.tile([1.0, 0.0], (count, 1))
    still = np.zeros((count, 3))
    return Transducers(speaker, microphone, axis, axis, ahead, still, still, 0.0, 0.0, False)


# --- single paths and whole rooms ---


def _spreading_error_db() -> float:
    """How far the direct sound is from 1/r, beside what the air takes."""
    dead = Material("dead", 1.0, 0.0, "absorbs all")
    scene = scene_of(shoebox(np.array([12.0, 6.0, 6.0]), (dead,) * 6))
    distance_m = np.array(DISTANCES_M)
    speaker = np.tile([1.0, 3.0, 3.0], (len(distance_m), 1))
    microphone = speaker + distance_m[:, None] * [1.0, 0.0, 0.0]
    air, nobody = air_at(), np.zeros((len(distance_m), 0, 2))
    heard = image_echoes(scene, _omnidirectional(speaker, microphone), nobody, air, REACH)
    level = np.abs(heard.sum(axis=1)) * np.exp(air.attenuation_per_m * distance_m) * distance_m
    return float(np.abs(20 * np.log10(level)).max())


def reciprocity_error(draw: Callable[[np.random.Generator], Room], seed: int) -> float:
    """Change of a response when speaker and microphone swap, as a share of it."""
    room, ends = _drawn(draw, seed)
    swapped = ends._replace(
        speaker=ends.microphone,
        microphone=ends.speaker,
        speaker_axis=ends.microphone_axis,
        microphone_axis=ends.speaker_axis,
    )
    return _difference(_heard(room, ends), _heard(room, swapped))


def motion_error(draw: Callable[[np.random.Generator], Room], seed: int) -> float:
    """Change of a response when the whole world is turned and shifted, as a share of it."""
    room, ends = _drawn(draw, seed)
    generator = np.random.default_rng([seed, 18])
    turn_rad, shift_m = generator.uniform(0, 2 * np.pi), generator.uniform(-50, 50, 2)
    return _difference(_heard(room, ends), _heard(*moved(room, ends, turn_rad, shift_m)))


def moved(room: Room, ends: Transducers, turn_rad: float, shift_m: F64) -> tuple[Room, Transducers]:
    """A room and phones in it turned about the vertical, then shifted in plan."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    plan, shift = turn[:2, :2], np.append(shift_m, 0.0)
    blocks = tuple(
        replace(block, centre_m=block.centre_m @ plan + shift_m, turn_rad=block.turn_rad + turn_rad)
        for block in room.blocks
    )
    ends = ends._replace(
        speaker=ends.speaker @ turn + shift,
        microphone=ends.microphone @ turn + shift,
        speaker_axis=ends.speaker_axis @ turn,
        microphone_axis=ends.microphone_axis @ turn,
        ahead=ends.ahead @ plan,
        speaker_velocity=ends.speaker_velocity @ turn,
        microphone_velocity=ends.microphone_velocity @ turn,
    )
    return replace(room, outline_m=room.outline_m @ plan + shift_m, blocks=blocks), ends


def _drawn(draw: Callable[[np.random.Generator], Room], seed: int) -> tuple[Room, Transducers]:
    generator = np.random.default_rng([seed, 17])
    room = draw(generator)
    return room, random_ends(room, 0.4, generator)


def _heard(room: Room, ends: Transducers) -> C64:
    nobody = np.zeros((len(ends.speaker), 0, 2))
    return image_echoes(scene_of(room), ends, nobody, air_at(), REACH)


def _difference(one: C64, other: C64) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(one))


STUDY = Study(
    "Do our echoes obey the laws of acoustics?",
    measure_physics, minutes=0.5, fast={"rooms": 2, "places": 20},
)  # fmt: skip
