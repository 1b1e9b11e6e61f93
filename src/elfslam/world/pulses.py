"""Band-limited pulses: paths of sound written into a complex envelope (kernels).

The envelope is sampled at 6.3 kHz about 17.5 kHz; a path adds a windowed sinc at its delay, and the
carrier's phase is exact. While the phone moves, a path of changing length stretches the chirp. A
logarithmic sweep of rate k = ln(f1 / f0) / T turns a stretch of 1 + e into a delay: its phase at
the carrier is that of the moment when the carrier is played, its envelope comes e / k later still.

Paths are first noted in columns and then worked out together, which processors do fastest.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS, BIN_HZ
from elfslam.world.kernels import kernel

SPEED_OF_SOUND_MPS = 343.0
"""At 20 degrees Celsius, rounded as is usual; `speed_of_sound_mps` gives 343.2 there."""


def speed_of_sound_mps(temperature_c: float) -> float:
    """Speed of sound in air of this temperature (ISO 9613-1:1993, annex A)."""
    return 343.2 * math.sqrt((temperature_c + 273.15) / 293.15)


def absorption_db_per_m(
    frequency_hz: float, temperature_c: float = 20.0, humidity_percent: float = 50.0
) -> float:
    """Attenuation of a pure tone in air at normal pressure (ISO 9613-1:1993, equations 3 to 5)."""
    kelvin = temperature_c + 273.15
    relative = kelvin / 293.15
    saturation = 10 ** (-6.8346 * (273.16 / kelvin) ** 1.261 + 4.6151)
    vapour_percent = humidity_percent * saturation
    oxygen_hz = 24 + 4.04e4 * vapour_percent * (0.02 + vapour_percent) / (0.391 + vapour_percent)
    nitrogen_hz = relative**-0.5 * (
        9 + 280 * vapour_percent * math.exp(-4.170 * (relative ** (-1 / 3) - 1))
    )
    oxygen = 0.01275 * math.exp(-2239.1 / kelvin) / (oxygen_hz + frequency_hz**2 / oxygen_hz)
    nitrogen = 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen_hz + frequency_hz**2 / nitrogen_hz)
    classical = 1.84e-11 * relative**0.5
    return float(8.686 * frequency_hz**2 * (classical + relative**-2.5 * (oxygen + nitrogen)))


CARRIER_HZ = 17_500.0
BASEBAND_HZ = BAND_BINS * BIN_HZ
TAPS = 12
PAD = TAPS
"""Room before and after an envelope, so that no pulse has to be cut."""
PHASES = 256
SWEEP_RATE_HZ = float(np.log(20_000 / 15_000) / 0.010)
"""Relative change of frequency per second within the chirp of the paper."""
CARRIER_AT_S = float(np.log(CARRIER_HZ / 15_000) / SWEEP_RATE_HZ)
"""When, after its start, the chirp passes the carrier."""
BODY_SHADOW = 0.85
"""Share of the sound that the holder's torso takes from paths that leave or arrive from behind."""
MOST_RAYS = 32_768

C64 = npt.NDArray[np.complex64]
I32 = npt.NDArray[np.int32]


class Air(NamedTuple):
    """Speed of sound, attenuation at the carrier (nepers per metre), and how that grows with the
    frequency (nepers per metre and hertz), which only the diffuse engine heeds."""

    speed_mps: float
    attenuation_per_m: float
    tilt_per_m_hz: float = 0.0


class Rays(NamedTuple):
    """Paths of one phone, a column each: length, gain, the power of the frequency with which that
    falls, and unit vectors along both ends.

    `filled[0]` says how many there are. The next four columns are their pulses: the first tap,
    which of the table's phases, and the two parts of the gain. `padded` is an envelope of parts.
    """

    filled: I32
    length: F64
    gain: F64
    fall: F64
    departure: F64
    arrival: F64
    first: I32
    phase: I32
    real: F64
    imag: F64
    padded: F64


def make_rays() -> Rays:
    """Room for the rays of one phone."""
    real = [np.zeros(MOST_RAYS) for _ in range(5)]
    whole = [np.zeros(MOST_RAYS, dtype=np.int32) for _ in range(2)]
    return Rays(
        filled=np.zeros(1, dtype=np.int32),
        length=real[0],
        gain=real[1],
        fall=real[4],
        departure=np.zeros((3, MOST_RAYS)),
        arrival=np.zeros((3, MOST_RAYS)),
        first=whole[0],
        phase=whole[1],
        real=real[2],
        imag=real[3],
        padded=np.zeros((2, BAND_BINS + 2 * PAD)),
    )


@cache
def pulse_table() -> F64:
    """Windowed-sinc pulses (PHASES + 1, TAPS) for a delay of phase / PHASES of a sample."""
    delay = np.arange(PHASES + 1)[:, None] / PHASES
    x = np.arange(TAPS)[None, :] - (TAPS // 2 - 1) - delay
    window = np.i0(6.0 * np.sqrt(np.maximum(1 - (x / (TAPS / 2)) ** 2, 0.0))) / np.i0(6.0)
    table: F64 = np.sinc(x) * window
    table.flags.writeable = False
    return table


@kernel
def note_ray(rays, length, gain, fall, dx, dy, dz, ax, ay, az):
    """Notes a path that departs along d and arrives from a, both unit vectors from the phone."""
    k = rays.filled[0]
    if k == MOST_RAYS:
        return
    rays.length[k], rays.gain[k], rays.fall[k] = length, gain, fall
    rays.departure[0, k], rays.departure[1, k], rays.departure[2, k] = dx, dy, dz
    rays.arrival[0, k], rays.arrival[1, k], rays.arrival[2, k] = ax, ay, az
    rays.filled[0] = k + 1


@kernel
def shadow_of(forward):
    """Gain of a direction by its forward component: 1 ahead, 1 - BODY_SHADOW straight behind."""
    behind = min(max((-forward - 0.5) / 0.3, 0.0), 1.0)
    return 1.0 - BODY_SHADOW * behind * behind * (3.0 - 2.0 * behind)


@kernel
def lobed(share, across_x, across_y, across_z, x, y, z):
    """Gain of a direction by a transducer's lobes: 1 - share + share cos(2 pi across . direction).

    The sine of half the angle is its series, to 1e-7.
    """
    turns = across_x * x + across_y * y + across_z * z
    half = np.pi * (turns - np.floor(turns + 0.5))
    s = half * half
    sin = half * (1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)))))
    return 1.0 - 2.0 * share * sin * sin


@kernel
def _lobe(rays, phone):
    """Lobes of both transducers on all rays; a loop of its own, which those without do not pay."""
    u, v = phone.speaker_across, phone.microphone_across
    u0, u1, u2, v0, v1, v2 = u[0], u[1], u[2], v[0], v[1], v[2]
    out, back = phone.speaker_lobe_share, phone.microphone_lobe_share
    for k in range(rays.filled[0]):
        dx, dy, dz = rays.departure[0, k], rays.departure[1, k], rays.departure[2, k]
        ax, ay, az = rays.arrival[0, k], rays.arrival[1, k], rays.arrival[2, k]
        gain = lobed(out, u0, u1, u2, dx, dy, dz) * lobed(back, v0, v1, v2, ax, ay, az)
        rays.gain[k] *= gain


@kernel
def _attenuated(x):
    """exp(-x) for x from 0 to 8, to 1e-9: the series of exp(-x / 32), squared five times."""
    y = -x / 32.0
    y = 1 + y * (1 + y / 2 * (1 + y / 3 * (1 + y / 4 * (1 + y / 5 * (1 + y / 6)))))
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    return y * y


@kernel
def _work_out(rays, phone, air):
    """Directivity, shadow, air and Doppler of all rays: their pulses.

    A path's length changes by the motion of both ends while the chirp is played, and by the
    microphone's alone while the sound is on its way. What is played at t arrives at `length` /
    `passing` + (1 - `shorter`) t; by stationary phase this shifts a logarithmic sweep's carrier
    and its envelope apart (up to the third power of `shorter`).
    """
    s, m = phone.speaker_axis, phone.microphone_axis
    s0, s1, s2, m0, m1, m2 = s[0], s[1], s[2], m[0], m[1], m[2]
    u, v = phone.speaker_velocity, phone.microphone_velocity
    u0, u1, u2, v0, v1, v2 = u[0], u[1], u[2], v[0], v[1], v[2]
    ahead_x, ahead_y = phone.ahead[0], phone.ahead[1]
    out, back = phone.speaker_directivity, phone.microphone_directivity
    held = 1.0 if phone.held else 0.0
    for k in range(rays.filled[0]):
        length = rays.length[k]
        dx, dy, dz = rays.departure[0, k], rays.departure[1, k], rays.departure[2, k]
        ax, ay, az = rays.arrival[0, k], rays.arrival[1, k], rays.arrival[2, k]
        gain = rays.gain[k] * _attenuated(air.attenuation_per_m * length)
        gain *= 1.0 - out + out * (s0 * dx + s1 * dy + s2 * dz)
        gain *= 1.0 - back + back * (m0 * ax + m1 * ay + m2 * az)
        shadow = shadow_of(dx * ahead_x + dy * ahead_y) * shadow_of(ax * ahead_x + ay * ahead_y)
        gain *= 1.0 - held + held * shadow
        here = v0 * ax + v1 * ay + v2 * az
        closing = here + u0 * dx + u1 * dy + u2 * dz
        passing = air.speed_mps + here
        shorter = closing / passing
        delay_s = length / passing - shorter * CARRIER_AT_S
        delay_s += shorter * shorter * (0.5 + shorter / 6.0) / SWEEP_RATE_HZ
        position = (delay_s - shorter / SWEEP_RATE_HZ) * BASEBAND_HZ
        whole = np.floor(position)
        turns = CARRIER_HZ * delay_s
        turns -= np.floor(turns)
        quarter = np.floor(4.0 * turns + 0.5)
        x = 2.0 * np.pi * (turns - 0.25 * quarter)
        y = x * x
        sin = x * (1 - y / 6 * (1 - y / 20 * (1 - y / 42 * (1 - y / 72 * (1 - y / 110)))))
        cos = 1 - y / 2 * (1 - y / 12 * (1 - y / 30 * (1 - y / 56 * (1 - y / 90))))
        odd = quarter - 2.0 * np.floor(0.5 * quarter)
        swap = odd > 0.5
        cos_sign = 1.0 - 2.0 * (1.0 if 0.5 < quarter < 2.5 else 0.0)
        sin_sign = 1.0 - 2.0 * (1.0 if 1.5 < quarter < 3.5 else 0.0)
        rays.real[k] = gain * cos_sign * (sin if swap else cos)
        rays.imag[k] = -gain * sin_sign * (cos if swap else sin)
        rays.first[k] = np.int32(whole) + (PAD - TAPS // 2 + 1)
        rays.phase[k] = np.int32((position - whole) * PHASES + 0.5)


@kernel
def write_rays(out, falling, rays, phone, air, table):
    """Writes the pulses of all rays into the envelope `out` (630).

    Times their falls they are written into `falling`, if that has any length.
    """
    if phone.speaker_lobe_share > 0.0 or phone.microphone_lobe_share > 0.0:
        _lobe(rays, phone)
    _work_out(rays, phone, air)
    _write(out, rays, table)
    if falling.shape[0] > 0:
        for k in range(rays.filled[0]):
            rays.real[k] *= rays.fall[k]
            rays.imag[k] *= rays.fall[k]
        _write(falling, rays, table)


@kernel
def _write(out, rays, table):
    padded = rays.padded
    for k in range(padded.shape[1]):
        padded[0, k] = padded[1, k] = 0.0
    for k in range(rays.filled[0]):
        first, phase, real, imag = rays.first[k], rays.phase[k], rays.real[k], rays.imag[k]
        if first < 0 or first > BAND_BINS + PAD:
            continue
        for tap in range(TAPS):
            pulse = table[phase, tap]
            padded[0, first + tap] += real * pulse
            padded[1, first + tap] += imag * pulse
    for k in range(BAND_BINS):
        out[k] = complex(padded[0, PAD + k], padded[1, PAD + k])


def add_pulses(envelopes: C64, delay_s: F64, gain: F64) -> None:
    """Adds one pulse of a plain delay to each of the envelopes (n, 630), well within them."""
    position = delay_s * BASEBAND_HZ
    whole = np.floor(position).astype(int)
    phase = ((position - whole) * PHASES + 0.5).astype(int)
    columns = whole[:, None] - (TAPS // 2 - 1) + np.arange(TAPS)
    turned = gain * np.exp(-2j * np.pi * CARRIER_HZ * delay_s)
    pulses = turned[:, None] * pulse_table()[phase] * (columns >= 0)
    rows = np.arange(len(envelopes))[:, None]
    envelopes[rows, np.maximum(columns, 0)] += pulses.astype(np.complex64)
