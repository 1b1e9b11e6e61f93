"""Gain control: a tone comes out at the target, and the gain moves with its time constants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.world.transducers import GainControl, controlled

RATE_HZ = 44_100
CONTROL = GainControl(attack_s=0.004, release_s=0.2, target_level=0.05, most_gain_db=24.0)


def tone(rms: float | F64, duration_s: float = 3.0) -> F32:
    t_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    return (rms * np.sqrt(2) * np.sin(2 * np.pi * 17_321.0 * t_s)).astype(np.float32)


def gain_db(before: F32, after: F32) -> F64:
    """In every millisecond."""
    energy = [(s.astype(float)[: len(s) // 44 * 44].reshape(-1, 44) ** 2).sum(axis=1)
              for s in (before, after)]  # fmt: skip
    return np.asarray(10 * np.log10(energy[1] / energy[0]))


def rms(sound: F32) -> float:
    return float(np.sqrt(np.mean(sound.astype(float) ** 2)))


@pytest.mark.parametrize("level", [0.004, 0.05, 0.4])
def test_a_steady_tone_comes_out_at_the_target(level: float) -> None:
    heard = controlled(tone(level), CONTROL, RATE_HZ)
    assert rms(heard[-RATE_HZ // 2 :]) == pytest.approx(0.05, rel=0.01)
    assert heard.dtype == np.float32


def test_what_is_too_soft_gets_the_most_gain_and_no_more() -> None:
    soft = tone(1e-4)
    heard = controlled(soft, CONTROL, RATE_HZ)
    assert gain_db(soft, heard)[-1] == pytest.approx(24.0, abs=0.01)
    assert gain_db(soft, heard).max() < 24.01


@pytest.mark.parametrize("release_s", [0.1, 0.4])
def test_after_a_loud_chirp_the_gain_recovers_with_its_time_constant(release_s: float) -> None:
    t_s = np.arange(3 * RATE_HZ) / RATE_HZ
    sound = tone(np.where((t_s > 1.5) & (t_s < 1.53), 0.3, 0.004))
    control = replace(CONTROL, release_s=release_s)
    gain = gain_db(sound, controlled(sound, control, RATE_HZ))
    rest_db = 20 * np.log10(0.05 / 0.004)
    recovering = slice(1580, 1580 + round(500 * release_s))  # the level has come down by then
    below_db = rest_db - gain[recovering]
    ms = np.arange(len(below_db)) * 44_000 / RATE_HZ
    tau_s = -1e-3 / np.polyfit(ms, np.log(below_db), 1)[0]
    assert tau_s == pytest.approx(release_s, rel=0.03)
    assert gain[1526] == pytest.approx(20 * np.log10(0.05 / 0.3), abs=0.5)


@pytest.mark.parametrize("attack_s", [0.02, 0.06])
def test_a_louder_tone_is_turned_down_with_the_attack(attack_s: float) -> None:
    t_s = np.arange(3 * RATE_HZ) / RATE_HZ
    sound = tone(np.where(t_s > 1.5, 0.3, 0.02))
    gain = gain_db(sound, controlled(sound, replace(CONTROL, attack_s=attack_s), RATE_HZ))
    above_db = gain[1515 : 1515 + round(1000 * attack_s)] - 20 * np.log10(0.05 / 0.3)
    tau_s = -1e-3 / np.polyfit(np.arange(len(above_db)) * 44_000 / RATE_HZ, np.log(above_db), 1)[0]
    assert tau_s == pytest.approx(attack_s, rel=0.05)


def test_off_is_the_same_recording() -> None:
    sound = tone(0.3)
    assert controlled(sound, None, RATE_HZ) is sound


def test_what_comes_before_the_attack_is_limited() -> None:
    """The gain has risen in silence; the burst would be 24 dB louder than it is."""
    t_s = np.arange(3 * RATE_HZ) / RATE_HZ
    sound = tone(np.where(t_s > 2.0, 0.3, 1e-4))
    heard = controlled(sound, CONTROL, RATE_HZ, clip_level=0.9)
    assert np.abs(heard).max() == np.float32(0.9)
    assert (np.abs(heard[: 2 * RATE_HZ]) < 0.01).all()


def test_silence_stays_silent() -> None:
    assert not controlled(np.zeros(2000, np.float32), CONTROL, RATE_HZ).any()


@pytest.mark.parametrize(
    "wrong", [{"attack_s": 0.0}, {"release_s": -1.0}, {"target_level": 0.0}, {"most_gain_db": -3.0}]
)
def test_a_control_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="gain control: wanted times and a target above 0"):
        replace(CONTROL, **wrong)
