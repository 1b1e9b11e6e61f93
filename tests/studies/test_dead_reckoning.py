"""The study of dead reckoning on a few short walks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from elfslam.base.errors import InputError
from elfslam.base.values import Truth
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate
from studies import dead_reckoning as study
from studies.dead_reckoning import measure_dead_reckoning
from studies.finding import Given
from studies.reckoned_walks import ReckonedWalk, mall_floors, resampled, tilted


def quiet(what: str, share: float | None) -> None:
    """Nobody listens."""


@pytest.fixture(scope="module")
def walks() -> list[ReckonedWalk]:
    """Two rounds of the studio, with waypoints in a plane that is turned against north."""
    made = []
    for seed in (100, 101, 102):
        recording, truth = simulate(
            load_world("studio"), seed, rounds=2, sound=False, sensors=(Sensor.MAGNETIC,)
        )
        assert recording.imu is not None
        poses = truth.world_from_body[::200].copy()
        poses[:, :2] = poses[:, :2] @ Rotation.from_euler("z", -0.4).as_matrix()[:2, :2]
        poses[:, 2] = np.nan
        waypoints = Truth(truth.t_s[::200], poses)
        made.append(ReckonedWalk(str(seed), recording.imu, waypoints, recording.magnetometer, 0.0))
    return made


def test_rows_cover_headings_and_changes(
    walks: list[ReckonedWalk], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "CHANGES", {"60 Hz": study.CHANGES["60 Hz"]})
    monkeypatch.setattr("elfslam.scoring.bootstrap.RESAMPLES", 50)
    rows = list(study._real_rows({"A": walks[:2], "B": walks[2:]}))
    assert len(rows) == 3 * (5 + 1 + 1)
    assert [row["walks"] for row in rows[:3]] == [2, 1, 3]
    for row in rows:
        assert row["from"] <= row["end error (%)"] <= row["to"]  # type: ignore[operator]
    taught = [row for row in rows if "length known" in str(row["heading from"])]
    assert taught[-1]["scale spread"] <= rows[2]["scale spread"]  # type: ignore[operator]


def test_one_angle_turns_north_into_the_plane_of_the_truth(walks: list[ReckonedWalk]) -> None:
    ends = [one.end_share for one in study._scored(walks, study.COMPASS)]
    assert np.median(ends) < 0.1
    unturned = [one.end_share for one in study._scored(walks, study.UNTURNED)]
    assert np.median(unturned) > 2 * np.median(ends)
    apart = [replace(walk, truth=turned(walk.truth, 0.8 * k)) for k, walk in enumerate(walks)]
    assert max(one.end_share for one in study._scored(apart, study.COMPASS)) > max(ends)


def turned(truth: Truth, angle_rad: float) -> Truth:
    poses = truth.world_from_body.copy()
    poses[:, :2] = poses[:, :2] @ Rotation.from_euler("z", angle_rad).as_matrix()[:2, :2]
    return Truth(truth.t_s, poses)


def test_a_tilted_or_resampled_phone_walks_the_same_way(walks: list[ReckonedWalk]) -> None:
    base = study._scored(walks, study.COMPASS)
    for change in (lambda walk: tilted(walk, 60.0, 20.0), lambda walk: resampled(walk, 60.0)):
        other = study._scored([change(walk) for walk in walks], study.COMPASS)
        for one, two in zip(base, other, strict=True):
            assert two.scale == pytest.approx(one.scale, abs=0.02)
            assert two.end_share == pytest.approx(one.end_share, abs=0.03)


def test_the_study_needs_no_real_walks() -> None:
    finding = measure_dead_reckoning(Given(), seeds=1, worlds=("studio",))
    names = {row["walks of"] for row in finding.rows}
    assert names == {"studio, 100 Hz", "studio, 60 Hz", "simulated"}
    assert all(list(row) == list(finding.rows[0]) for row in finding.rows)
    assert finding.page is not None
    assert "NEES" in str(finding.page.panels[-1].body)


def test_true_directions_and_length_leave_less_than_either(walks: list[ReckonedWalk]) -> None:
    rows = list(study._source_rows({"A": walks}))
    left = {str(row["truth in place of"]): float(str(row["end error (%)"])) for row in rows}
    scored = study._scored(walks, study.COMPASS_KNOWN)
    assert left["nothing"] == round(100 * float(np.median([one.end_share for one in scored])), 2)
    assert left["directions of legs, whole length"] < left["the direction of every leg"]


def test_walks_are_drawn_from_their_true_start(walks: list[ReckonedWalk]) -> None:
    for drawn in study._drawn(walks):
        np.testing.assert_allclose(drawn.true_m[0], drawn.reckoned_m[0], atol=1e-9)


def test_a_folder_without_walks_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match="holds no mall_walks"):
        dict(mall_floors(tmp_path, None, quiet))
