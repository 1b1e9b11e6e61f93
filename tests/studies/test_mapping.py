"""Mapping errors in small: of walkers, of many mappers, with taps, and among other phones."""

from collections.abc import Iterator

import numpy as np
import pytest

from elfslam.app.settings import Settings
from elfslam.base.values import Fixes, Trajectory, Truth
from elfslam.learn.parameters import ScratchParameters
from elfslam.stages.locate import LocateParameters
from elfslam.world.kinds import QUIET
from elfslam.world.simulate import load_world
from studies import many_mappers, mapping, taps
from studies.contention import measure_contention, together
from studies.crowd import Crowd, crowd_in, heard_by_all
from studies.located import MEDIAN_M
from studies.many_mappers import MAPPED_WAY, _most_similar, measure_many_mappers
from studies.merging import MAP, WALKS
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext
from studies.taps import IN_FRAME, TAP_SIGMA_M, TAPS, measure_taps, tapped


@pytest.fixture(scope="module")
def records() -> Iterator[list[Record]]:
    known = ScratchParameters(steps=2, pairs=16, threads=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping, "CURATED_SEEDS", 101)
        how = {"worlds": ("studio",), "seeds": (100,), "rounds": 2, "kind": QUIET}
        yield mapping.measure_mapping(StudyContext(), scratch=known, **how)


def value(records: list[Record], method: str, walker: str, metric: str = MEDIAN_ALIGNED) -> float:
    wanted = (method, walker, metric)
    [found] = [r.value for r in records if (r.method, r.condition, r.metric) == wanted]
    return found


def test_echoes_straighten_the_walk_and_are_mostly_right(records: list[Record]) -> None:
    for walker in (mapping.CALIBRATED, mapping.UNCALIBRATED):
        assert value(records, "ELF", walker) < 0.8 * value(records, "dead reckoning", walker)
    assert value(records, "ELF", mapping.CALIBRATED, "precision of closures") > 0.8


def test_only_walkers_calibrated_are_curated_as_in_the_paper(records: list[Record]) -> None:
    for method in ("ELF, paper's curation", "wifi, paper's", "magnetic, paper's"):
        assert value(records, method, mapping.CALIBRATED) > 0
        assert (method, mapping.UNCALIBRATED) not in {(r.method, r.condition) for r in records}
    assert {r.scenario for r in records} == {"controlled"}


def test_walkers_differ_by_what_is_known_of_their_steps() -> None:
    for seed, sign in ((4, 1), (5, -1)):
        known = mapping.walkers(seed)
        usual = known[mapping.UNCALIBRATED].motion.step_scale
        ratio = usual / known[mapping.CALIBRATED].motion.step_scale
        assert ratio == pytest.approx(1 + 0.1 * sign)
    assert known[mapping.CALIBRATED].motion.step_scale_sigma < Settings().motion.step_scale_sigma


def test_a_map_turned_about_its_start_is_off_there_and_right_once_aligned() -> None:
    t_s = np.arange(30.0)
    true = np.column_stack([np.cos(t_s), t_s, 0 * t_s])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    xy_m = (true[:, :2] - true[0, :2]) @ turn + true[0, :2]
    turned = np.column_stack([xy_m, 0 * t_s + np.pi / 2])
    found = Trajectory(t_s, turned, np.tile(np.eye(3), (30, 1, 1)), np.zeros(0), "OK")
    errors = mapping.trajectory_errors(found, Truth(t_s, true))
    assert [errors[metric] for metric in mapping.ALIGNED] == pytest.approx([0, 0, 0], abs=1e-9)
    assert errors["median error, declared start (m)"] > 5


COUNT = 4000


def scattered(said_sigma_m: float) -> tuple[Trajectory, Truth]:
    """A walk whose positions err by 0.2 m and say that they err by `said_sigma_m`."""
    generator = np.random.default_rng(0)
    t_s = 0.5 * np.arange(COUNT)
    true = np.column_stack([0.7 * np.arange(COUNT), np.zeros((COUNT, 2))])
    poses = true + np.column_stack([generator.normal(0, 0.2, (COUNT, 2)), np.zeros(COUNT)])
    poses[0] = true[0]
    covariance = np.tile(np.diag([said_sigma_m**2, said_sigma_m**2, 1e-4]), (COUNT, 1, 1))
    return Trajectory(t_s, poses, covariance, [], "OK"), Truth(t_s, true)


def test_right_sigmas_hold_68_and_95_of_a_hundred() -> None:
    found = mapping.trajectory_coverage(*scattered(0.2))
    assert found.one_sigma == pytest.approx(0.683, abs=0.02)
    assert found.two_sigma == pytest.approx(0.954, abs=0.01)
    assert found.nees == pytest.approx(2.0, abs=0.1)


def test_boasting_and_modest_sigmas_are_noticed() -> None:
    boasting, modest = (mapping.trajectory_coverage(*scattered(sigma)) for sigma in (0.1, 0.4))
    assert boasting.one_sigma < 0.45
    assert boasting.nees == pytest.approx(8.0, abs=0.4)
    assert modest.one_sigma > 0.9
    assert modest.nees == pytest.approx(0.5, abs=0.05)


def test_both_walks_are_one_map_and_query_walks_are_found_in_it() -> None:
    records = measure_many_mappers(StudyContext(), kind=QUIET, **many_mappers.STUDY.fast)
    found = {(each.method, each.condition, each.metric): each.value for each in records}
    two, asked = "4 laps, 4 taps", f"4 laps, 4 taps, {MAPPED_WAY}"
    assert found[MAP, two, WALKS] == 2
    assert found[MAP, two, MEDIAN_ALIGNED] < 0.4
    assert found["ELF, track", asked, MEDIAN_M] < 0.5
    assert found["ELF, track", asked, "answered"] > 0.5
    assert found["plain spectrogram, always answered", asked, "answered"] == 1.0


def test_of_several_maps_the_most_similar_answers() -> None:
    def fixes(x_m: float, score: list[float]) -> Fixes:
        count = len(score)
        zeros, spread = np.zeros(count), np.tile(np.eye(2), (count, 1, 1))
        xy_m = np.full((count, 2), x_m)
        return Fixes(np.arange(count), xy_m, zeros, spread, score, zeros.astype(int))

    best = _most_similar([fixes(1.0, [0.9, 0.2, np.nan]), fixes(2.0, [0.1, 0.8, 0.3])])
    assert best.xy_m[:, 0].tolist() == [1.0, 2.0, 2.0]
    assert best.score.tolist() == [0.9, 0.8, 0.3]


@pytest.fixture(scope="module")
def crowd() -> Crowd:
    return crowd_in(load_world("studio"), 3, 107)


def test_the_first_phones_are_the_same_however_many_follow(crowd: Crowd) -> None:
    two = crowd_in(load_world("studio"), 2, 107)
    for ours, theirs in zip(crowd.phones, two.phones, strict=False):
        np.testing.assert_array_equal(ours.motion.position_m, theirs.motion.position_m)
        for told in ("out_s", "in_s", "clock_ppm"):
            assert getattr(ours, told) == getattr(theirs, told)
    assert len({phone.out_s for phone in crowd.phones}) == 3


def test_another_phone_is_heard_after_its_way_and_softer(crowd: Crowd) -> None:
    at_s = np.array([5.0, 8.0, 11.0])
    frames = heard_by_all(crowd, 0, at_s)
    assert frames.shape == (3, 3, 4410)
    t_s = crowd.phones[0].motion.t_s
    rows = (at_s * 100).astype(int) * len(t_s) // round(100 * t_s[-1])
    places = [phone.motion.position_m[rows] for phone in crowd.phones]
    for k in (1, 2):
        way_m = np.linalg.norm(places[k] - places[0], axis=1)
        for row in range(3):
            sound = np.abs(frames[row, k])
            begin = np.argmax(sound > 0.05 * sound.max())
            assert begin >= (way_m[row] - 0.6) / 350 * 44_100
            assert sound.max() < 0.5 * np.abs(frames[row, 0]).max()


def test_echoes_make_a_fix_once_they_are_enough_and_last_long_enough() -> None:
    known = LocateParameters()
    dense = together(np.arange(0, 3, 0.1), known)
    assert [len(rows) for rows in dense] == [6] * 5
    assert [len(rows) for rows in together(np.arange(0, 4, 0.5), known)] == [2] * 4
    assert together(np.array([0.0, 2.1, 4.3]), known) == []


def test_turns_spoil_less_than_chirping_at_will() -> None:
    records = measure_contention(
        StudyContext(), places=("studio",), seeds=(100,), counts=(2,), seconds=30.0,
        mapping_rounds=1,
    )  # fmt: skip
    found = {(each.method, each.metric): each.value for each in records}
    spoiled, clean = "spoiled frames (%)", "clean chirps (1/s)"
    assert found["at will", spoiled] > 20
    assert found["in turns", spoiled] < 0.3 * found["at will", spoiled]
    assert found["in turns", clean] > found["at will", clean]


def test_a_tapped_map_lies_on_the_plan() -> None:
    records = measure_taps(StudyContext(), kind=QUIET, **taps.STUDY.fast)

    def of(metric: str) -> list[float]:
        return [each.value for each in records if each.metric == metric]

    assert np.isfinite(of(IN_FRAME)).all(), "it is on the plan"
    assert of(IN_FRAME)[-1] < 0.4
    assert max(of(MEDIAN_ALIGNED)) < 0.4


def walk_m(length_m: float) -> Truth:
    """A walk along x at 1 m/s."""
    t_s = np.arange(0.0, length_m + 0.05, 0.1)
    return Truth(t_s, np.column_stack([t_s, np.zeros_like(t_s), np.zeros_like(t_s)]))


def test_taps_lie_around_the_walker() -> None:
    told = [tapped(walk_m(100.0), 4, seed) for seed in range(200)]
    off_m = np.array([each.xy_m - np.column_stack([each.t_s, np.zeros(4)]) for each in told])
    assert np.std(off_m) == pytest.approx(TAP_SIGMA_M, rel=0.1)
    assert np.abs(off_m.mean(axis=0)).max() < 0.1


@pytest.mark.parametrize("rounds", [2, 4])
@pytest.mark.parametrize("taps", TAPS[1:])
def test_taps_are_at_different_places_of_the_rounds(rounds: int, taps: int) -> None:
    place = tapped(walk_m(100.0), taps, 0).t_s * rounds / 100.0
    apart = np.abs((place[:, None] - place + 0.5) % 1.0 - 0.5)
    assert apart.max() > 0.2
