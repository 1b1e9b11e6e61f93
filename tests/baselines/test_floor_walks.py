"""A planted floor from many walks: its angle is learned, walks astray come home, maps are read."""

from dataclasses import replace

import numpy as np
import pytest
from planted_floor import SIGHTS_M, STEPS, walk_along

from elfslam.base.enums import Modality
from elfslam.base.errors import InputError
from elfslam.base.geometry import wrap_angle
from elfslam.baselines import floor_walks
from elfslam.baselines.maps import rssi_of
from elfslam.stages.motion import MotionParameters, dead_reckon

PARAMETERS = floor_walks.FloorParameters()
BOTH = (Modality.WIFI, Modality.MAGNETIC)


def crossing_walks():
    """From both ends, so that the middle is reached from starts that lie apart."""
    return [walk_along(y_m, backwards=k % 2 == 1) for k, y_m in enumerate((-2.0, -1.8, 1.8, 2.0))]


@pytest.mark.parametrize("turn_rad", [0.0, 0.5, -2.0, 3.0])
def test_the_angle_of_the_floor_is_what_makes_alike_places_meet(turn_rad):
    walks = [floor_walks.turned(walk, turn_rad) for walk in crossing_walks()]
    found = floor_walks.floor_turn(walks, PARAMETERS)
    assert wrap_angle(found.turn_rad + turn_rad) == pytest.approx(0.0, abs=0.02)
    assert found.sigma_rad < 0.05


def test_walks_that_were_declared_stay_and_tell_the_angle_to_the_others():
    walks = crossing_walks()
    declared = [replace(walk, by_compass=False) for walk in walks[:2]]
    undeclared = [floor_walks.turned(walk, 0.7) for walk in walks[2:]]
    found = floor_walks.floor_turn([*declared, *undeclared], PARAMETERS)
    assert found.turn_rad == pytest.approx(-0.7, abs=0.05)


def test_where_nothing_tells_the_angle_its_sigma_says_so():
    declared = [replace(walk, by_compass=False) for walk in crossing_walks()]
    assert floor_walks.floor_turn(declared, PARAMETERS).sigma_rad == np.inf
    alone = floor_walks.floor_turn(crossing_walks()[:1], PARAMETERS)
    assert (alone.turn_rad, alone.sigma_rad) == (0.0, np.inf)


def test_a_walk_is_turned_about_its_start():
    walk = walk_along(-1.0, shift_m=(3.0, 4.0))
    away = floor_walks.turned(walk, 0.5)
    assert away.nodes.world_from_body[0, :2] == pytest.approx(walk.nodes.world_from_body[0, :2])
    back = floor_walks.turned(away, -0.5).nodes.world_from_body
    assert back == pytest.approx(walk.nodes.world_from_body)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_walk_is_headed_as_its_phone_says(backwards):
    walk = walk_along(0.0, backwards=backwards)
    lost = floor_walks.turned(walk, 1.3)
    assert floor_walks.compass_turn(walk.recording.orientation, lost.nodes) == pytest.approx(-1.3)
    found = floor_walks.heading_by_phone(lost, MotionParameters())
    assert found.nodes.world_from_body[:, :2] == pytest.approx(walk.nodes.world_from_body[:, :2])
    north = MotionParameters(magnetic_north_rad=np.pi / 2 + 0.4)
    known = floor_walks.heading_by_phone(lost, north).nodes.world_from_body
    assert known == pytest.approx(floor_walks.turned(walk, 0.4).nodes.world_from_body)


def test_what_tells_no_heading_is_refused():
    walk = walk_along(0.0)
    mute = replace(walk.recording, orientation=None, magnetometer=None)
    with pytest.raises(InputError, match="neither orientation nor magnetometer"):
        floor_walks.heading_by_phone(replace(walk, recording=mute), MotionParameters())
    with pytest.raises(InputError, match="no inertial data"):
        floor_walks.floor_walk(replace(mute, imu=None), MotionParameters())


def test_similarity_is_of_different_walks_and_symmetric():
    similarity = floor_walks.wifi_scores_between(crossing_walks(), PARAMETERS.wifi)
    assert similarity == pytest.approx(similarity.T)
    assert (similarity[:13, :13] == 0).all()
    assert similarity[:13, 13:].max() > 0.9


def test_a_walk_without_scans_is_like_no_other():
    walks = crossing_walks()
    walks[1] = replace(walks[1], recording=replace(walks[1].recording, wifi=None))
    similarity = floor_walks.wifi_scores_between(walks, PARAMETERS.wifi)
    assert (similarity[13:26] == 0).all()
    assert similarity[:13].max() > 0.7


@pytest.mark.parametrize("by", [BOTH[:1], BOTH], ids=["wifi", "both"])
def test_a_walk_that_bends_away_is_pulled_back_by_the_others(by):
    walks = crossing_walks()
    bent_rad = np.linspace(0, 0.3, STEPS)
    poses = walks[0].nodes.world_from_body.copy()
    poses[:, 1] += 36 * bent_rad**2
    poses[:, 2] += bent_rad
    sigma = np.full((STEPS - 1, 3), 0.2)
    nodes = replace(walks[0].nodes, world_from_body=poses, step_sigma=sigma)
    walks[0] = replace(walks[0], nodes=nodes)
    trajectories, joined = floor_walks.solved(walks, by, PARAMETERS)
    assert joined == 1.0
    aside_m = np.abs(trajectories[0].world_from_body[:, 1] + 2.0)
    assert aside_m[-1] < 0.8 * abs(poses[-1, 1] + 2.0)
    assert [len(each.t_s) for each in trajectories] == [STEPS] * 4


def test_the_map_has_a_spot_for_every_stretch_and_what_is_heard_there():
    walks = crossing_walks()
    mute = replace(walks[1], recording=replace(walks[1].recording, wifi=None))
    walks[1] = mute
    trajectories, _ = floor_walks.solved(walks, (Modality.MAGNETIC,), PARAMETERS)
    made = floor_walks.floor_map(walks, trajectories, BOTH, PARAMETERS)
    assert len(made.xy_m) == 4 * (STEPS - 1)
    assert made.walk.tolist() == np.repeat(np.arange(4), STEPS - 1).tolist()
    heard = rssi_of(made, PARAMETERS.wifi)
    assert heard.bssids == tuple("abcdefgh")
    strongest = SIGHTS_M[heard.rssi_dbm[made.walk != 1].argmax(axis=1), 0]
    assert np.abs(strongest - made.xy_m[made.walk != 1, 0]).max() < 8.0
    assert (heard.rssi_dbm[made.walk == 1] == PARAMETERS.wifi.floor_dbm).all()
    without = replace(mute, recording=replace(mute.recording, magnetometer=None))
    with pytest.raises(InputError, match="no magnetometer"):
        floor_walks.floor_map([without], trajectories[1:2], BOTH, PARAMETERS)


@pytest.mark.real
def test_a_declared_walk_is_dead_reckoned_from_there(shared_data):
    from studies.mall_floor import archive_of, surveyed_walks

    (walk,) = surveyed_walks(archive_of(shared_data, "F1"), 1)
    assert walk.by_compass
    declared = replace(walk.recording, start_pose=(5.0, 6.0, 0.3))
    known = floor_walks.floor_walk(declared, MotionParameters())
    assert not known.by_compass
    as_declared = dead_reckon(declared.imu, MotionParameters(), (5.0, 6.0, 0.3))
    assert known.nodes.world_from_body == pytest.approx(as_declared.world_from_body)
