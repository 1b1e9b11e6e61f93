"""Frames are odd for what is planted in them, and enough of them make a stretch suspect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.values import ECHO_SAMPLES, Echoes, FrameFacts
from elfslam.line.trust import REASONS, TrustParameters, judge, loudness, odd_frames, off_time_s

PARAMETERS = TrustParameters()
COUNT = 60
PERIOD_S = 0.1
LEVEL = 0.2
LATE, EARLY, LOUD, NOISE, CLIPPED = range(1, len(REASONS))


def quiet() -> tuple[FrameFacts, Echoes]:
    """Six seconds in which nothing is odd; every arrival comes 30 ms after it was played."""
    t_s, none = PERIOD_S * np.arange(COUNT), np.zeros(COUNT)
    late = np.full(COUNT, 3e-5)
    facts = FrameFacts(t_s, late, np.full(COUNT, LEVEL), none + 0.01, none, none, none)
    tone = np.sin(2 * np.pi * 17_500 / 44_100 * np.arange(ECHO_SAMPLES))
    samples = np.tile(0.01 * LEVEL * np.sqrt(2) * tone, (COUNT, 1)).astype(np.float32)
    return facts, Echoes(t_s + late, samples, none, np.zeros((0, 2)))


def planted(reason: int, frames: slice) -> tuple[FrameFacts, Echoes]:
    facts, echoes = quiet()
    column = {EARLY: "before", NOISE: "noise", CLIPPED: "clipped", LATE: "late_s"}.get(reason)
    if column is None:
        samples = echoes.samples.copy()
        samples[frames] *= 30
        return facts, replace(echoes, samples=samples)
    values = getattr(facts, column).copy()
    values[frames] = {EARLY: 0.5, NOISE: 0.1, CLIPPED: 0.2, LATE: np.nan}[reason]
    return replace(facts, **{column: values}), echoes


EDGES_S = np.arange(0.0, COUNT * PERIOD_S, 0.5)


def test_nothing_odd_is_not_suspect() -> None:
    npt.assert_array_equal(judge(*quiet(), EDGES_S, PARAMETERS), 0)


@pytest.mark.parametrize("reason", range(1, len(REASONS)))
def test_what_is_planted_is_the_reason_and_is_forgotten(reason: int) -> None:
    found = judge(*planted(reason, slice(20, 40)), EDGES_S, PARAMETERS)
    ends_s = EDGES_S[1:]
    npt.assert_array_equal(found[ends_s <= 2.0], 0)
    npt.assert_array_equal(found[(ends_s >= 3.0) & (ends_s <= 4.5)], reason)
    npt.assert_array_equal(found[ends_s > 4.0 + PARAMETERS.memory_s], 0)


def test_a_few_odd_frames_are_forgiven() -> None:
    assert not judge(*planted(EARLY, slice(20, 25)), EDGES_S, PARAMETERS).any()
    assert judge(*planted(EARLY, slice(20, 28)), EDGES_S, PARAMETERS).any()


def test_few_frames_are_not_judged() -> None:
    found = judge(*planted(NOISE, slice(0, COUNT)), np.array([0.0, 0.5, 1.0]), PARAMETERS)
    assert found.tolist() == [0, NOISE]


def test_an_arrival_off_its_time_is_odd_and_a_slow_clock_is_not() -> None:
    facts, _ = quiet()
    drifting = facts.late_s + 4e-5 * facts.t_due_s
    assert off_time_s(replace(facts, late_s=drifting)).max() < 1e-4
    jumped = facts.late_s + np.where(np.arange(COUNT) == 30, 0.01, 0.0)
    off_s = off_time_s(replace(facts, late_s=jumped))
    assert off_s[30] == pytest.approx(0.01)
    assert np.delete(off_s, 30).max() < 1e-9


def test_sound_that_comes_later_from_now_on_is_no_attack() -> None:
    """A browser may drop or insert a block of sound: all that follows is off by as much."""
    facts, echoes = quiet()
    moved = replace(facts, late_s=facts.late_s + np.where(np.arange(COUNT) >= 30, 0.01, 0.0))
    assert (off_time_s(moved) > PARAMETERS.off_time_s).sum() == 4
    assert not judge(moved, echoes, EDGES_S, PARAMETERS).any()


def test_loudness_is_that_of_the_band_beside_the_direct_sound() -> None:
    facts, echoes = quiet()
    npt.assert_allclose(loudness(facts, echoes), 0.01, rtol=0.01)
    hum = 0.05 * np.sin(2 * np.pi * 300 / 44_100 * np.arange(ECHO_SAMPLES)).astype(np.float32)
    humming = replace(echoes, samples=echoes.samples + hum)
    npt.assert_allclose(loudness(facts, humming), 0.01, rtol=0.01)
    some = Echoes(echoes.t_s[::2], echoes.samples[::2], echoes.snr_db[::2], np.zeros((0, 2)))
    heard = loudness(facts, some)
    npt.assert_allclose(heard[::2], 0.01, rtol=0.01)
    npt.assert_array_equal(heard[1::2], 0.0)


def test_each_way_to_be_odd_has_its_reason() -> None:
    assert odd_frames(*quiet(), PARAMETERS).shape == (COUNT, len(REASONS) - 1)
