"""Noisy phones in miniature: false closures as planted, and what the correction gives back."""

import numpy as np
import pytest

from elfslam.app.settings import Settings
from elfslam.base.values import Closures, Echoes, Features, Odometry, Trajectory, Truth
from elfslam.world.kinds import QUIET
from studies.localization import ALWAYS_ANSWERED
from studies.located import MEDIAN_M
from studies.noisy_phones import (
    ANSWERED,
    CORRECTED,
    FALSE,
    FOUND,
    KEPT,
    OVER_NOISE,
    PHONES,
    STUDY,
    UNCORRECTED,
    WALKED,
    Mapped,
    Walked,
    _fixes,
    _map_numbers,
    _walk_numbers,
    measure_noisy_phones,
)
from studies.plain_features import ELF, PLAIN
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext

QUIETER, NOISY = PHONES[:2]


@pytest.fixture(scope="module")
def records() -> list[Record]:
    """Two phones of a surveyor in the controlled scenario."""
    return measure_noisy_phones(StudyContext(), kind=QUIET, **STUDY.fast)


def value(records: list[Record], method: str, condition: str, metric: str) -> float:
    wanted = (method, condition, metric)
    (found,) = [r.value for r in records if (r.method, r.condition, r.metric) == wanted]
    return found


def test_a_closure_that_was_dropped_counts_as_none_and_one_of_two_places_as_false() -> None:
    t_s = np.arange(20.0)
    poses = np.column_stack([np.minimum(t_s, 19.0 - t_s), np.zeros((20, 2))])
    truth, nodes = Truth(t_s, poses), Odometry(t_s, poses, np.full((19, 3), 0.1))
    ends = (np.array([1, 3, 2]), np.array([18, 16, 10]))
    closures = Closures(*ends, np.ones(3), np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)))
    weights = np.array([1.0, 0.0, 1.0])
    trajectory = Trajectory(t_s, poses, np.tile(np.eye(3), (20, 1, 1)), weights, "OK")
    features = Features(t_s, np.ones((20, 1), np.float32), "planted")
    walk = Walked(
        nodes, Echoes(t_s, np.zeros((20, 2352), np.float32), np.zeros((0, 2))), Settings(), truth
    )
    found = _map_numbers(Mapped(walk, features, closures, trajectory))
    assert (found[KEPT], found[FALSE]) == (2, 1)
    assert found[MEDIAN_ALIGNED] == pytest.approx(0.0, abs=1e-9)


def test_a_phone_in_which_no_chirp_is_found_maps_nothing_and_is_nowhere() -> None:
    assert _walk_numbers(None) == {FOUND: 0.0}
    assert list(_fixes({}, None)) == [(ELF, {ANSWERED: 0.0})]


def test_the_correction_gives_a_noisy_phone_closures_and_a_quiet_one_nothing(
    records: list[Record],
) -> None:
    def kept(phone: str) -> list[float]:
        return [value(records, f"{ELF}, {how}", phone, KEPT) for how in (UNCORRECTED, CORRECTED)]

    noise = [value(records, WALKED, phone, OVER_NOISE) for phone in (QUIETER, NOISY)]
    assert noise[0] > noise[1] + 6
    assert kept(QUIETER)[0] == kept(QUIETER)[1] > 0
    assert kept(NOISY)[0] < kept(NOISY)[1]
    assert value(records, f"{ELF}, {CORRECTED}", NOISY, FALSE) == 0
    by_elf, walked = (
        value(records, method, NOISY, MEDIAN_ALIGNED) for method in (f"{ELF}, {CORRECTED}", WALKED)
    )
    assert by_elf < walked


def test_a_noisy_phone_is_located_in_the_map_of_a_quiet_one_and_in_its_own(
    records: list[Record],
) -> None:
    for whose in (f"the map by {QUIETER}", "its own map"):
        assert 0 <= value(records, ELF, f"{NOISY} in {whose}", ANSWERED) < 1
        for feature in (ELF, PLAIN):
            always = (ALWAYS_ANSWERED.format(feature), f"{NOISY} in {whose}")
            assert value(records, *always, ANSWERED) == 1
            assert value(records, *always, MEDIAN_M) < 3
