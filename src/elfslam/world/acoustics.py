"""Echo synthesis: image sources and point scatterers, one band-limited pulse per path.

Each path adds a windowed-sinc pulse to the complex envelope of the room's response, sampled at
6.3 kHz about 17.5 kHz; the carrier phase is exact. One frame is 100 ms, so its spectrum has bins of
10 Hz, which are then multiplied by chirp and phone and turned into sound at the recording's rate.
Image method after Allen and Berkley (J. Acoust. Soc. Am. 65, 1979).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy import fft

from elfslam.base.arrays import F32, F64, Value, array
from elfslam.base.values import Chirp
from elfslam.world.air import SPEED_OF_SOUND_MPS, absorption_db_per_m
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, Device
from elfslam.world.room import Room

CARRIER_HZ = 17_500.0
BASEBAND_HZ = BAND_BINS * BIN_HZ
FRAME_S = 1.0 / BIN_HZ
LONGEST_PATH_M = 26.0
"""76 ms: what follows the chirp within one frame, and all that the echo trace can hold."""
MOST_IMAGES = 500
TAPS = 12
PHASES = 256
BODY_DISTANCE_M = 0.35
BODY_REFLECTION = 0.25
BODY_SHADOW = 0.85
"""Share of the sound that the holder's torso takes from paths that leave or arrive from behind."""

C64 = npt.NDArray[np.complex64]


@dataclass(frozen=True, eq=False)
class Images(Value):
    """Image sources of a room: position = sign * source + offset, with their reflection gain."""

    sign: F64 = array("k", 3)
    offset_m: F64 = array("k", 3)
    gain: F64 = array("k")


def image_sources(room: Room) -> Images:
    """The strongest images (direct sound excluded) within the longest path."""
    reach = np.ceil(LONGEST_PATH_M / (2 * room.size_m)).astype(int)
    axes = [
        _axis_images(room.size_m[a], room.reflection[2 * a : 2 * a + 2], reach[a]) for a in range(3)
    ]
    count = [len(axis[0]) for axis in axes]
    index = np.stack(np.meshgrid(*[np.arange(c) for c in count], indexing="ij"), axis=-1).reshape(
        -1, 3
    )
    sign = np.column_stack([axes[a][0][index[:, a]] for a in range(3)])
    offset = np.column_stack([axes[a][1][index[:, a]] for a in range(3)])
    gain = np.prod([axes[a][2][index[:, a]] for a in range(3)], axis=0)
    from_centre = np.abs((sign - 1) * room.size_m / 2 + offset)
    distance = np.linalg.norm(from_centre, axis=1)
    strength = gain / np.maximum(distance, 1.0) * 10 ** (-_air_db_per_m() * distance / 20)
    strength[_nearest_m(from_centre, sign, room.size_m) > LONGEST_PATH_M] = 0.0
    strength[(sign > 0).all(axis=1) & (offset == 0).all(axis=1)] = 0.0
    keep = np.argsort(-strength)[:MOST_IMAGES]
    keep = np.sort(keep[strength[keep] > 0])
    return Images(sign[keep], offset[keep], gain[keep])


def _nearest_m(from_centre_m: F64, sign: F64, size_m: F64) -> F64:
    """Least path length of each image (k) as the phone moves through the room.

    Along an axis that it mirrors, an image comes nearer by the phone's way twice.
    """
    nearer = np.where(sign < 0, size_m, 0.0)
    return np.asarray(np.linalg.norm(np.maximum(from_centre_m - nearer, 0.0), axis=1))


def _axis_images(length_m: float, reflection: F64, reach: int) -> tuple[F64, F64, F64]:
    """Sign, offset and gain of the images along one axis (Allen and Berkley, equation 9)."""
    n = np.repeat(np.arange(-reach, reach + 1), 2)
    odd = np.tile([0, 1], 2 * reach + 1)
    gain = reflection[0] ** np.abs(n - odd) * reflection[1] ** np.abs(n)
    return 1.0 - 2.0 * odd, np.asarray(2.0 * n * length_m, dtype=np.float64), gain


def _air_db_per_m() -> float:
    return absorption_db_per_m(CARRIER_HZ)


def _pulse_table() -> F32:
    """Windowed-sinc pulses (PHASES + 1, TAPS) for a delay of phase / PHASES of a sample."""
    delay = np.arange(PHASES + 1)[:, None] / PHASES
    x = np.arange(TAPS)[None, :] - (TAPS // 2 - 1) - delay
    window = np.i0(6.0 * np.sqrt(np.maximum(1 - (x / (TAPS / 2)) ** 2, 0.0))) / np.i0(6.0)
    return (np.sinc(x) * window).astype(np.float32)


@numba.njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _lobe(cosine: float, directivity: float) -> float:
    return (1.0 - directivity) + directivity * cosine


@numba.njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _shadow(forward: float, depth: float) -> float:
    """Gain of a direction by its forward component: 1 ahead, 1 - depth straight behind."""
    behind = min(max((-forward - 0.5) / 0.3, 0.0), 1.0)
    return 1.0 - depth * behind * behind * (3.0 - 2.0 * behind)


@numba.njit(cache=True, fastmath=True)
def _add_pulse(out, row, delay_s, gain, table):  # type: ignore[no-untyped-def]
    position = delay_s * BASEBAND_HZ
    whole = int(position)
    first = whole - (TAPS // 2 - 1)
    turns = CARRIER_HZ * delay_s
    angle = -2.0 * np.pi * (turns - np.floor(turns))
    real, imag = gain * np.cos(angle), gain * np.sin(angle)
    pulse = table[int((position - whole) * PHASES + 0.5)]
    for tap in range(TAPS):
        index = first + tap
        if 0 <= index < BAND_BINS:
            out[row, index] += complex(real * pulse[tap], imag * pulse[tap])


@numba.njit(cache=True, fastmath=True)
def _path_gain(departure, arrival, length, forward, lobes, air_db):  # type: ignore[no-untyped-def]
    """Directivity, body shadow and air along one path; directions are unit, from the phone."""
    out = departure[0] * forward[0] + departure[1] * forward[1] + departure[2] * forward[2]
    back = arrival[0] * forward[0] + arrival[1] * forward[1] + arrival[2] * forward[2]
    level = departure[0] * forward[0] + departure[1] * forward[1]
    level_back = arrival[0] * forward[0] + arrival[1] * forward[1]
    gain = _lobe(out, lobes[0]) * _lobe(back, lobes[1])
    gain *= _shadow(level, lobes[2]) * _shadow(level_back, lobes[2])
    return gain * 10.0 ** (-air_db * length / 20.0)


@numba.njit(cache=True, fastmath=True, nogil=True)
def _responses(  # type: ignore[no-untyped-def]
    speaker,
    microphone,
    forward,
    sign,
    offset,
    image_gain,
    points,
    radius,
    lobes,
    air_db,
    table,
    out,
):
    """Complex envelopes of the room's echoes, without the direct sound, added to `out` (n, 630)."""
    departure, arrival = np.empty(3), np.empty(3)
    for row in range(speaker.shape[0]):
        for k in range(sign.shape[0]):
            square = 0.0
            for a in range(3):
                arrival[a] = sign[k, a] * speaker[row, a] + offset[k, a] - microphone[row, a]
                square += arrival[a] * arrival[a]
            length = np.sqrt(square)
            if length > LONGEST_PATH_M:
                continue
            for a in range(3):
                arrival[a] /= length
                departure[a] = -sign[k, a] * arrival[a]
            gain = _path_gain(departure, arrival, length, forward[row], lobes, air_db)
            _add_pulse(out, row, length / SPEED_OF_SOUND_MPS, gain * image_gain[k] / length, table)
        for k in range(points.shape[0]):
            there, home = 0.0, 0.0
            for a in range(3):
                departure[a] = points[k, a] - speaker[row, a]
                arrival[a] = points[k, a] - microphone[row, a]
                there += departure[a] * departure[a]
                home += arrival[a] * arrival[a]
            there, home = np.sqrt(there) + 1e-3, np.sqrt(home) + 1e-3
            if there + home > LONGEST_PATH_M:
                continue
            for a in range(3):
                departure[a] /= there
                arrival[a] /= home
            gain = _path_gain(departure, arrival, there + home, forward[row], lobes, air_db)
            spread = 0.5 * radius[k] / (max(there, 0.3) * max(home, 0.3))
            _add_pulse(out, row, (there + home) / SPEED_OF_SOUND_MPS, gain * spread, table)


@numba.njit(cache=True, fastmath=True, nogil=True)
def _near_field(out, direct_delay_s, direct_gain, body_delay_s, body_gain, table):  # type: ignore[no-untyped-def]
    for row in range(out.shape[0]):
        _add_pulse(out, row, direct_delay_s, direct_gain, table)
        _add_pulse(out, row, body_delay_s[row], body_gain, table)


def phone_geometry(
    position_m: F64, yaw_rad: F64, pitch_rad: F64, separation_m: float
) -> tuple[F64, F64, F64]:
    """Speaker, microphone and forward direction (n, 3) of phones at `position_m` (n, 3)."""
    cos = np.cos(pitch_rad)
    forward = np.column_stack([cos * np.cos(yaw_rad), cos * np.sin(yaw_rad), np.sin(pitch_rad)])
    half = 0.5 * separation_m * forward
    return position_m + half, position_m - half, forward


def room_responses(
    room: Room, images: Images, device: Device, position_m: F64, yaw_rad: F64, pitch_rad: F64,
    body_distance_m: F64,
) -> C64:  # fmt: skip
    """Complex envelopes (n, 630) of what each phone hears of an impulse, direct path included."""
    speaker, microphone, forward = phone_geometry(
        position_m, yaw_rad, pitch_rad, device.separation_m
    )
    out = np.zeros((len(position_m), BAND_BINS), dtype=np.complex64)
    lobes = np.array([device.speaker_directivity, device.microphone_directivity, BODY_SHADOW])
    table = _pulse_table()
    _responses(
        speaker, microphone, forward, images.sign, images.offset_m, images.gain, room.scatterers_m,
        room.scatterer_radius_m, lobes, _air_db_per_m(), table, out,
    )  # fmt: skip
    body_path_m = 2 * body_distance_m
    _near_field(
        out, device.separation_m / SPEED_OF_SOUND_MPS, device.direct_gain / device.separation_m,
        body_path_m / SPEED_OF_SOUND_MPS, BODY_REFLECTION / (2 * BODY_DISTANCE_M), table,
    )  # fmt: skip
    return out


def render_frames(responses: C64, chirp: Chirp, device: Device) -> F32:
    """Sound (n, frame) of one chirp period per row, without noise, at the chirp's rate.

    The chirp starts at sample 0 and the direct sound arrives `separation` later.
    """
    size = round(FRAME_S * chirp.rate_hz)
    chirp_spectrum = np.fft.rfft(chirp.samples.astype(np.float64), size)
    first = round(BAND_LOW_HZ / BIN_HZ)
    band = (device.level * device.response * chirp_spectrum[first : first + BAND_BINS]).astype(
        np.complex64
    )
    spectrum = np.zeros((len(responses), size // 2 + 1), dtype=np.complex64)
    envelope = fft.fftshift(fft.fft(responses, axis=1), axes=1)
    np.multiply(envelope, band, out=spectrum[:, first : first + BAND_BINS])
    return np.asarray(fft.irfft(spectrum, size, axis=1), dtype=np.float32)
