"""Slotted medium access: whose slots are, and how others are heard, on planted sounds."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.stages import medium_access
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import matched_envelope
from elfslam.stages.medium_access import Slot, SlotSchedule, after_slot, hear_slot, is_played

RATE_HZ = 44_100
PARAMETERS = medium_access.MediumAccessParameters()
CHIRP = make_chirp(ChirpParameters(), RATE_HZ)


def lone(slots: int) -> SlotSchedule:
    schedule = medium_access.initial_schedule(PARAMETERS)
    for slot in range(slots):
        schedule = after_slot(schedule, slot, (), 0.5, PARAMETERS, played=True)
    return schedule


def test_one_listens_first_and_alone_has_every_slot() -> None:
    early = lone(PARAMETERS.listen - 1)
    assert not any(is_played(early, slot, 0.99, PARAMETERS) for slot in range(8))
    assert all(is_played(lone(PARAMETERS.listen), slot, 0.5, PARAMETERS) for slot in range(99))


def test_who_is_alone_keeps_silent_now_and_then_to_hear_a_newcomer() -> None:
    silent = [not is_played(lone(50), 50, draw, PARAMETERS) for draw in np.linspace(0, 0.999, 1000)]
    assert np.mean(silent) == pytest.approx(PARAMETERS.check_alone, abs=0.002)


def test_a_newcomer_who_was_not_heard_coming_is_heard_in_the_end() -> None:
    """Both believe that they are alone, and hear only in the slots that they keep silent in."""
    generator = np.random.default_rng(3)
    schedule, played = [lone(PARAMETERS.forget)] * 2, np.zeros((2000, 2), dtype=bool)
    for slot in range(len(played)):
        for k in range(2):
            played[slot, k] = is_played(schedule[k], slot, generator.uniform(), PARAMETERS)
        for k in range(2):
            heard = [0.0] * int(played[slot, 1 - k] and not played[slot, k])
            given = schedule[k], slot, heard, generator.uniform(), PARAMETERS
            schedule[k] = after_slot(*given, played=bool(played[slot, k]))
    late = played[500:]
    assert late.all(axis=1).mean() < 0.1
    assert late.mean(axis=0).min() > 0.25


def test_a_disputed_slot_is_given_up_sooner_by_who_has_more() -> None:
    draws = np.linspace(0, 0.999, 1000)
    shares = []
    for own in (1, 4, 8):
        mine = tuple(k < own for k in range(8))
        schedule = SlotSchedule(mine, (3,) * 8, (0,) * 8, 5)
        kept = [after_slot(schedule, 0, [0.01], x, PARAMETERS, played=True).mine[0] for x in draws]
        shares.append(1 - np.mean(kept))
    np.testing.assert_allclose(shares, [1 / 1.5, 4 / 4.5, 8 / 8.5], atol=0.002)


def test_a_free_slot_is_taken_sooner_by_who_has_fewer() -> None:
    draws = np.linspace(0, 0.999, 1000)
    for own in (0, 3):
        mine = tuple(0 < k <= own for k in range(8))
        schedule = SlotSchedule(mine, (1,) * 8, (0,) * 8, 5)
        taken = [after_slot(schedule, 0, (), x, PARAMETERS, played=False).mine[0] for x in draws]
        assert np.mean(taken) == pytest.approx(PARAMETERS.claim / (1 + own), abs=0.002)
        too_early = replace(schedule, quiet=(0,) * 8)
        assert not after_slot(too_early, 0, (), 0.06, PARAMETERS, played=False).mine[0]


def test_a_new_slot_is_checked_often_and_a_sure_one_seldom() -> None:
    schedule = SlotSchedule((True,) * 8, (1,) * 8, (0, 9) * 4, 5)
    draws = np.linspace(0, 0.999, 1000)
    silent = [
        1 - np.mean([is_played(schedule, slot, draw, PARAMETERS) for draw in draws])
        for slot in (0, 1)
    ]
    np.testing.assert_allclose(silent, [PARAMETERS.check, PARAMETERS.check_least], atol=0.002)
    heard = after_slot(schedule, 0, (), 0.9, PARAMETERS, played=False)
    assert heard.sure[0] == 1
    assert after_slot(heard, 8, [0.0], 0.99, PARAMETERS, played=False).sure[0] == 0


def test_slots_move_towards_those_of_others() -> None:
    schedule = lone(20)
    for slot in range(20, 60):
        away_s = 0.02 - schedule.shift_s
        schedule = after_slot(schedule, slot, [away_s], 0.5, PARAMETERS, played=False)
    assert schedule.shift_s == pytest.approx(0.02, abs=0.003)


def rounds_of(phones: int, seed: int, slots: int = 1500) -> np.ndarray:
    """Phones with one clock that hear each other only while silent: who chirped (slots, phones)."""
    generator = np.random.default_rng(seed)
    schedule = [medium_access.initial_schedule(PARAMETERS)] * phones
    played = np.zeros((slots, phones), dtype=bool)
    delay = 4
    for slot in range(slots):
        for k in range(phones):
            played[slot, k] = is_played(schedule[k], slot, generator.uniform(), PARAMETERS)
        heard = slot - delay
        for k in range(phones) if heard >= 0 else ():
            own = bool(played[heard, k])
            others = int(played[heard].sum()) - own
            audible = others if not own else int(generator.uniform() < 0.06) * others
            schedule[k] = after_slot(
                schedule[k], heard, [0.0] * audible, generator.uniform(), PARAMETERS, played=own
            )
    return played


@pytest.mark.parametrize("phones", [2, 3, 5])
def test_phones_that_hear_late_find_their_turns(phones: int) -> None:
    played = np.concatenate([rounds_of(phones, seed)[300:] for seed in range(3)])
    alone = played.sum(axis=1) == 1
    clean = (played & alone[:, None]).sum(axis=0) / len(played)
    assert clean.sum() > 0.75
    assert played[~alone].sum() < 0.2 * played.sum()
    assert clean.min() > 0.25 / phones


def sound(arrivals: dict[int, float], seconds: float) -> F32:
    samples = 1e-5 * np.random.default_rng(2).standard_normal(round(seconds * RATE_HZ))
    for start, level in arrivals.items():
        samples[start : start + 441] += level * CHIRP.samples
    return samples.astype(np.float32)


def test_others_are_heard_in_silence_and_their_echoes_are_none() -> None:
    own, other = 9_000, 8_000
    planted = {own: 0.2, own + 900: 0.03, other: 0.01, other + 300: 0.004, 16_000: 0.006}
    envelope = matched_envelope(sound(planted, 0.6), CHIRP)
    slots = [Slot(7_800, 12_210, own, None), Slot(12_210, 16_620, None, None)]
    first, listening = hear_slot(medium_access.CarrierSense(), envelope, 0, slots[0], PARAMETERS)
    second, listening = hear_slot(listening, envelope, 0, slots[1], PARAMETERS)
    third, _ = hear_slot(listening, envelope, 0, Slot(16_620, 21_030, None, None), PARAMETERS)
    assert np.abs(np.array(first) - other).tolist() <= [16]
    assert second == ()
    assert np.abs(np.array(third) - 16_000).tolist() <= [16]


def test_noise_behind_lost_sound_is_nobody() -> None:
    own = [9_000 + 4_410 * k for k in range(8)]
    noisy = sound(dict.fromkeys(own, 0.05), 1.0)
    noisy += 3e-3 * np.random.default_rng(3).standard_normal(len(noisy)).astype(np.float32)
    noisy[own[1] - 2_600 : own[1] - 100] = 0
    envelope = matched_envelope(noisy, CHIRP)
    listening = medium_access.CarrierSense()
    for due, following in pairwise(own):
        slot = Slot(due - 1_000, due + 3_410, due, following)
        others, listening = hear_slot(listening, envelope, 0, slot, PARAMETERS)
        assert others == ()


def test_frames_that_others_chirped_into_are_told() -> None:
    generator = np.random.default_rng(5)
    own = [4_410 * (k + 1) + int(generator.integers(0, 1100)) for k in range(40)]
    planted = dict.fromkeys(own, 0.2)
    planted |= {each + 900: 0.02 for each in own} | {each + 1500: 0.01 for each in own}
    spoiled = {9: 1_200, 17: 2_100, 26: 600, 33: -500}
    planted |= {own[k] + shift: 0.012 for k, shift in spoiled.items()}
    envelope = matched_envelope(sound(planted, 4.4), CHIRP)
    found = medium_access.spoiled_frames(envelope, np.array(own), PARAMETERS)
    assert np.flatnonzero(found).tolist() == sorted(spoiled)


def test_no_frames_are_not_spoiled() -> None:
    assert (
        len(
            medium_access.spoiled_frames(
                np.zeros(100, dtype=np.float32), np.array([], int), PARAMETERS
            )
        )
        == 0
    )
