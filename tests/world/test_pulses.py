"""What a path does to its pulse: motion, lobes, the holder's shadow and air."""

from dataclasses import replace

import numpy as np
import pytest
from one_phone import AIR, DEAD, HARD, SIZE_M, UP, X, assert_one_path, dead_room, ends_at, heard

from elfslam.base.arrays import F64
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.device import built_in_device
from elfslam.world.phone import Transducers, render_frames
from elfslam.world.pulses import BODY_SHADOW, CARRIER_HZ, absorption_db_per_m
from elfslam.world.room import shoebox
from elfslam.world.scene import Scene, scene_of
from elfslam.world.transducers import Lobes


def scatterer(point_m: F64, radius_m: float, normal: F64 = -X) -> Scene:
    return scene_of(dead_room())._replace(
        point=np.array([point_m]), point_normal=normal[None], point_radius=np.array([radius_m])
    )


def chirp_heard(ends: Transducers, gain: float, wall_x_m: float) -> F64:
    """The chirp of a moving phone by the mirror at `wall_x_m`, in time, at 44.1 kHz (4410)."""
    rate_hz, fine = 44_100, 64
    chirp = make_chirp(ChirpParameters(), rate_hz).samples.astype(float)
    smooth = np.fft.irfft(np.fft.rfft(chirp, 4410), 4410 * fine) * fine
    played_s = np.arange(4410 * fine) / rate_hz / fine
    t_s = np.arange(4410) / rate_hz
    mirror = np.array([-1.0, 1.0, 1.0])
    sent_s = t_s.copy()
    for _ in range(30):
        speaker = ends.speaker[0] + sent_s[:, None] * ends.speaker_velocity[0]
        image = speaker * mirror + [2 * wall_x_m, 0.0, 0.0]
        microphone_m = ends.microphone[0] + t_s[:, None] * ends.microphone_velocity[0]
        length = np.linalg.norm(image - microphone_m, axis=1)
        sent_s = t_s - length / AIR.speed_mps
    level = gain / length * np.exp(-AIR.attenuation_per_m * length)
    return np.asarray(level * np.interp(sent_s, played_s, smooth, left=0.0))


@pytest.mark.parametrize("speed_mps", [-1.6, 0.0, 0.7, 1.6])
def test_a_moving_phone_hears_what_a_simulation_in_time_hears(speed_mps: float) -> None:
    """Delay and phase of the echo, at no lag; taken as still, the phone would be off by cycles.

    Not all of it: the stretch also spreads the band by 90 us at 3.2 m/s, which one pulse lacks.
    """
    surfaces = (DEAD, HARD, *(DEAD,) * 4)
    velocity = speed_mps * np.array([np.cos(0.3), np.sin(0.3), 0.0])
    ends = ends_at([2.0, 2.0, 1.2], [1.9, 2.1, 1.3], velocity_mps=velocity, held=True)
    response = heard(shoebox(SIZE_M, surfaces), ends)[None].astype(np.complex64)
    flat = replace(built_in_device("flat"), level=1.0)
    ours = render_frames(response, make_chirp(ChirpParameters(), 44_100), flat)[0].astype(float)
    brute = chirp_heard(ends, HARD.reflection, SIZE_M[0])
    correlation = ours @ brute / np.linalg.norm(ours) / np.linalg.norm(brute)
    assert correlation > 0.975
    assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(brute), rel=0.03)


LOBES = Lobes(0.35, 0.07, np.array([0.0, 0.8, 0.6]))


def lobed_ends(ends: Transducers, lobes: Lobes = LOBES) -> Transducers:
    """Both transducers have these lobes, along the room's axes; the microphone half the share."""
    across = 0.5 * lobes.spacing_m * CARRIER_HZ / 343.0 * lobes.axis[None]
    shares = {"speaker_lobe_share": lobes.share, "microphone_lobe_share": lobes.share / 2}
    return ends._replace(speaker_across=across, microphone_across=across, **shares)


def gain_towards(direction: F64, share: float) -> float:
    """Of a source of 1 - share and two of half the share, `spacing_m` apart, summed far away."""
    waves = LOBES.spacing_m / 2 * CARRIER_HZ / 343.0 * (LOBES.axis @ direction)
    pair = np.exp(2j * np.pi * waves * np.array([-1, 1])).sum() * share / 2
    return float(abs(1 - share + pair))


@pytest.mark.parametrize("turned_rad", [0.0, 0.2, 0.45, 0.9, 1.5])
def test_lobes_are_those_of_three_sources(turned_rad: float) -> None:
    direction = np.array([np.cos(turned_rad), np.sin(turned_rad) * 0.6, np.sin(turned_rad) * 0.8])
    place_m = np.array([2.0, 2.0, 1.0])
    ends = lobed_ends(ends_at(place_m, place_m + 1.5 * direction))
    law = gain_towards(direction, 0.35) * gain_towards(-direction, 0.175)
    assert_one_path(heard(dead_room(), ends), 1.5, law)


def test_lobed_ends_may_change_places() -> None:
    """Reciprocity: speaker and microphone with all that is theirs."""
    room, forth = shoebox(SIZE_M, (HARD,) * 6), lobed_ends(ends_at())
    back = forth._replace(
        speaker=forth.microphone, microphone=forth.speaker,
        speaker_lobe_share=forth.microphone_lobe_share,
        microphone_lobe_share=forth.speaker_lobe_share,
    )  # fmt: skip
    there, again = heard(room, forth), heard(room, back)
    assert np.abs(there - again).max() < 1e-6 * np.abs(there).max()


def test_the_holder_shadows_what_is_behind() -> None:
    """The phone looks along x; a scatterer straight behind is dimmed on both ways."""
    place_m = np.array([3.5, 2.5, 1.5])
    ends = ends_at(place_m, place_m + 1e-6 * UP, held=True, ahead=(1.0, 0.0))
    ahead = heard(scatterer(place_m + 2 * X, 0.1), ends)
    behind = heard(scatterer(place_m - 2 * X, 0.1, normal=X), ends)
    ratio = np.linalg.norm(behind) / np.linalg.norm(ahead)
    assert ratio == pytest.approx((1 - BODY_SHADOW) ** 2, rel=1e-4)


OCTAVES_HZ = [1000.0 * 10 ** (0.3 * k) for k in range(-4, 4)]
"""Exact midband frequencies of the octaves named 63 Hz to 8 kHz."""

# ISO 9613-2:1996, table 2: (degrees Celsius, percent) and dB/km per octave.
TABLE = {
    (10, 70): [0.1, 0.4, 1.0, 1.9, 3.7, 9.7, 32.8, 117],
    (20, 70): [0.1, 0.3, 1.1, 2.8, 5.0, 9.0, 22.9, 76.6],
    (30, 70): [0.1, 0.3, 1.0, 3.1, 7.4, 12.7, 23.1, 59.3],
    (15, 20): [0.3, 0.6, 1.2, 2.7, 8.2, 28.2, 88.8, 202],
    (15, 50): [0.1, 0.5, 1.2, 2.2, 4.2, 10.8, 36.2, 129],
    (15, 80): [0.1, 0.3, 1.1, 2.4, 4.1, 8.3, 23.7, 82.8],
}


@pytest.mark.parametrize(("weather", "expected"), TABLE.items(), ids=str)
def test_the_table_of_the_norm_comes_out(weather: tuple[int, int], expected: list[float]) -> None:
    temperature_c, humidity_percent = weather
    for frequency_hz, db_per_km in zip(OCTAVES_HZ, expected, strict=True):
        rounding = 0.5 if db_per_km > 100 else 0.06
        computed = 1000 * absorption_db_per_m(frequency_hz, temperature_c, humidity_percent)
        assert computed == pytest.approx(db_per_km, abs=rounding)


# ISO 9613-1:1993, table 1: (degrees Celsius, percent, one-third octaves above 1 kHz) and dB/km.
HIGH_TABLE = {
    (20, 80, 10): 105,
    (20, 15, 8): 175,
    (0, 10, 9): 26.4,
    (10, 10, 9): 69.4,
    (50, 10, 9): 155,
    (50, 70, 9): 80.3,
}


@pytest.mark.parametrize(("weather", "expected"), HIGH_TABLE.items(), ids=str)
def test_the_norm_s_highest_bands_come_out(weather: tuple[int, int, int], expected: float) -> None:
    temperature_c, humidity_percent, third = weather
    computed = 1000 * absorption_db_per_m(10 ** (3 + third / 10), temperature_c, humidity_percent)
    assert computed == pytest.approx(expected, rel=5e-3)
