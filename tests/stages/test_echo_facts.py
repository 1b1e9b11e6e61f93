"""Facts of each frame are those that were planted around its chirp."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.values import Audio, FrameFacts
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, echoes_of, find_frames, frame_facts

RATE_HZ = 44_100
PARAMETERS = EchoParameters()
CHIRP = make_chirp(ChirpParameters(), RATE_HZ)
COUNT = 50
PLAYED_S = 0.1 * np.arange(COUNT) + np.random.default_rng(1).uniform(0, 0.025, COUNT)
LATE_S = 0.08
SCHEDULES = (PLAYED_S, None)


def sound(arrivals_s: F64, level: F64 | float = 0.2) -> F32:
    samples = 1e-5 * np.random.default_rng(4).standard_normal(round(5.5 * RATE_HZ))
    levels = np.broadcast_to(level, len(arrivals_s))
    for start, gain in zip(np.round(arrivals_s * RATE_HZ).astype(int), levels, strict=True):
        samples[start : start + 441] += gain * CHIRP.samples
    return samples.astype(np.float32)


def facts_of(samples: F32, played_s: F64 | None, duration_s: float | None = None) -> FrameFacts:
    frames = find_frames(Audio(samples[None], RATE_HZ), CHIRP, PARAMETERS, played_s)
    return frame_facts(frames, PARAMETERS, duration_s)


def arrivals_for(played_s: F64 | None) -> F64:
    return (0.1 * np.arange(COUNT) if played_s is None else played_s) + LATE_S


@pytest.mark.parametrize("played_s", SCHEDULES)
def test_undisturbed_chirps_have_a_level_and_quiet_around(played_s: F64 | None) -> None:
    facts = facts_of(sound(arrivals_for(played_s)), played_s)
    npt.assert_allclose(facts.t_due_s, arrivals_for(played_s), atol=2 / RATE_HZ)
    npt.assert_allclose(facts.late_s, 0, atol=2 / RATE_HZ)
    npt.assert_allclose(facts.level, 0.2, rtol=0.02)
    assert facts.before.max() < 0.06
    assert facts.noise[1:].max() < 0.003
    assert facts.clipped.max() == 0


@pytest.mark.parametrize("played_s", SCHEDULES)
def test_what_was_planted_before_a_chirp_is_told(played_s: F64 | None) -> None:
    arrivals_s = arrivals_for(played_s)
    samples = sound(arrivals_s)
    samples += sound(arrivals_s[[20]] - 0.006, 0.08)
    facts = facts_of(samples, played_s)
    npt.assert_allclose(facts.before[20], 0.4, rtol=0.1)
    assert np.delete(facts.before, 20).max() < 0.06


@pytest.mark.parametrize("played_s", SCHEDULES)
def test_a_chirp_that_was_not_heard_has_no_lateness(played_s: F64 | None) -> None:
    arrivals_s = arrivals_for(played_s)
    facts = facts_of(sound(np.delete(arrivals_s, [20, 21])), played_s)
    assert np.flatnonzero(np.isnan(facts.late_s)).tolist() == [20, 21]
    npt.assert_allclose(facts.t_due_s, arrivals_s, atol=2 / RATE_HZ)
    assert facts.level[20] < 0.01


def test_a_chirp_off_its_time_is_late() -> None:
    arrivals_s = PLAYED_S + LATE_S
    arrivals_s[25] += 0.0011
    arrivals_s[35] -= 0.0009
    facts = facts_of(sound(arrivals_s), PLAYED_S)
    npt.assert_allclose(facts.late_s[[25, 35]], [0.0011, -0.0009], atol=3 / RATE_HZ)
    npt.assert_allclose(np.delete(facts.late_s, [25, 35]), 0, atol=3 / RATE_HZ)


def test_clipping_is_told_where_it_is() -> None:
    levels = np.where(np.arange(COUNT) == 12, 1.05, 0.3)
    samples = np.clip(sound(PLAYED_S + LATE_S, levels), -1, 1)
    facts = facts_of(samples, PLAYED_S)
    assert facts.clipped[12] > 0.01
    assert np.delete(facts.clipped, 12).max() == 0


def test_times_are_those_of_the_echoes_where_sound_was_lost() -> None:
    arrivals_s = PLAYED_S + LATE_S
    first = round((arrivals_s[30] - 0.006) * RATE_HZ)
    samples = np.delete(sound(arrivals_s), np.s_[first : first + 2000])
    frames = find_frames(Audio(samples[None], RATE_HZ), CHIRP, PARAMETERS, PLAYED_S)
    facts = frame_facts(frames, PARAMETERS, 5.5)
    echoes = echoes_of(frames, PARAMETERS, 5.5)
    heard = ~np.isnan(facts.late_s)
    npt.assert_allclose((facts.t_due_s + facts.late_s)[heard], echoes.t_s, atol=1e-9)


def test_spoiled_frames_are_left_out() -> None:
    audio = Audio(sound(PLAYED_S + LATE_S)[None], RATE_HZ)
    frames = find_frames(audio, CHIRP, PARAMETERS, PLAYED_S)
    spoiled = np.arange(len(frames.arrivals.samples)) % 3 == 0
    kept, everything = echoes_of(frames, PARAMETERS, None, spoiled), echoes_of(frames, PARAMETERS)
    npt.assert_array_equal(kept.t_s, everything.t_s[~spoiled[: len(everything.t_s)]])
