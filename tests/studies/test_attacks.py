"""Attacks laid over a walk: what is planted arrives where it should, and the study tells of it."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.app.settings import Settings
from elfslam.base.values import Recording
from elfslam.slam.front_end import extract_query_echoes
from elfslam.stages.echo import matched_envelope
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import load_world
from studies import attack_sounds, attacks
from studies.attacked_walk import PERIOD, RATE_HZ, Walked, recorded, walked
from studies.attacks import APART_S, measure_attacks, poisson_interval, summarised
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def walk() -> Walked:
    return walked(load_world("studio"), 100, 1, 0.025)


@pytest.fixture(scope="module")
def victim(walk: Walked) -> attack_sounds.Victim:
    other = walked(load_world("studio"), 101, 1, 0.025)
    return attack_sounds.Victim(walk, other, np.array([2.0, 3.0, 1.2]), 0)


def test_chirps_arrive_when_the_schedule_says(walk: Walked) -> None:
    envelope = matched_envelope(recorded(walk).samples[0], walk.chirp)
    direct = walk.played + round(walk.device.separation_m / walk.air.speed_mps * RATE_HZ)
    windows = envelope[direct[:, None] + np.arange(-400, 400)]
    npt.assert_allclose(windows.argmax(axis=1), 400, atol=2)
    offsets = (walk.played - walk.played[0]) % PERIOD
    assert len(np.unique(offsets)) > 100
    with_rhythm = walked(load_world("studio"), 100, 1, 0.0)
    assert set(np.diff(with_rhythm.played)) == {PERIOD}


@pytest.mark.parametrize("name", attack_sounds.SOUNDS)
def test_an_attack_is_silent_before_its_onset(victim: attack_sounds.Victim, name: str) -> None:
    sound = attack_sounds.SOUNDS[name](victim, 0.0)
    assert len(sound) == len(victim.walked.own)
    assert np.abs(sound[: victim.onset - PERIOD]).max() == 0
    assert np.abs(sound[victim.onset :]).max() > 1e-4


def test_a_replayed_chirp_comes_the_way_there_and_back_later(victim: attack_sounds.Victim) -> None:
    replayed = attack_sounds.replayed_chirps(victim, 0.0, after_s=0.015)
    envelope = matched_envelope(replayed, victim.walked.chirp)
    k = int(np.searchsorted(victim.walked.played, victim.onset)) + 5
    way_s = 2 * victim.away_m[k] / victim.walked.air.speed_mps + 0.015
    due = victim.walked.played[k] + round(way_s * RATE_HZ)
    assert envelope[due - 4 : due + 5].max() > 0.5 * envelope[due - 1000 : due + 1000].max()


@pytest.fixture(scope="module")
def by_chance() -> attack_sounds.Victim:
    """Chirps of random loudness; the walk that is replayed is of another phone, all alike."""
    place = load_world("studio")
    walk = walked(place, 100, 2, 0.025, Circumstances(softer_db=4.0))
    return attack_sounds.Victim(walk, walked(place, 101, 2, 0.025), np.array([2.0, 3.0, 1.2]), 0)


def test_chirps_are_softer_by_chance(walk: Walked, by_chance: attack_sounds.Victim) -> None:
    assert walk.gain_db is None
    gain_db = by_chance.walked.gain_db
    assert set(gain_db.tolist()) == {0.0, -4.0}
    direct = by_chance.walked.played[:, None] + np.arange(20, 200)
    level_db = 20 * np.log10(by_chance.walked.own[direct].std(axis=1))
    assert np.polyfit(gain_db, level_db, 1)[0] == pytest.approx(1.0, abs=0.05)


def test_who_feels_the_chirps_is_as_loud_as_they_are(by_chance: attack_sounds.Victim) -> None:
    victim, gain_db = by_chance, by_chance.walked.gain_db
    plain = attack_sounds.echoes_of_elsewhere(victim, 0.0)
    follows = attack_sounds.following_echoes(victim, 0.0)
    fresh = victim.walked.played[victim.walked.played >= victim.onset][:-1]
    rows = fresh[:, None] + np.arange(500, 3000)
    factor_db = 20 * np.log10(np.abs(follows[rows]).sum(axis=1) / np.abs(plain[rows]).sum(axis=1))
    assert np.corrcoef(factor_db, gain_db[-len(fresh) - 1 : -1])[0, 1] > 0.9


@pytest.mark.parametrize("sound", [None, attack_sounds.echoes_of_elsewhere])
def test_echoes_of_elsewhere_are_told_by_their_loudness(
    by_chance: attack_sounds.Victim, sound: attack_sounds.Sound | None
) -> None:
    walk = by_chance.walked
    audio = recorded(walk, None if sound is None else sound(by_chance, 0.0))
    heard = Recording(
        "walk", "phone", audio=audio, imu=walk.imu, played_t_s=walk.played_t_s,
        gain_db=walk.gain_db,
    )  # fmt: skip
    _, suspicious = extract_query_echoes(heard, Settings())
    edges_s = np.arange(0.0, walk.truth.t_s[-1], 0.5)
    suspect = suspicious(edges_s)
    begun_s = by_chance.onset / RATE_HZ
    assert not suspect[edges_s[1:] <= begun_s].any()
    assert (suspect[edges_s[1:] >= begun_s + 4.0] == (sound is not None)).all()


def test_the_own_chirp_is_muffled_from_the_onset_on(victim: attack_sounds.Victim) -> None:
    plain = recorded(victim.walked).samples[0]
    muffled = recorded(victim.walked, own_gain=0.01, since=victim.onset).samples[0]
    npt.assert_allclose(muffled[: victim.onset], plain[: victim.onset], atol=1e-6)
    assert np.abs(muffled[victim.onset :]).max() < 0.05 * np.abs(plain).max()


def test_the_interval_of_a_count_is_garwoods() -> None:
    assert poisson_interval(0) == pytest.approx((0.0, 3.6889), abs=1e-4)
    assert poisson_interval(10) == pytest.approx((4.7954, 18.3904), abs=1e-4)


def test_alarms_close_together_are_one() -> None:
    t_s = np.arange(0.0, 60.0, 0.5)
    suspect = np.isin(t_s, [3.0, 3.5, 6.0, 6.0 + APART_S + 1, 40.0])
    assert attacks._alarms(t_s, suspect) == 3
    assert attacks._alarms(t_s, np.zeros(len(t_s), bool)) == 0


def test_a_small_study_tells_an_attack_from_an_honest_walk() -> None:
    heard: list[str] = []
    records = measure_attacks(
        StudyContext(announce=lambda text, share: heard.append(text)),
        worlds={"studio": 1},
        seeds=(100,),
        levels_db=(10.0,),
        kinds=("alone", "chirps, own rhythm"),
        mapping_rounds=1,
    )
    found = {(each.method, each.condition, each.metric): each.value for each in records}
    attack = ("chirps, own rhythm", "10 dB")
    assert found[*attack, "attacks detected (%), tracker"] == 100
    assert 0 < found[*attack, "median delay (s), tracker"] < 3
    assert found[*attack, "wrong fixes (%), tracker"] == 0
    assert found["honest walk", "alone", "false alarms (1/h), tracker"] == 0
    assert heard[-1] == "2 of 2 repeats"


def attacked(delay_s: float) -> list[Record]:
    return [Record("x", "delay (s), tracker", delay_s, condition="0 dB"),
            Record("x", "wrong fixes (%), tracker", delay_s / 2, condition="0 dB")]  # fmt: skip


def test_what_is_rarely_detected_has_no_delay() -> None:
    rare = [attacked(np.inf), attacked(np.inf), attacked(2.0)]
    found = {each.metric: each.value for each in summarised(rare, Record("", "", 0.0))}
    assert found["attacks detected (%), tracker"] == pytest.approx(100 / 3)
    assert "median delay (s), tracker" not in found
    known = [attacked(2.0), attacked(3.0), attacked(9.0)]
    found = {each.metric: each.value for each in summarised(known, Record("", "", 0.0))}
    assert found["median delay (s), tracker"] == 3.0
    assert found["wrong fixes (%), tracker"] == pytest.approx(7 / 3)


def test_alarms_of_all_honest_walks_are_counted_together_but_for_other_phones() -> None:
    walks = [
        [Record("honest walk", f"{name}, tracker", value, condition=what)
         for name, value in (("alarms", alarms), ("hours", 0.5))]
        for what, alarms in (("alone", 1.0), ("music", 0.0), ("1 other phone", 7.0))
    ]  # fmt: skip
    found = {each.condition: each for each in summarised(walks, Record("", "", 0.0))}
    assert found["1 other phone"].value == 14.0
    assert found["all but other phones"].value == 1.0
    assert found["all but other phones"].high == pytest.approx(5.57, abs=0.01)
