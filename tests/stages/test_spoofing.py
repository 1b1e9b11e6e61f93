"""Frames are odd for what is planted in them, and enough of them make a stretch suspect."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.values import ECHO_SAMPLES, Echoes, FrameFacts
from elfslam.stages import spoofing

PARAMETERS = spoofing.SpoofingParameters()
COUNT = 60
PERIOD_S = 0.1
LEVEL = 0.2
LATE, EARLY, LOUD, NOISE, CLIPPED, LAGGING = range(1, len(spoofing.REASONS))


def quiet() -> tuple[FrameFacts, Echoes]:
    """Six seconds in which nothing is odd; every arrival comes 30 ms after it was played."""
    t_s, none = PERIOD_S * np.arange(COUNT), np.zeros(COUNT)
    late = np.full(COUNT, 3e-5)
    facts = FrameFacts(t_s, late, np.full(COUNT, LEVEL), none + 0.01, none, none)
    tone = np.sin(2 * np.pi * 17_500 / 44_100 * np.arange(ECHO_SAMPLES))
    samples = np.tile(0.01 * LEVEL * np.sqrt(2) * tone, (COUNT, 1)).astype(np.float32)
    return facts, Echoes(t_s + late, samples, np.zeros((0, 2)))


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
    npt.assert_array_equal(spoofing.judge(*quiet(), EDGES_S, PARAMETERS), 0)


@pytest.mark.parametrize("reason", range(1, LAGGING))
def test_what_is_planted_is_the_reason_and_is_forgotten(reason: int) -> None:
    found = spoofing.judge(*planted(reason, slice(20, 40)), EDGES_S, PARAMETERS)
    ends_s = EDGES_S[1:]
    npt.assert_array_equal(found[ends_s <= 2.0], 0)
    npt.assert_array_equal(found[(ends_s >= 3.0) & (ends_s <= 4.5)], reason)
    npt.assert_array_equal(found[ends_s > 4.0 + PARAMETERS.memory_s], 0)


def test_a_few_odd_frames_are_forgiven() -> None:
    assert not spoofing.judge(*planted(EARLY, slice(20, 25)), EDGES_S, PARAMETERS).any()
    assert spoofing.judge(*planted(EARLY, slice(20, 28)), EDGES_S, PARAMETERS).any()


def test_few_frames_are_not_judged() -> None:
    found = spoofing.judge(*planted(NOISE, slice(0, COUNT)), np.array([0.0, 0.5, 1.0]), PARAMETERS)
    assert found.tolist() == [0, NOISE]


def test_an_arrival_off_its_time_is_odd_and_a_slow_clock_is_not() -> None:
    facts, _ = quiet()
    drifting = facts.late_s + 4e-5 * facts.t_due_s
    assert spoofing.off_time_s(replace(facts, late_s=drifting)).max() < 1e-4
    jumped = facts.late_s + np.where(np.arange(COUNT) == 30, 0.01, 0.0)
    off_s = spoofing.off_time_s(replace(facts, late_s=jumped))
    assert off_s[30] == pytest.approx(0.01)
    assert np.delete(off_s, 30).max() < 1e-9


def test_sound_that_comes_later_from_now_on_is_no_attack() -> None:
    """A browser may drop or insert a block of sound: all that follows is off by as much."""
    facts, echoes = quiet()
    moved = replace(facts, late_s=facts.late_s + np.where(np.arange(COUNT) >= 30, 0.01, 0.0))
    assert (spoofing.off_time_s(moved) > PARAMETERS.off_time_s).sum() == 4
    assert not spoofing.judge(moved, echoes, EDGES_S, PARAMETERS).any()


def test_loudness_is_that_of_the_band_beside_the_direct_sound() -> None:
    facts, echoes = quiet()
    npt.assert_allclose(spoofing.loudness(facts, echoes), 0.01, rtol=0.01)
    hum = 0.05 * np.sin(2 * np.pi * 300 / 44_100 * np.arange(ECHO_SAMPLES)).astype(np.float32)
    humming = replace(echoes, samples=echoes.samples + hum)
    npt.assert_allclose(spoofing.loudness(facts, humming), 0.01, rtol=0.01)
    some = Echoes(echoes.t_s[::2], echoes.samples[::2], np.zeros((0, 2)))
    heard = spoofing.loudness(facts, some)
    npt.assert_allclose(heard[::2], 0.01, rtol=0.01)
    npt.assert_array_equal(heard[1::2], 0.0)


def test_each_way_to_be_odd_has_its_reason() -> None:
    assert spoofing.odd_frames(*quiet(), PARAMETERS).shape == (COUNT, LAGGING - 1)


GAIN_DB = np.where(np.random.default_rng(5).uniform(size=COUNT) < 0.5, -4.0, 0.0)


def by_chance(
    added: float = 0.0, frames: slice = slice(None), *, flutter_db: float = 0.5, follows: float = 0
) -> tuple[FrameFacts, Echoes]:
    """Chirps of random loudness; the room's echoes flutter, and power is added to them in frames.

    What is added is so many times as strong as they are under the loudest chirp, and follows the
    chirps so far.
    """
    facts, echoes = quiet()
    gain = 10 ** (GAIN_DB / 20)
    flutter = 10 ** (flutter_db * np.random.default_rng(6).standard_normal(COUNT) / 20)
    power = (gain * flutter) ** 2
    power[frames] += added * gain[frames] ** (2 * follows)
    samples = 0.1 * echoes.samples * np.sqrt(power)[:, None].astype(np.float32)
    heard = replace(echoes, samples=samples)
    return replace(facts, level=facts.level * gain, gain_db=GAIN_DB), heard


def test_echoes_that_follow_their_chirps_are_not_suspect() -> None:
    npt.assert_array_equal(spoofing.judge(*by_chance(), EDGES_S, PARAMETERS), 0)
    npt.assert_array_equal(spoofing.judge(*by_chance(1.0, follows=1), EDGES_S, PARAMETERS), 0)


def suspect_s(heard: tuple[FrameFacts, Echoes]) -> F64:
    """When echoes are said to lag, looked at ten times a second; nothing else is said."""
    edges_s = PERIOD_S * np.arange(COUNT + 1)
    found = spoofing.judge(*heard, edges_s, PARAMETERS)
    assert set(found.tolist()) <= {0, LAGGING}
    return edges_s[1:][found == LAGGING]


@pytest.mark.parametrize("added", [1.0, 8.0])
def test_echoes_that_do_not_follow_their_chirps_are_suspect(added: float) -> None:
    told_s = suspect_s(by_chance(added, slice(30, None)))
    assert 3.0 < told_s[0] < 5.6
    npt.assert_allclose(np.diff(told_s), PERIOD_S)
    assert told_s[-1] == pytest.approx(COUNT * PERIOD_S)


def test_suspicion_ends_once_echoes_follow_their_chirps_again() -> None:
    told_s = suspect_s(by_chance(2.0, slice(0, 30)))
    assert told_s[0] < 2.7
    assert 3.0 < told_s[-1] < 3.0 + PERIOD_S * PARAMETERS.compared_chirps


def test_fewer_chirps_than_are_compared_are_not_judged() -> None:
    told_s = suspect_s(by_chance(8.0))
    assert told_s[0] == pytest.approx(PERIOD_S * (PARAMETERS.compared_chirps + 1))


def test_nobody_is_suspected_without_loudness_without_change_or_in_a_flutter() -> None:
    facts, echoes = by_chance(1.0)
    silent = replace(facts, gain_db=None)
    alike = replace(facts, gain_db=np.full(COUNT, -4.0))
    fluttering = by_chance(0.3, flutter_db=12.0)
    for heard in ((silent, echoes), (alike, echoes), fluttering):
        npt.assert_array_equal(spoofing.judge(*heard, EDGES_S, PARAMETERS), 0)


def test_loudness_is_compared_among_clean_echoes_alone() -> None:
    """Others' chirps lie in every second of the soft frames; those are known."""
    spoiled = (np.arange(COUNT) % 4 > 0) & (GAIN_DB < 0)
    facts, echoes = by_chance()
    samples = np.where(spoiled[:, None], 1.5 * echoes.samples, echoes.samples)
    among = replace(echoes, samples=samples)
    kept = ~spoiled
    clean = Echoes(echoes.t_s[kept], echoes.samples[kept], np.zeros((0, 2)))
    assert (spoofing.judge(facts, among, EDGES_S, PARAMETERS) == LAGGING).any()
    npt.assert_array_equal(spoofing.judge(facts, among, EDGES_S, PARAMETERS, clean), 0)
    chirps = spoofing.heard_chirps(facts, clean)
    npt.assert_allclose(chirps[:, 0], facts.t_due_s[kept])
    npt.assert_allclose(chirps[:, 1], GAIN_DB[kept])
    npt.assert_allclose(chirps[:, 3:], -60, atol=2)


@pytest.mark.parametrize("clear_db", [10.0, 0.0])
def test_noise_does_not_follow_either_and_does_not_count(clear_db: float) -> None:
    """As much noise as late echoes: nothing is said of those, and of early ones nothing wrong."""
    facts, echoes = by_chance()
    generator = np.random.default_rng(7)
    hiss = 1e-3 * LEVEL * generator.standard_normal(echoes.samples.shape)
    early = np.where(np.arange(ECHO_SAMPLES) < ECHO_SAMPLES // 4, 10.0, 1.0)
    samples = (early * echoes.samples + hiss).astype(np.float32)
    # Through the matched filter as much noise is less: 13 times, and 1.18 for the envelope.
    noisy = replace(facts, noise=np.full(COUNT, 1e-3 * LEVEL * 1.18 / 14))
    known = replace(PARAMETERS, clear_db=clear_db, loud_last=1.0)
    found = spoofing.judge(noisy, replace(echoes, samples=samples), EDGES_S, known)
    assert (found == LAGGING).any() == (clear_db == 0)


def test_the_gain_of_a_microphone_that_follows_the_chirps_changes_nothing() -> None:
    for heard in (by_chance(), by_chance(1.0)):
        facts, echoes = heard
        levelled = 10 ** (-0.7 * GAIN_DB / 20)
        samples = echoes.samples * levelled[:, None].astype(np.float32)
        same = replace(facts, level=facts.level * levelled), replace(echoes, samples=samples)
        expected = spoofing.judge(*heard, EDGES_S, PARAMETERS)
        npt.assert_array_equal(spoofing.judge(*same, EDGES_S, PARAMETERS), expected)
