"""Ringing: it decays as the quality factor says, begins with the sound, and peaks as planted."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.world.transducers import Resonance, ringing

RATE_HZ, COUNT = 3.2e6, 2**16
MODES = (Resonance(15_600.0, 8.0, 0.7), Resonance(17_300.0, 30.0, -0.5))


def impulse_response(*modes: Resonance) -> F64:
    """What is heard of an impulse at sample 0 beside the direct sound; the last half is before."""
    frequency_hz = np.fft.rfftfreq(COUNT, 1 / RATE_HZ)
    return np.asarray(np.fft.irfft(ringing(modes, frequency_hz) - 1.0, COUNT))


@pytest.mark.parametrize("mode", MODES)
def test_a_resonance_rings_down_as_its_quality_says(mode: Resonance) -> None:
    """exp(-pi f t / Q): from one cycle to the next, over five times the decay."""
    heard = impulse_response(mode)
    cycle = RATE_HZ / (mode.frequency_hz * np.sqrt(1 - 0.25 / mode.q**2))
    starts = (np.arange(int(5 * mode.decay_s * mode.frequency_hz)) * cycle).astype(int)
    peaks = np.array([np.abs(heard[a : a + int(cycle)]).max() for a in starts])
    rate_per_s = -np.polyfit(starts / RATE_HZ, np.log(peaks), 1)[0]
    assert rate_per_s == pytest.approx(np.pi * mode.frequency_hz / mode.q, rel=0.01)
    assert mode.decay_s == pytest.approx(1 / rate_per_s, rel=0.01)


def test_nothing_rings_before_the_sound() -> None:
    heard = impulse_response(*MODES)
    before, after = heard[COUNT // 2 :], heard[: COUNT // 2]
    assert (before**2).sum() < 1e-3 * (after**2).sum()
    # What there is of it is the band's end at 1.6 MHz, next to the jump at time 0.
    assert np.abs(before[:-40]).max() < 5e-3 * np.abs(after).max()


@pytest.mark.parametrize("mode", MODES)
def test_a_resonance_has_its_gain_at_its_peak_and_half_its_power_beside(mode: Resonance) -> None:
    half = mode.frequency_hz * (np.sqrt(1 + 0.25 / mode.q**2) + np.array([-0.5, 0.5]) / mode.q)
    frequency_hz = np.array([*half, mode.frequency_hz])
    low, high, peak = ringing((mode,), frequency_hz) - 1.0
    assert peak == pytest.approx(mode.gain)
    assert np.abs([low, high]) == pytest.approx(abs(mode.gain) / np.sqrt(2))


def test_resonances_add_up_beside_the_direct_sound() -> None:
    frequency_hz = np.linspace(15_000.0, 20_000.0, 7)
    alone = [ringing((mode,), frequency_hz) - 1.0 for mode in MODES]
    assert ringing(MODES, frequency_hz) == pytest.approx(1.0 + sum(alone))
    assert (ringing((), frequency_hz) == 1.0).all()


@pytest.mark.parametrize("wrong", [(0.0, 5.0, 1.0), (17e3, 0.5, 1.0), (17e3, 5.0, np.nan)])
def test_what_does_not_ring_is_refused(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match=r"resonance: wanted a positive frequency, a q above 0\.5"):
        Resonance(*wrong)
