"""Mapping errors in small: echoes help, walkers differ, and errors lie where they were planted."""

from collections.abc import Iterator

import numpy as np
import pytest

from elfslam.app.settings import Settings
from elfslam.base.values import Trajectory, Truth
from elfslam.learn.parameters import ScratchParameters
from elfslam.world.kinds import QUIET
from studies import mapping
from studies.mapping import (
    ALIGNED,
    CALIBRATED,
    MEDIAN_ALIGNED,
    UNCALIBRATED,
    measure_mapping,
    trajectory_coverage,
    trajectory_errors,
    walkers,
)
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records() -> Iterator[list[Record]]:
    known = ScratchParameters(steps=2, pairs=16, threads=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping, "CURATED_SEEDS", 101)
        yield measure_mapping(
            StudyContext(), worlds=("studio",), seeds=(100,), rounds=2, kind=QUIET, scratch=known
        )


def value(records: list[Record], method: str, walker: str, metric: str = MEDIAN_ALIGNED) -> float:
    wanted = (method, walker, metric)
    [found] = [r.value for r in records if (r.method, r.condition, r.metric) == wanted]
    return found


def test_echoes_straighten_the_walk_and_are_mostly_right(records: list[Record]) -> None:
    for walker in (CALIBRATED, UNCALIBRATED):
        assert value(records, "ELF", walker) < 0.8 * value(records, "dead reckoning", walker)
    assert value(records, "ELF", CALIBRATED, "precision of closures") > 0.8


def test_only_walkers_calibrated_are_curated_as_in_the_paper(records: list[Record]) -> None:
    for method in ("ELF, paper's curation", "wifi, paper's", "magnetic, paper's"):
        assert value(records, method, CALIBRATED) > 0
        assert (method, UNCALIBRATED) not in {(r.method, r.condition) for r in records}
    assert {r.scenario for r in records} == {"controlled"}


def test_walkers_differ_by_what_is_known_of_their_steps() -> None:
    for seed, sign in ((4, 1), (5, -1)):
        known = walkers(seed)
        ratio = known[UNCALIBRATED].motion.step_scale / known[CALIBRATED].motion.step_scale
        assert ratio == pytest.approx(1 + 0.1 * sign)
    assert known[CALIBRATED].motion.step_scale_sigma < Settings().motion.step_scale_sigma


def test_a_map_turned_about_its_start_is_off_there_and_right_once_aligned() -> None:
    t_s = np.arange(30.0)
    true = np.column_stack([np.cos(t_s), t_s, 0 * t_s])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    turned = np.column_stack(
        [(true[:, :2] - true[0, :2]) @ turn + true[0, :2], 0 * t_s + np.pi / 2]
    )
    found = Trajectory(t_s, turned, np.tile(np.eye(3), (30, 1, 1)), np.zeros(0), "OK")
    errors = trajectory_errors(found, Truth(t_s, true))
    assert [errors[metric] for metric in ALIGNED] == pytest.approx([0, 0, 0], abs=1e-9)
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
    found = trajectory_coverage(*scattered(0.2))
    assert found.one_sigma == pytest.approx(0.683, abs=0.02)
    assert found.two_sigma == pytest.approx(0.954, abs=0.01)
    assert found.nees == pytest.approx(2.0, abs=0.1)


def test_boasting_and_modest_sigmas_are_noticed() -> None:
    boasting, modest = trajectory_coverage(*scattered(0.1)), trajectory_coverage(*scattered(0.4))
    assert boasting.one_sigma < 0.45
    assert boasting.nees == pytest.approx(8.0, abs=0.4)
    assert modest.one_sigma > 0.9
    assert modest.nees == pytest.approx(0.5, abs=0.05)
