"""Chirps whose schedule is known are found where they are due; facts of each are as planted."""

import dataclasses
import re

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import Audio, Echoes, FrameFacts
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, cut_echoes, echoes_of, find_frames, frame_facts

RATE_HZ = 44_100
PARAMETERS = EchoParameters()
CHIRP = make_chirp(ChirpParameters(), RATE_HZ)


def played(count: int, seed: int = 1) -> F64:
    return 0.1 * np.arange(count) + np.random.default_rng(seed).uniform(0, 0.025, count)


def sound(arrivals_s: F64, seconds: float, level: float = 0.2, noise: float = 1e-4) -> F32:
    """Chirps with an echo each, at whole samples."""
    samples = noise * np.random.default_rng(4).standard_normal(round(seconds * RATE_HZ))
    for gain, delay_s in ((1.0, 0.0), (0.3, 0.0213), (0.2, 0.0391)):
        for start in np.round((arrivals_s + delay_s) * RATE_HZ).astype(int):
            room = len(samples) - start
            if start >= 0 and room > 0:
                samples[start : start + 441] += level * gain * CHIRP.samples[:room]
    return samples.astype(np.float32)


def cut(samples: F32, played_s: F64, duration_s: float | None = None) -> Echoes:
    return cut_echoes(Audio(samples[None], RATE_HZ), CHIRP, PARAMETERS, duration_s, played_s)


@pytest.mark.parametrize("late_s", [0.0, 0.012, 0.0999, 0.31, 0.77])
def test_arrivals_are_found_where_they_are_due(late_s: float) -> None:
    """Chirps that the schedule leaves out are no losses."""
    few = played(120)[np.random.default_rng(3).uniform(size=120) < 0.4]
    for played_s, seconds in ((played(60), 7.0), (few, 13.0)):
        echoes = cut(sound(played_s + late_s, seconds), played_s)
        npt.assert_allclose(echoes.t_s, played_s + late_s, atol=1 / RATE_HZ)
        assert len(echoes.losses_s) == 0


@pytest.mark.parametrize("louder", [0.5, 1.0, 2.0])
def test_other_phones_are_not_followed(louder: float) -> None:
    played_s = played(100)
    mine, theirs = played_s + 0.083, played(100, seed=9) + 0.031
    samples = sound(mine, 11.0) + louder * sound(theirs, 11.0)
    echoes = cut(samples, played_s)
    assert len(echoes.t_s) >= 99
    off_s = np.min(np.abs(echoes.t_s[:, None] - mine), axis=1)
    assert np.mean(off_s < 1.5 / RATE_HZ) > 0.9
    assert off_s.max() <= 0.0036


def test_chirps_that_were_played_and_not_heard_are_a_loss() -> None:
    played_s = played(60)
    samples = sound(np.delete(played_s, np.s_[20:24]) + 0.1, 7.0)
    echoes = cut(samples, played_s)
    npt.assert_allclose(echoes.t_s, np.delete(played_s, np.s_[20:24]) + 0.1, atol=1 / RATE_HZ)
    npt.assert_allclose(echoes.losses_s, [[played_s[19] + 0.2, 0.4]], atol=1e-4)


@pytest.mark.parametrize("ppm", [-60.0, 60.0])
def test_clocks_that_run_apart_are_followed(ppm: float) -> None:
    played_s = played(1500)
    arrivals_s = (played_s + 0.05) * (1 + ppm * 1e-6)
    echoes = cut(sound(arrivals_s, 152.0), played_s)
    npt.assert_allclose(echoes.t_s, arrivals_s, atol=1.5 / RATE_HZ)
    assert len(echoes.losses_s) == 0


def test_a_playback_that_falls_behind_is_followed_and_no_loss() -> None:
    played_s = played(80)
    arrivals_s = played_s + 0.05 + np.where(np.arange(80) >= 37, 0.061, 0.0)
    echoes = cut(sound(arrivals_s, 9.0), played_s, duration_s=9.0)
    npt.assert_allclose(echoes.t_s, arrivals_s, atol=1 / RATE_HZ)
    npt.assert_allclose(echoes.losses_s[:, 1], [0.0])


@pytest.mark.parametrize("lost_s", [0.03, 0.3, 0.53])
def test_lost_sound_is_put_back_whole_periods_too(lost_s: float) -> None:
    played_s = played(80)
    first = round((played_s[40] + 0.05 - 0.004) * RATE_HZ)
    samples = np.delete(sound(played_s + 0.05, 9.0), np.s_[first : first + round(lost_s * RATE_HZ)])
    echoes = cut(samples, played_s, duration_s=9.0)
    off_s = np.min(np.abs(echoes.t_s[:, None] - played_s - 0.05), axis=1)
    assert off_s.max() < 2 / RATE_HZ
    assert len(echoes.t_s) >= 80 - round(lost_s / 0.1) - 2
    npt.assert_allclose(echoes.losses_s[:, 1].max(), lost_s, atol=1e-4)


def test_a_regular_schedule_is_a_schedule() -> None:
    played_s = 0.1 * np.arange(60)
    echoes = cut(sound(played_s + 0.05, 7.0), played_s)
    npt.assert_allclose(echoes.t_s, played_s[-len(echoes.t_s) :] + 0.05, atol=1 / RATE_HZ)
    assert len(echoes.t_s) >= 59


def test_the_beginning_is_found_though_the_sound_began_late() -> None:
    played_s = played(200)
    samples = sound(played_s + 0.05, 21.0)
    samples[: 6 * RATE_HZ] *= 0
    echoes = cut(samples, played_s)
    heard = played_s + 0.05 > 6.0
    npt.assert_allclose(echoes.t_s, played_s[heard] + 0.05, atol=1 / RATE_HZ)


def test_a_schedule_of_another_recording_is_refused() -> None:
    with pytest.raises(InputError, match=r"chirps.csv belongs|of \d+ chirps heard that were"):
        cut(sound(played(60) + 0.05, 7.0), played(60, seed=7))


def test_sound_that_mostly_lacks_its_chirps_is_refused_with_the_count() -> None:
    samples = sound(played(60) + 0.05, 7.0)
    quiet = samples[round(2.5 * RATE_HZ) :]
    quiet[:] = 1e-4 * np.random.default_rng(4).standard_normal(len(quiet))
    with pytest.raises(InputError, match=re.escape("of 60 chirps heard that were played, wanted")):
        cut(samples, played(60))


def test_chirps_played_while_there_was_no_sound_are_no_lack_of_chirps() -> None:
    """A call takes the microphone: only what was played before and after it counts."""
    played_s = played(100)
    samples = sound(played_s + 0.05, 11.0)
    samples[round(2.5 * RATE_HZ) : round(9.0 * RATE_HZ)] = 0.0
    heard = (played_s + 0.12 < 2.5) | (played_s + 0.05 > 9.0)
    echoes = cut(samples, played_s)
    nearest_s = np.min(np.abs(echoes.t_s[:, None] - played_s[heard] - 0.05), axis=0)
    assert nearest_s.max() < 2 / RATE_HZ
    assert len(echoes.t_s) <= heard.sum() + 1


def test_noise_is_refused() -> None:
    noise = 0.1 * np.random.default_rng(2).standard_normal(7 * RATE_HZ)
    with pytest.raises(InputError, match=r"no chirps when the schedule says"):
        cut(noise.astype(np.float32), played(60))


def test_a_search_wider_than_half_a_period_is_refused() -> None:
    wide = dataclasses.replace(PARAMETERS, slack_s=0.2)
    with pytest.raises(ParameterError, match=r"wanted less than half of chirp.period_s"):
        cut_echoes(Audio(sound(played(60), 7.0)[None], RATE_HZ), CHIRP, wide, played_t_s=played(60))


COUNT = 50
PLAYED_S = 0.1 * np.arange(COUNT) + np.random.default_rng(1).uniform(0, 0.025, COUNT)
LATE_S = 0.08
SCHEDULES = (PLAYED_S, None)


def chirps(arrivals_s: F64, level: F64 | float = 0.2) -> F32:
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
    facts = facts_of(chirps(arrivals_for(played_s)), played_s)
    npt.assert_allclose(facts.t_due_s, arrivals_for(played_s), atol=2 / RATE_HZ)
    npt.assert_allclose(facts.late_s, 0, atol=2 / RATE_HZ)
    npt.assert_allclose(facts.level, 0.2, rtol=0.02)
    assert facts.before.max() < 0.06
    assert facts.noise[1:].max() < 0.003
    assert facts.clipped.max() == 0


@pytest.mark.parametrize("played_s", SCHEDULES)
def test_what_was_planted_before_a_chirp_is_told(played_s: F64 | None) -> None:
    arrivals_s = arrivals_for(played_s)
    samples = chirps(arrivals_s)
    samples += chirps(arrivals_s[[20]] - 0.006, 0.08)
    facts = facts_of(samples, played_s)
    npt.assert_allclose(facts.before[20], 0.4, rtol=0.1)
    assert np.delete(facts.before, 20).max() < 0.06


@pytest.mark.parametrize("played_s", SCHEDULES)
def test_a_chirp_that_was_not_heard_has_no_lateness(played_s: F64 | None) -> None:
    arrivals_s = arrivals_for(played_s)
    facts = facts_of(chirps(np.delete(arrivals_s, [20, 21])), played_s)
    assert np.flatnonzero(np.isnan(facts.late_s)).tolist() == [20, 21]
    npt.assert_allclose(facts.t_due_s, arrivals_s, atol=2 / RATE_HZ)
    assert facts.level[20] < 0.01


def test_a_chirp_off_its_time_is_late() -> None:
    arrivals_s = PLAYED_S + LATE_S
    arrivals_s[25] += 0.0011
    arrivals_s[35] -= 0.0009
    facts = facts_of(chirps(arrivals_s), PLAYED_S)
    npt.assert_allclose(facts.late_s[[25, 35]], [0.0011, -0.0009], atol=3 / RATE_HZ)
    npt.assert_allclose(np.delete(facts.late_s, [25, 35]), 0, atol=3 / RATE_HZ)


def test_clipping_is_told_where_it_is() -> None:
    levels = np.where(np.arange(COUNT) == 12, 1.05, 0.3)
    samples = np.clip(chirps(PLAYED_S + LATE_S, levels), -1, 1)
    facts = facts_of(samples, PLAYED_S)
    assert facts.clipped[12] > 0.01
    assert np.delete(facts.clipped, 12).max() == 0


def test_times_are_those_of_the_echoes_where_sound_was_lost() -> None:
    arrivals_s = PLAYED_S + LATE_S
    first = round((arrivals_s[30] - 0.006) * RATE_HZ)
    samples = np.delete(chirps(arrivals_s), np.s_[first : first + 2000])
    frames = find_frames(Audio(samples[None], RATE_HZ), CHIRP, PARAMETERS, PLAYED_S)
    facts = frame_facts(frames, PARAMETERS, 5.5)
    echoes = echoes_of(frames, PARAMETERS, 5.5)
    heard = ~np.isnan(facts.late_s)
    npt.assert_allclose((facts.t_due_s + facts.late_s)[heard], echoes.t_s, atol=1e-9)


def test_spoiled_frames_are_left_out() -> None:
    audio = Audio(chirps(PLAYED_S + LATE_S)[None], RATE_HZ)
    frames = find_frames(audio, CHIRP, PARAMETERS, PLAYED_S)
    spoiled = np.arange(len(frames.arrivals.samples)) % 3 == 0
    kept, everything = echoes_of(frames, PARAMETERS, None, spoiled), echoes_of(frames, PARAMETERS)
    npt.assert_array_equal(kept.t_s, everything.t_s[~spoiled[: len(everything.t_s)]])
