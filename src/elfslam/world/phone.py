"""Phones in a scene: where their transducers are, what they hear, and its sound."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import fft

from elfslam.base.arrays import F32, F64, Value, array
from elfslam.base.errors import ParameterError
from elfslam.base.values import Chirp
from elfslam.world.acoustics import add_echoes
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, Device, band_hz
from elfslam.world.kernels import kernel
from elfslam.world.paths import MOST_REFLECTIONS, Reach, make_plan_paths
from elfslam.world.pulses import (
    C64,
    CARRIER_HZ,
    SPEED_OF_SOUND_MPS,
    Air,
    absorption_db_per_m,
    add_pulses,
    make_rays,
    pulse_table,
    speed_of_sound_mps,
)
from elfslam.world.scene import Scene
from elfslam.world.transducers import Lobes, near_field, ringing

FRAME_S = 1.0 / BIN_HZ
BODY_REFLECTION = 0.25
BODY_DISTANCE_M = 0.35
NEPER_DB = 20.0 / np.log(10.0)
TILT_HZ = 2_500.0
"""To either side of the carrier, where the attenuation of air is compared."""


@dataclass(frozen=True, eq=False)
class Poses(Value):
    """Where phones are at the start of a chirp: centre, axes, velocity, and who is about.

    The columns of `world_from_phone` are the phone's right, forward (up the screen) and out of the
    screen; its holder stands behind, at `body_distance_m`. `people_m` are others in plan.
    """

    position_m: F64 = array("n", 3)
    world_from_phone: F64 = array("n", 3, 3)
    velocity_mps: F64 = array("n", 3)
    body_distance_m: F64 = array("n")
    people_m: F64 = array("n", "p", 2)


class Transducers(NamedTuple):
    """Both ends of the sound for many phones, in the room: positions, axes, motion and lobes.

    What lies `across` is the axis of a transducer's lobes, as long as half their spacing is in
    wavelengths of the carrier; without, there are none.
    """

    speaker: F64
    microphone: F64
    speaker_axis: F64
    microphone_axis: F64
    ahead: F64
    speaker_velocity: F64
    microphone_velocity: F64
    speaker_directivity: float
    microphone_directivity: float
    held: bool
    speaker_across: F64 | None = None
    microphone_across: F64 | None = None
    speaker_lobe_share: float = 0.0
    microphone_lobe_share: float = 0.0


COLUMNS = (*Transducers._fields[:7], "speaker_across", "microphone_across")
"""Those of its fields that have a row for every phone."""

Engine = Callable[[Scene, Transducers, F64, Air, Reach], C64]
"""Scene, both ends (n), people (n, p, 2), air and reach in; complex envelopes (n, 630) out: what is
heard of an impulse without the direct sound and the holder. Two exist: `image_echoes` here and
`pyroom.image_echoes`."""


def poses_at(position_m: F64, yaw_rad: F64, pitch_rad: F64, roll_rad: F64 | float = 0.0) -> Poses:
    """Still phones held by alone-standing people, by yaw, pitch (up) and roll (n)."""
    count = len(position_m)
    return Poses(
        position_m, phone_axes(yaw_rad, pitch_rad, np.broadcast_to(roll_rad, count)),
        np.zeros((count, 3)), np.full(count, BODY_DISTANCE_M), np.zeros((count, 0, 2)),
    )  # fmt: skip


def phone_axes(yaw_rad: F64, pitch_rad: F64, roll_rad: F64) -> F64:
    """Axes (n, 3, 3) of phones whose top points by yaw and pitch, rolled about it."""
    zero = np.zeros_like(yaw_rad)
    cos_yaw, sin_yaw = np.cos(yaw_rad), np.sin(yaw_rad)
    cos_pitch, sin_pitch = np.cos(pitch_rad), np.sin(pitch_rad)
    forward = np.stack([cos_pitch * cos_yaw, cos_pitch * sin_yaw, sin_pitch], axis=1)
    right = np.stack([sin_yaw, -cos_yaw, zero], axis=1)
    out = np.cross(right, forward)
    cos, sin = np.cos(roll_rad)[:, None], np.sin(roll_rad)[:, None]
    return np.stack([cos * right - sin * out, forward, sin * right + cos * out], axis=2)


def ends_of(device: Device, poses: Poses) -> Transducers:
    """Speaker and microphone of held phones in the room."""

    def placed(local: F64) -> F64:
        return np.ascontiguousarray(poses.world_from_phone @ local)

    def across(lobes: Lobes) -> F64:
        waves = 0.5 * lobes.spacing_m * CARRIER_HZ / SPEED_OF_SOUND_MPS
        return placed(waves * lobes.axis)

    return Transducers(
        poses.position_m + placed(device.speaker_m),
        poses.position_m + placed(device.microphone_m),
        placed(device.speaker_axis),
        placed(device.microphone_axis),
        np.ascontiguousarray(poses.world_from_phone[:, :2, 1]),
        poses.velocity_mps,
        poses.velocity_mps,
        device.speaker_directivity,
        device.microphone_directivity,
        True,
        across(device.speaker_lobes),
        across(device.microphone_lobes),
        device.speaker_lobes.share,
        device.microphone_lobes.share,
    )


def air_at(temperature_c: float = 20.0, humidity_percent: float = 50.0) -> Air:
    """Air at normal pressure."""
    low_db, db, high_db = (
        absorption_db_per_m(CARRIER_HZ + k * TILT_HZ, temperature_c, humidity_percent)
        for k in (-1, 0, 1)
    )
    tilt = (high_db - low_db) / (2 * TILT_HZ * NEPER_DB)
    return Air(speed_of_sound_mps(temperature_c), db / NEPER_DB, tilt)


@kernel
def one_phone(ends, row):
    """Both ends of one of many phones."""
    return Transducers(
        ends.speaker[row], ends.microphone[row], ends.speaker_axis[row],
        ends.microphone_axis[row], ends.ahead[row], ends.speaker_velocity[row],
        ends.microphone_velocity[row],
        ends.speaker_directivity, ends.microphone_directivity, ends.held,
        ends.speaker_across[row], ends.microphone_across[row],
        ends.speaker_lobe_share, ends.microphone_lobe_share,
    )  # fmt: skip


@kernel
def _render_rows(out, falling, scene, ends, people, paths, rays, reach, air, table):
    for row in range(out.shape[0]):
        phone, about = one_phone(ends, row), people[row]
        if not add_echoes(
            out[row], falling[row], scene, phone, about, paths, rays, reach, air, table
        ):
            return row
    return -1


def plain_rows(ends: Transducers, rows: slice) -> Transducers:
    """Some rows as arrays of one kind: a kernel is compiled anew for every other kind."""
    none = np.zeros_like(ends.speaker)
    given = {name: getattr(ends, name) for name in COLUMNS}
    columns = {
        name: np.array((none if column is None else column)[rows], dtype=np.float64)
        for name, column in given.items()
    }
    return Transducers(
        **columns,
        speaker_directivity=float(ends.speaker_directivity),
        microphone_directivity=float(ends.microphone_directivity),
        held=bool(ends.held),
        speaker_lobe_share=float(ends.speaker_lobe_share),
        microphone_lobe_share=float(ends.microphone_lobe_share),
    )


def image_echoes(
    scene: Scene, ends: Transducers, people_m: F64, air: Air, reach: Reach, threads: int = 1,
    falling: C64 | None = None,
) -> C64:  # fmt: skip
    """Our engine: envelopes (n, 630) of the echoes, the same for any number of threads.

    All frequencies are reflected as 17.5 kHz. `falling` (n, 630) is overwritten by what surfaces
    take of the sides of the band: each path times the power of the frequency with which it falls.
    Raises ParameterError where a reach asks for more paths than there is room for.
    """
    if not reach.plan_order <= MOST_REFLECTIONS or reach.longest_m <= 0:
        raise ParameterError(
            f"reach: wanted at most {MOST_REFLECTIONS} reflections in plan and a positive length, "
            f"got {reach.plan_order} and {reach.longest_m}; change them"
        )
    count, limits = len(ends.speaker), Reach(float(reach.longest_m), *map(int, reach[1:]))
    out, table = np.zeros((count, BAND_BINS), dtype=np.complex64), pulse_table()
    fall = np.zeros((count, 0), dtype=np.complex64) if falling is None else falling

    def render(rows: slice) -> int:
        part, about = plain_rows(ends, rows), np.array(people_m[rows], dtype=np.float64)
        paths, rays = make_plan_paths(len(scene.block_low)), make_rays()
        return int(
            _render_rows(out[rows], fall[rows], scene, part, about, paths, rays, limits, air, table)
        )

    edges = np.linspace(0, count, max(min(threads, count), 1) + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges)]
    if len(parts) == 1:
        bad = [render(parts[0])]
    else:
        with ThreadPoolExecutor(len(parts)) as pool:
            bad = list(pool.map(render, parts))
    if max(bad) >= 0:
        raise ParameterError("reach: more paths than fit; lower its order or its longest path")
    return out


def room_responses(
    scene: Scene,
    device: Device,
    poses: Poses,
    air: Air | None = None,
    reach: Reach = Reach(),  # noqa: B008
    engine: Engine = image_echoes,
) -> C64:
    """Complex envelopes (n, 630) of what each phone hears of an impulse, direct sound included."""
    air = air or air_at()
    out = engine(scene, ends_of(device, poses), poses.people_m, air, reach)
    if device.near_field is not None:
        gain = fft.ifftshift(near_field(device.near_field, band_hz())).astype(np.complex64)
        out = fft.ifft(fft.fft(out, axis=1) * gain, axis=1)
    direct = np.ones(len(out)) * device.separation_m
    add_pulses(out, direct / air.speed_mps, device.direct_gain / direct)
    body_gain = np.full(len(out), BODY_REFLECTION / (2 * BODY_DISTANCE_M))
    add_pulses(out, 2 * poses.body_distance_m / air.speed_mps, body_gain)
    return out


def render_frames(responses: C64, chirp: Chirp, device: Device, jitter_s: F64 | None = None) -> F32:
    """Sound (n, frame) of one chirp period per row, without noise, at the chirp's rate.

    The chirp starts at sample 0, or `jitter_s` (n) later, and the direct sound arrives
    `separation` after it.
    """
    size = round(FRAME_S * chirp.rate_hz)
    first = round(BAND_LOW_HZ / BIN_HZ)
    chirp_spectrum = np.fft.rfft(chirp.samples.astype(np.float64), size)
    band = device.level * device.response * chirp_spectrum[first : first + BAND_BINS]
    if device.ringing:
        band *= ringing(device.ringing, band_hz())
    spectrum = np.zeros((len(responses), size // 2 + 1), dtype=np.complex64)
    envelope = fft.fftshift(fft.fft(responses, axis=1), axes=1)
    if jitter_s is not None and jitter_s.any():
        turns = np.multiply.outer(jitter_s, band_hz())
        envelope = envelope * np.exp(-2j * np.pi * turns).astype(np.complex64)
    np.multiply(envelope, band.astype(np.complex64), out=spectrum[:, first : first + BAND_BINS])
    return np.asarray(fft.irfft(spectrum, size, axis=1), dtype=np.float32)
