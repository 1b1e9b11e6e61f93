"""Sounds in the room: how much lies in the band, how often; and a recorder's clock and limits."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from elfslam.base.arrays import F32
from elfslam.world.device import built_in_device
from elfslam.world.interference import RUMBLE_LEVEL, clicks, music_like, record, rumble, speech_like

RATE_HZ = 44_100
SILENT = replace(built_in_device("flat"), noise_rms=0.0)
Sound = Callable[[int, int, np.random.Generator, float], F32]


def generator_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def share_db(sound: F32, low_hz: float, high_hz: float, rate_hz: int = RATE_HZ) -> float:
    """Power between two frequencies relative to all of it."""
    power = np.abs(np.fft.rfft(sound.astype(np.float64))) ** 2
    frequency_hz = np.fft.rfftfreq(len(sound), 1 / rate_hz)
    inside = (frequency_hz >= low_hz) & (frequency_hz < high_hz)
    return float(10 * np.log10(power[inside].sum() / power.sum()))


@pytest.mark.parametrize("make", [speech_like, music_like])
@pytest.mark.parametrize("level", [0.003, 0.2])
def test_speech_and_music_have_the_rms_asked_for(make: Sound, level: float) -> None:
    sound = make(5 * RATE_HZ, RATE_HZ, generator_of(2), level)
    assert np.sqrt(np.mean(sound.astype(np.float64) ** 2)) == pytest.approx(level, rel=1e-5)


@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
def test_a_little_of_speech_reaches_the_band(rate_hz: int) -> None:
    sound = speech_like(15 * rate_hz, rate_hz, generator_of(0), 0.05)
    assert -50 < share_db(sound, 15_000, 20_000, rate_hz) < -40
    assert share_db(sound, 80, 8_000, rate_hz) > -0.3
    assert share_db(sound, 80, 4_000, rate_hz) > -0.5


def test_speech_has_pauses_and_a_pitch() -> None:
    sound = speech_like(20 * RATE_HZ, RATE_HZ, generator_of(5), 0.05)
    rms = np.sqrt((sound.reshape(-1, RATE_HZ // 50) ** 2).mean(axis=1))
    assert 0.05 < np.mean(rms < 1e-4) < 0.5
    spectrum = np.abs(np.fft.rfft(sound.astype(np.float64)))
    frequency_hz = np.fft.rfftfreq(len(sound), 1 / RATE_HZ)
    assert spectrum[frequency_hz < 70].max() < 0.1 * spectrum.max()


def test_cymbals_of_music_reach_the_band() -> None:
    sound = music_like(15 * RATE_HZ, RATE_HZ, generator_of(0), 0.05)
    assert -36 < share_db(sound, 15_000, 20_000) < -28
    assert share_db(sound, 200, 6_000) > -0.3


def test_clicks_come_as_often_as_asked_for() -> None:
    """At 1.5 per second over 200 s: 300 give or take four times the root of that."""
    sound = clicks(200 * RATE_HZ, RATE_HZ, generator_of(7), 0.1, per_s=1.5)
    onset = np.flatnonzero(np.abs(sound) > 5e-4)
    # Clicks closer than 30 ms run together: 1.5 * 0.03 of them.
    heard = 1 + np.count_nonzero(np.diff(onset) > 0.02 * RATE_HZ)
    assert abs(heard - 300 * (1 - 1.5 * 0.03)) < 4 * np.sqrt(300)


def test_clicks_are_in_the_band_and_as_loud_as_asked_for() -> None:
    sound = clicks(100 * RATE_HZ, RATE_HZ, generator_of(9), 0.05, per_s=1.0)
    assert share_db(sound, 12_500, 21_500) > -0.5
    assert share_db(sound, 15_000, 20_000) > -4
    peaks = np.abs(sound).reshape(200, -1).max(axis=1)
    assert np.median(peaks[peaks > 5e-3]) == pytest.approx(0.05, rel=0.35)
    assert not clicks(RATE_HZ, RATE_HZ, generator_of(9), 0.05, per_s=0.0).any()


def test_rumble_is_low_and_the_one_of_old() -> None:
    sound = rumble(10 * RATE_HZ, RATE_HZ, generator_of(3))
    white = generator_of(3).standard_normal(10 * RATE_HZ)
    low_pass = signal.butter(2, 4_000, fs=RATE_HZ, output="sos")
    np.testing.assert_allclose(sound, 3e-4 * signal.sosfilt(low_pass, white), rtol=1e-6)
    assert RUMBLE_LEVEL == 3e-4
    assert sound.std() == pytest.approx(1.33e-4, rel=0.02)
    assert share_db(sound, 15_000, 20_000) < -35


def test_the_noise_floor_is_the_phones() -> None:
    phone = built_in_device("cheap")
    floor = record(np.zeros(200_000, dtype=np.float32), phone, generator_of(0))
    assert floor.dtype == np.float32
    assert floor.std() == pytest.approx(phone.noise_rms, rel=0.01)
    assert share_db(floor, 15_000, 20_000) == pytest.approx(10 * np.log10(5_000 / 22_050), abs=0.1)


@pytest.mark.parametrize("skew_ppm", [20.0, -20.0, 300.0])
def test_the_clock_moves_a_late_chirp_by_what_it_gained(skew_ppm: float) -> None:
    """A pulse at sample k of what was played stands at k (1 + skew)."""
    phone = replace(SILENT, clock_skew_ppm=skew_ppm)
    count, at = 500_000, 450_000
    pulse = signal.gausspulse((np.arange(count) - at) / RATE_HZ, fc=17_500, bw=0.1)
    recorded = record(pulse.astype(np.float32), phone, generator_of(0))
    envelope = np.abs(signal.hilbert(recorded[at - 500 : at + 500])) ** 2
    centre = at - 500 + float(np.average(np.arange(1000), weights=envelope))
    assert centre - at == pytest.approx(at * skew_ppm * 1e-6, abs=0.01)


def test_a_slow_clock_ends_in_silence_and_a_fast_one_before_the_end() -> None:
    count = 100_000
    sound = np.ones(count, dtype=np.float32)
    slow = record(sound, replace(SILENT, clock_skew_ppm=-1_000.0), generator_of(0))
    fast = record(sound, replace(SILENT, clock_skew_ppm=1_000.0), generator_of(0))
    assert len(slow) == len(fast) == count
    assert not slow[-60:].any()
    assert np.abs(slow[50:-150] - 1).max() < 1e-3
    assert np.abs(fast[50:] - 1).max() < 1e-3
