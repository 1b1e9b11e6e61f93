"""The study of dead reckoning on a few short walks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Truth
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate
from studies import dead_reckoning as study
from studies.study import StudyContext


def quiet(what: str, share: float | None) -> None:
    """Nobody listens."""


@pytest.fixture(scope="module")
def walks() -> list[study.ReckonedWalk]:
    """Two rounds of the studio, with waypoints in a plane that is turned against north."""
    made = []
    for seed in (100, 101, 102):
        how = {"rounds": 2, "sound": False, "sensors": (Sensor.MAGNETIC,)}
        recording, truth = simulate(load_world("studio"), seed, **how)
        poses = truth.world_from_body[::200].copy()
        poses[:, :2] = poses[:, :2] @ Rotation.from_euler("z", -0.4).as_matrix()[:2, :2]
        poses[:, 2] = np.nan
        waypoints = Truth(truth.t_s[::200], poses)
        given = recording.imu, waypoints, recording.magnetometer
        made.append(study.ReckonedWalk(str(seed), *given, 0.0))
    return made


def test_one_angle_turns_north_into_the_plane_of_the_truth(walks: list[study.ReckonedWalk]) -> None:
    ends = study._scored(walks, study.COMPASS)
    assert np.median(ends) < 0.1
    unturned = study._scored(walks, study.UNTURNED)
    assert np.median(unturned) > 1.5 * np.median(ends)
    apart = [replace(walk, truth=turned(walk.truth, 0.8 * k)) for k, walk in enumerate(walks)]
    assert max(study._scored(apart, study.COMPASS)) > max(ends)


def turned(truth: Truth, angle_rad: float) -> Truth:
    poses = truth.world_from_body.copy()
    poses[:, :2] = poses[:, :2] @ Rotation.from_euler("z", angle_rad).as_matrix()[:2, :2]
    return Truth(truth.t_s, poses)


def test_a_tilted_or_resampled_phone_walks_the_same_way(walks: list[study.ReckonedWalk]) -> None:
    base = study._scored(walks, study.COMPASS)
    changes = lambda walk: study.tilted(walk, 60.0, 20.0), lambda walk: study.resampled(walk, 60.0)
    for change in changes:
        other = study._scored([change(walk) for walk in walks], study.COMPASS)
        assert other == pytest.approx(base, abs=0.03)


def test_the_study_needs_no_real_walks() -> None:
    records = study.measure_dead_reckoning(StudyContext(), seeds=1, worlds=("concourse",))
    assert {each.world for each in records} == {"concourse", "simulated", study.SLOW}
    nees = [each.value for each in records if each.metric == "NEES"]
    assert nees
    assert max(nees) < 4, "2 where the reported sigmas are right; simulated steps err less"


def test_every_way_is_measured_on_floors(
    walks: list[study.ReckonedWalk], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "CHANGES", {"60 Hz": study.CHANGES["60 Hz"]})
    records = list(study._of_floors({"A": walks[:2], "B": walks[2:]}))
    ends = [each for each in records if each.metric == "end error (%)"]
    assert len(ends) == 3 * (5 + 1 + 1)
    assert all(one.low <= one.value <= one.high for one in ends)


def test_true_directions_and_length_leave_less_than_either(walks: list[study.ReckonedWalk]) -> None:
    left = {each.method: each.value for each in study._error_sources("A", walks)}
    as_it_is = 100 * np.median(study._scored(walks, study.COMPASS_KNOWN))
    assert left["as it is"] == pytest.approx(as_it_is)
    both = left["true directions of legs and whole length"]
    assert both < left["true direction of every leg"]


def test_a_planted_half_turn_is_told_of_real_walks(walks: list[study.ReckonedWalk]) -> None:
    told = {each.metric: each.value for each in study._half_turns("A", walks)}
    assert told == {study.TURN_TOLD: 100, study.TURN_NEAR: 100, study.TURN_FALSE: 0}


def test_a_folder_without_walks_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="holds no mall_walks"):
        dict(study.mall_floors(tmp_path, None, quiet))


TRUE_M = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [25.0, 5.0]])


def off_by(angle_rad: float) -> F64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return TRUE_M @ np.array([[cos, sin], [-sin, cos]])


def test_a_wrong_scale_is_cured_by_lengths_alone() -> None:
    found = study.end_errors(1.2 * TRUE_M, TRUE_M)
    assert found["as it is"] == pytest.approx(0.2 * np.hypot(25, 5) / 30)
    assert found["true whole length"] == pytest.approx(0, abs=1e-9)
    assert found["true length of every leg"] == pytest.approx(0, abs=1e-9)
    assert found["true heading of the whole walk"] == pytest.approx(found["as it is"])
    assert found["true direction of every leg"] == pytest.approx(found["as it is"])


def test_a_wrong_heading_is_cured_by_directions_alone() -> None:
    found = study.end_errors(off_by(0.3), TRUE_M)
    assert found["as it is"] == pytest.approx(2 * np.sin(0.15) * np.hypot(25, 5) / 30)
    assert found["true whole length"] == pytest.approx(found["as it is"])
    assert found["true length of every leg"] == pytest.approx(found["as it is"])
    assert found["true heading of the whole walk"] == pytest.approx(0, abs=1e-9)
    assert found["true direction of every leg"] == pytest.approx(0, abs=1e-9)


def test_one_bent_leg_is_cured_by_directions_of_legs() -> None:
    bent = TRUE_M.copy()
    bent[3] = [10 + 15 * np.cos(0.5), 5 + 15 * np.sin(0.5)]
    found = study.end_errors(bent, TRUE_M)
    assert found["true heading of the whole walk"] > 0.02
    assert found["true direction of every leg"] == pytest.approx(0, abs=1e-9)


def test_slow_walkers_paths_are_within_an_eighth_by_their_walk_ratio() -> None:
    walks = list(study.slow_walks(range(100, 106)))
    found = {each.method: each for each in study._step_lengths("slow", walks)
             if each.metric == study.LENGTH_ERROR}  # fmt: skip
    joined, alone = (found[each].value for each in study.LENGTHS)
    assert joined < 0.75 * alone
    assert joined < 12
