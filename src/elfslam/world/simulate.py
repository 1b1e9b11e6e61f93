"""A world and a seed in, a recording and its truth out: what a phone would bring home."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64, I64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Chirp, Recording, Truth
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.world.acoustics import FRAME_S, Images, image_sources, render_frames, room_responses
from elfslam.world.device import BMI160, Device, ImuGrade, named_device
from elfslam.world.imu import read_imu
from elfslam.world.room import Furniture, Room, furnish
from elfslam.world.sensors import Sensor, Surroundings, read_surroundings, sense
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, Walker, random_walker, walk
from elfslam.world.wifi import WifiParameters

TRUTH_RATE_HZ = 50.0
LATENCY_S = (0.012, 0.090)
"""Offset from playing to recording: constant within a run, another in each."""
RUMBLE_RMS = 3e-4
"""Room noise below 8 kHz: ventilation, voices, handling."""


@dataclass(frozen=True, eq=False)
class World(Value):
    """A furnished room, the closed route that is walked in it, and what other sensors find."""

    name: str
    room: Room
    route_m: F64 = array("k", 2)
    surroundings: Surroundings | None = None


def world_names() -> list[str]:
    """Names of the built-in worlds."""
    folder = resources.files("elfslam.world").joinpath("worlds")
    return sorted(
        item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml")
    )


def load_world(name: str) -> World:
    """A built-in world by name, or one described in a TOML file."""
    built_in = resources.files("elfslam.world").joinpath("worlds", f"{name}.toml")
    path = Path(name)
    if not built_in.is_file() and not path.is_file():
        raise InputError(
            f"world {name!r}: wanted {', '.join(world_names())} or a TOML file; no such world"
        )
    try:
        text = (built_in if built_in.is_file() else path).read_text(encoding="utf-8")
        table = tomllib.loads(text)
        furniture = tuple(Furniture(**item) for item in table.get("furniture", []))
        generator = np.random.default_rng(table["furniture_seed"])
        room = furnish(
            np.array(table["size_m"]), np.array(table["reflection"]), furniture, generator
        )
        around = read_surroundings(table, room, table["furniture_seed"])
        world = World(table["name"], room, np.array(table["route_m"]), around)
    except (KeyError, TypeError, ValueError) as cause:
        raise InputError(
            f"world {name!r}: not a world description ({cause}); compare with a built-in one"
        ) from cause
    _check_world(world)
    return world


def _check_world(world: World) -> None:
    """Refuse walls that give more than they get, and a route through them."""
    reflection, length_m = world.room.reflection, world.room.size_m[:2]
    if (reflection < 0).any() or (reflection > 1).any():
        raise InputError(
            f"world {world.name!r}: wanted six reflections from 0 to 1, got {reflection.tolist()}; "
            "correct them"
        )
    if (world.route_m < 0).any() or (world.route_m > length_m).any():
        raise InputError(
            f"world {world.name!r}: the route leaves the room; move its corners inside"
        )


def simulate(
    world: World,
    seed: int,
    *,
    rounds: int = 5,
    rate_hz: int = 44_100,
    reverse: bool = False,
    sound: bool = True,
    sensors: Collection[Sensor] = (),
    grade: ImuGrade = BMI160,
    wifi: WifiParameters | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[Recording, Truth]:
    """A walk of `rounds` laps: a recording without any truth in it, and the truth apart.

    The same world and seed give the same bytes. `reverse` walks the route the other way round;
    without `sound` the slow part is left out; `sensors` come on top and change nothing else.
    `progress` hears the share done. Raises InputError where the world lacks what a sensor needs.
    """
    generator = np.random.default_rng([seed, 1])
    walker = random_walker(generator)
    route_m = world.route_m[::-1] if reverse else world.route_m
    motion = walk(walker, route_m, rounds, generator)
    around = world.surroundings or read_surroundings({}, world.room, 0)
    readings = sense(around, motion, seed, sensors, wifi or WifiParameters())
    device = named_device("simulated phone")
    imu = read_imu(motion, grade, generator)
    audio = None
    if sound:
        audio = _record_audio(world.room, device, walker, motion, rate_hz, generator, progress)
    name, phone = f"{world.name} seed {seed}", f"{device.name}, {grade.name}"
    recording = Recording(name=name, device=phone, audio=audio, imu=imu, **readings)
    return recording, _truth(motion)


def describe_chirp() -> dict[str, object]:
    """What the simulated phone played, as recording.json says it."""
    played = ChirpParameters()
    band_hz = [played.band_low_hz, played.band_high_hz]
    return {
        "kind": played.kind,
        "band_hz": band_hz,
        "duration_s": played.duration_s,
        "period_s": played.period_s,
    }


def _truth(motion: Motion) -> Truth:
    step = round(KINEMATICS_RATE_HZ / TRUTH_RATE_HZ)
    poses = np.column_stack([motion.position_m[:, :2], motion.heading_rad])
    return Truth(motion.t_s[::step], poses[::step])


def _record_audio(
    room: Room,
    device: Device,
    walker: Walker,
    motion: Motion,
    rate_hz: int,
    generator: np.random.Generator,
    progress: Callable[[float], None],
) -> Audio:
    """The continuous stream: every chirp's frame laid down where it was played, plus noise."""
    chirp = make_chirp(ChirpParameters(), rate_hz)
    latency = round(generator.uniform(*LATENCY_S) * rate_hz)
    frame = round(FRAME_S * rate_hz)
    total = int(motion.t_s[-1] * rate_hz)
    starts = np.arange(latency, total - frame, frame)
    images = image_sources(room)
    stream = np.zeros(total, dtype=np.float32)
    for first in range(0, len(starts), 200):
        block = starts[first : first + 200]
        at = np.minimum((block / rate_hz * KINEMATICS_RATE_HZ).astype(int), len(motion.t_s) - 1)
        sound = _frames_at(room, images, device, walker, motion, at, chirp)
        stream[block[0] : block[0] + sound.size] += sound.ravel()
        progress(min((first + 200) / len(starts), 1.0))
    stream += _noise(total, rate_hz, device, generator)
    return Audio(np.clip(stream, -1.0, 1.0)[None, :], rate_hz)


def _frames_at(
    room: Room,
    images: Images,
    device: Device,
    walker: Walker,
    motion: Motion,
    at: I64,
    chirp: Chirp,
) -> F32:
    body_m = np.full(len(at), walker.body_distance_m)
    responses = room_responses(
        room,
        images,
        device,
        motion.position_m[at],
        motion.yaw_rad[at],
        motion.pitch_rad[at],
        body_m,
    )
    return render_frames(responses, chirp, device)


def _noise(count: int, rate_hz: int, device: Device, generator: np.random.Generator) -> F32:
    white = device.noise_rms * generator.standard_normal(count, dtype=np.float32)
    low = signal.sosfilt(
        signal.butter(2, 4_000, fs=rate_hz, output="sos"), generator.standard_normal(count)
    )
    return np.asarray(white + RUMBLE_RMS * low, dtype=np.float32)
