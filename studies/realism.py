"""Are simulated rooms like measured ones? Statistics of their responses side by side.

Measured: two circles of loudspeakers in one room in eight states of its walls (R3VIVAL, CC BY 4.0).
Simulated: phones along the routes of the worlds, and in the rooms that encoders are trained in, by
mirror images with clutter and by mirror images with a diffuse field.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.baselines.generic import generic_encoders
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.circumstances import Circumstances, engine_of, reach_of
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, built_in_device
from elfslam.world.echo_pairs import random_room
from elfslam.world.phone import air_at, poses_at, room_responses
from elfslam.world.pulses import C64
from elfslam.world.room import Room
from elfslam.world.scattering import as_measured
from elfslam.world.scene import scene_of
from elfslam.world.world_file import load_world
from studies.real_rooms import PERIOD_S, echo_of
from studies.results import Record
from studies.study import Study, StudyContext

WORLDS = ("living_room", "office", "mall")
PLACES = 60
TRAINING_ROOMS = 20
MOVED_M = (0.005, 0.025, 0.1, 0.4)
"""Of the phone; a source that stays needs a microphone moved twice as far for as much."""
RATE_HZ = 48_000
FILES = {"2 m": "r3vival_2m.npz", "1.5 m": "r3vival_1.5m.npz"}
STATES = {"walls hard": 0, "absorbers out": 4}
KINDS = {"images": "mirror images and clutter", "diffuse": "diffuse field"}


class Place(NamedTuple):
    """Responses (n, samples) from their direct sound on, and the same moved, by how far (m).

    `xy_m` (n, 2) is where they were heard, None where no two are near each other.
    """

    name: str
    kind: str
    responses: F64
    moved: Mapping[float, F64]
    xy_m: F64 | None = None


def measure_realism(
    context: StudyContext,
    *,
    worlds: tuple[str, ...] = WORLDS,
    places: int = PLACES,
    rooms: int = TRAINING_ROOMS,
) -> list[Record]:
    """Kurtosis, spread, T60 and contrast of every room, by delay or by how far the phone moved.

    Without `data` there is no measured room. Places along the routes by seed 0.
    """
    found = [] if context.data is None else list(measured_places(context.data / "rirs"))
    tasks = [(kind, name) for kind in KINDS for name in (*worlds, "")]
    for k, (kind, name) in enumerate(tasks):
        context.announce(name or "training rooms", k / len(tasks))
        if name:
            found.append(places_along(name, kind, places))
        else:
            found.append(_in_training_rooms(kind, rooms, places // rooms))
    context.announce("statistics", 0.9)
    return [record for place in found for record in _records(place)]


def measured_places(folder: Path) -> list[Place]:
    """The measured room in two of its states; microphones 5 and 10 cm from the first."""
    found = []
    for circle, file in FILES.items():
        with np.load(folder / file, allow_pickle=False) as archive:
            rir = np.moveaxis(archive["rir"], 2, 3)[..., int(archive["direct_sample"]) :]
        for state, k in STATES.items():
            here = rir[k].astype(np.float64)
            moved = {0.025: here[:, 1]}
            found.append(Place(f"{circle}, {state}", "measured", here[:, 0], moved))
    return found


def places_along(
    name: str, kind: str, count: int, moved_m: Sequence[float] = MOVED_M, device: str = "flat"
) -> Place:
    """Phones that look along a world's route, and each moved so far."""
    world, generator = load_world(name), np.random.default_rng(0)
    corners = np.vstack([world.route_m, world.route_m[:1]])
    legs = np.diff(corners, axis=0)
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(legs, axis=1))])
    way = generator.uniform(0.0, at_m[-1], count)
    leg = np.searchsorted(at_m, way, side="right") - 1
    xy = np.column_stack([np.interp(way, at_m, corners[:, axis]) for axis in range(2)])
    yaw = np.arctan2(legs[leg, 1], legs[leg, 0])
    return _heard(name, kind, world.room, xy, yaw, generator, moved_m, device)


def _in_training_rooms(kind: str, rooms: int, places: int) -> Place:
    """Phones in rooms that encoders are trained in."""
    parts = []
    for k in range(rooms):
        generator = np.random.default_rng([9, k])
        room = random_room(generator)
        tried = room.corner_m + generator.uniform(0, 1, (400, 2)) * room.size_m[:2]
        xy = tried[room.is_free(tried, 1.2, 0.3)][:places]
        yaw = generator.uniform(-np.pi, np.pi, len(xy))
        parts.append(_heard("", kind, room, xy, yaw, generator, MOVED_M))
    moved = {far: np.concatenate([part.moved[far] for part in parts]) for far in MOVED_M}
    name = f"{rooms} training rooms"
    return Place(name, KINDS[kind], np.concatenate([part.responses for part in parts]), moved)


def _heard(
    name: str,
    kind: str,
    room: Room,
    xy_m: F64,
    yaw_rad: F64,
    generator: np.random.Generator,
    moved_m: Sequence[float],
    device: str = "flat",
) -> Place:
    """What phones hear there, and each moved by so much in some direction."""
    today = Circumstances(engine=kind)
    there = as_measured(room) if kind == "diffuse" else room
    scene, engine = scene_of(there), engine_of(today, there, 1)

    def responses(at_m: F64) -> F64:
        poses = poses_at(
            np.column_stack([at_m, np.full(len(at_m), 1.2)]), yaw_rad, np.full(len(at_m), 0.4)
        )
        phone = built_in_device(device)
        return response_of(room_responses(scene, phone, poses, air_at(), reach_of(today), engine))

    angle = generator.uniform(-np.pi, np.pi, len(xy_m))
    step = np.column_stack([np.cos(angle), np.sin(angle)])
    moved = {far: responses(xy_m + far * step) for far in moved_m}
    return Place(name, KINDS[kind], responses(xy_m), moved, xy_m)


def response_of(envelopes: C64) -> F64:
    """Impulse responses (n, samples) at 48 kHz of complex envelopes (n, 630)."""
    size, first = round(RATE_HZ / BIN_HZ), round(BAND_LOW_HZ / BIN_HZ)
    spectrum = np.zeros((len(envelopes), size // 2 + 1), dtype=np.complex128)
    baseband = np.fft.fftshift(np.fft.fft(envelopes, axis=1), axes=1)
    spectrum[:, first : first + BAND_BINS] = baseband
    return np.asarray(np.fft.irfft(spectrum, size, axis=1))


def echoes_of(responses: F64) -> F32:
    """The echo (n, 2352) of a chirp through each response (n, samples)."""
    chirp = make_chirp(replace(ChirpParameters(), period_s=PERIOD_S), RATE_HZ)
    return np.stack([echo_of(response, chirp) for response in responses])


def _features(responses: F64) -> F32:
    return generic_encoders()["spectrogram without mean"].embed(echoes_of(responses))


def _records(place: Place) -> Iterator[Record]:
    band = banded(place.responses, RATE_HZ)
    here = _features(place.responses)
    of = Record(place.kind, "", 0.0, world=place.name)
    shown = {"kurtosis": kurtosis(band, RATE_HZ), "spread (dB)": spread_db(band, RATE_HZ)}
    for metric, values in shown.items():
        for (first, last), value in zip(WINDOWS_MS, values, strict=True):
            yield replace(of, metric=metric, value=value, condition=f"{first} to {last} ms")
    t60_ms = 1000 * reverberation_s(band, RATE_HZ)
    if np.isfinite(t60_ms):
        yield replace(of, metric="T60 (ms)", value=t60_ms)
    for far_m, moved in place.moved.items():
        kept = contrast(here, _features(moved))
        yield replace(of, metric="contrast", value=kept, condition=f"{100 * far_m:g} cm")


# --- statistics of responses ---


BAND_HZ = (15_200.0, 19_800.0)
WINDOWS_MS = ((11, 20), (20, 35), (35, 60))
LENGTH_S = 0.062
"""Of a response from its direct sound on; longer ones are cut to what simulated ones have."""
LOCAL_SAMPLES = 96
ENVELOPE_STEP, ENVELOPE_LOCAL = 8, 15
DECAY_FROM_S = 0.005
BLOCK_S = 0.002
BLOCK_MEDIAN = 1.05
"""Mean energy of a block of a diffuse field over the exponential of its mean logarithm."""


def banded(responses: F64, rate_hz: int) -> F64:
    """Responses (n, samples) from their direct sound on, between 15.2 and 19.8 kHz."""
    sections = signal.butter(6, BAND_HZ, "bandpass", fs=rate_hz, output="sos")
    kept = responses[:, : round(LENGTH_S * rate_hz)]
    return np.asarray(signal.sosfiltfilt(sections, kept, axis=1))


def kurtosis(band: F64, rate_hz: int) -> list[float]:
    """Of the samples over their local root mean square, in each window."""
    local = np.sqrt(np.maximum(_local_mean(band**2, LOCAL_SAMPLES), 1e-30))
    parts = [(band / local)[:, _samples(window, rate_hz)] for window in WINDOWS_MS]
    return [float(np.mean(part**4) / np.mean(part**2) ** 2) for part in parts]


def spread_db(band: F64, rate_hz: int) -> list[float]:
    """Root mean square of the envelope's level about its local mean, in each window."""
    envelope = np.abs(signal.hilbert(band, axis=1))[:, ::ENVELOPE_STEP]
    level_db = 20 * np.log10(envelope + 1e-12)
    about = level_db - _local_mean(level_db, ENVELOPE_LOCAL)
    rate = rate_hz / ENVELOPE_STEP
    return [float(np.sqrt(np.mean(about[:, _samples(w, rate)] ** 2))) for w in WINDOWS_MS]


def reverberation_s(band: F64, rate_hz: int) -> float:
    """Median T60 by the slope of Schroeder's integral from -5 to -20 dB, or as far as it goes.

    What would follow the cut is added as an exponential tail (ISO 3382-1:2009, 5.3.3).
    """
    each = np.array([_reverberation_s(row, rate_hz) for row in band])
    told = each[np.isfinite(each)]
    return float(np.median(told)) if len(told) else float("nan")


def _reverberation_s(response: F64, rate_hz: int) -> float:
    energy = response[round(DECAY_FROM_S * rate_hz) :] ** 2
    block = round(BLOCK_S * rate_hz)
    blocks = energy[: len(energy) // block * block].reshape(-1, block).mean(axis=1)
    late = blocks[len(blocks) // 3 :]
    at = np.arange(len(late)) * block
    slope, _ = np.polyfit(at, np.log(late + 1e-30), 1)
    tail = np.exp(np.log(late + 1e-30).mean() + slope * (at[-1] + block / 2 - at.mean()))
    tail *= BLOCK_MEDIAN / max(-slope, 1e-6)
    level_db = 10 * np.log10(np.cumsum(energy[::-1])[::-1] + tail)
    level_db -= level_db[0]
    fitted = np.flatnonzero((level_db < -5.0) & (level_db > -20.0))
    if len(fitted) < 2:
        return float("nan")
    return -60.0 / float(np.polyfit(fitted / rate_hz, level_db[fitted], 1)[0])


def contrast(here: F64 | F32, moved: F64 | F32) -> float:
    """How much alike features (n, d) stay when each place is moved a little: 1 all, 0 nothing.

    Mean cosine of a place and the place moved, minus that of different places, over 1 minus it.
    """
    others = (here @ here.T)[~np.eye(len(here), dtype=bool)].mean()
    return float(((here * moved).sum(axis=1).mean() - others) / (1 - others))


def _samples(window_ms: tuple[int, int], rate_hz: float) -> slice:
    return slice(round(window_ms[0] * rate_hz / 1000), round(window_ms[1] * rate_hz / 1000))


def _local_mean(values: F64, size: int) -> F64:
    kernel = np.ones((1, size)) / size
    return np.asarray(signal.fftconvolve(values, kernel, mode="same", axes=1))


STUDY = Study(
    "Are simulated rooms like measured ones, by their responses?",
    measure_realism, minutes=3, data=("rirs",),
    fast={"worlds": ("studio",), "places": 12, "rooms": 3},
)  # fmt: skip
