"""Floors: no loop closes between two, each is a run of its own, and which one is voted for."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base import values
from elfslam.base.building import Building, Passage
from elfslam.slam.floor_location import floors_by_vote
from elfslam.slam.floors import building_of, floor_runs, gathered_passages
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import Sense, map_by, map_by_echoes
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.feature import load_encoder
from elfslam.stages.levels import SCALE_HEIGHT_M, LevelParameters
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from tests.stages.pressure import STOREY_M, with_stairs

PARAMETERS = Parameters()


@pytest.fixture(scope="module")
def recording() -> values.Recording:
    return simulate(load_world("studio"), seed=107, rounds=4)[0]


@pytest.fixture(scope="module")
def run(recording: values.Recording) -> values.Run:
    climbed = with_stairs(recording, recording.imu.t_s[-1] / 2, 10.0)
    taps = values.Checkpoints(np.array([5.0, 50.0]), ("Door", "Door"))
    return map_by_echoes(replace(climbed, checkpoints=taps), load_encoder("compact"), PARAMETERS)


def test_loops_close_on_one_floor_and_the_whole_has_no_map(run: values.Run) -> None:
    assert run.floor_map is None
    level = run.visited.levels.at(run.trajectory.t_s)
    assert set(level[~np.isnan(level)]) == {0, 1}
    assert (level[run.closures.i] == level[run.closures.j]).all()
    assert len(run.closures.i) > 5


def test_each_floor_is_a_run_with_a_map_in_the_frame_of_the_whole(run: values.Run) -> None:
    parts = floor_runs(run, PARAMETERS)
    assert list(parts) == [0, 1]
    levels = run.visited.levels
    for level, part in parts.items():
        assert part.visited is None
        assert part.floor_map is not None
        rows = np.flatnonzero(levels.at(run.trajectory.t_s) == level)
        npt.assert_array_equal(part.trajectory.t_s, run.trajectory.t_s[rows])
        poses = run.trajectory.world_from_body[rows]
        npt.assert_array_equal(part.trajectory.world_from_body, poses)
        assert (levels.at(part.echoes.t_s) == level).all()
        assert part.similarity.count == len(rows) - 1
        there = part.closures
        npt.assert_array_equal(part.odometry.t_s[there.j] - part.odometry.t_s[there.i] > 5.0, True)
        assert [point.name for point in part.points_of_interest] == ["Door"]
    assert sum(len(part.closures.i) for part in parts.values()) == len(run.closures.i)


def test_the_stairs_join_the_floors_where_they_were_taken(run: values.Run) -> None:
    building = building_of(run, [0, 1])
    (stairs,) = building.passages
    assert (stairs.kind, stairs.from_level, stairs.to_level) == (values.LevelPassage.STAIRS, 0, 1)
    npt.assert_allclose(stairs.duration_s, 10.0, atol=2)
    npt.assert_allclose(building.floors[1].height_m, STOREY_M, atol=0.3)
    assert building_of(run, [0]) == Building(run.name, building.floors[:1])


def test_a_floor_that_is_visited_again_has_a_move_over_the_gap_as_sure_as_those_it_is_for() -> None:
    t_s = np.arange(101) * 0.5
    poses = np.column_stack([0.7 * np.arange(101), np.zeros(101), np.zeros(101)])
    nodes = values.Odometry(t_s, poses, np.tile([0.1, 0.2, 0.01], (100, 1)))
    height_m = STOREY_M * np.interp(t_s, [15, 20, 30, 35], [0, 1, 1, 0])
    barometer = values.Barometer(t_s, 1013 * np.exp(-height_m / SCALE_HEIGHT_M))
    recording = values.Recording("walk", "phone", odometry=nodes, barometer=barometer)
    similar = Sense(
        lambda recording, nodes: values.MeanSimilarity(np.ones((len(nodes.t_s) - 1, 1)), "alike"),
        ClosureParameters(),
    )
    parts = floor_runs(map_by(recording, [similar], PARAMETERS), PARAMETERS)
    gap = int(np.argmax(np.diff(parts[0].odometry.t_s)))
    left_out = round(np.diff(parts[0].odometry.t_s)[gap] / 0.5)
    npt.assert_allclose(parts[0].odometry.step_sigma[gap, 0], 0.1 * np.sqrt(left_out))
    similarity = parts[0].similarity
    assert similarity.count == len(parts[0].odometry.t_s) - 1
    npt.assert_array_equal(similarity.rows(0, gap)[:, gap], 0)
    assert parts[1].floor_map is None


def test_a_walk_on_one_floor_is_as_it_was_without_a_barometer(recording: values.Recording) -> None:
    encoder = load_encoder("spectral")
    bare = map_by_echoes(recording, encoder, PARAMETERS)
    level = map_by_echoes(with_stairs(recording, 1e4, 10.0), encoder, PARAMETERS)
    assert level.visited is None
    npt.assert_array_equal(level.trajectory.world_from_body, bare.trajectory.world_from_body)


STAIRS = Passage(values.LevelPassage.STAIRS, 0, 1, (0.0, 0.0), (4.0, 0.0), 20.0)


def test_passages_that_are_one_become_their_mean() -> None:
    near = replace(STAIRS, from_xy_m=(2.0, 0.0), duration_s=30.0)
    far = replace(STAIRS, to_xy_m=(14.0, 0.0))
    lift = replace(STAIRS, kind=values.LevelPassage.LIFT)
    mean = replace(STAIRS, from_xy_m=(1.0, 0.0), duration_s=25.0)
    assert gathered_passages([STAIRS, far, near, lift]) == (mean, far, lift)


def test_a_lift_joins_all_floors_that_it_stopped_at() -> None:
    low = Passage(values.LevelPassage.LIFT, 0, 3, (5.0, 1.0), (5.5, 1.0), 9.0)
    high = Passage(values.LevelPassage.LIFT, 1, 3, (5.2, 1.0), (5.0, 1.5), 4.0)
    elsewhere = Passage(values.LevelPassage.LIFT, 1, 2, (25.0, 1.0), (25.0, 1.0), 4.0)
    found = gathered_passages([low, high, elsewhere, STAIRS])
    assert found[:4] == (low, high, elsewhere, STAIRS)
    assert [replace(each, to_xy_m=(5.2, 1.0)) for each in found[4:]] == [
        Passage(values.LevelPassage.LIFT, 0, 1, (5.0, 1.0), (5.2, 1.0), 2.5)
    ]


KNOWN = LevelParameters(vote_s=20.0, least_lead=0.05)
T_S = np.arange(100.0)


def test_with_relative_levels_all_vote_on_the_first() -> None:
    relative = np.concatenate([np.zeros(40), np.full(10, np.nan), np.ones(50)])
    scores = np.tile([0.7, 0.7, 0.7], (100, 1))
    scores[relative == 0, 1] += 0.1
    scores[relative == 1, 2] += 0.1
    level, sure = floors_by_vote(T_S, scores, [0, 1, 2], relative, KNOWN)
    npt.assert_array_equal(level, relative + 1)
    assert sure.all()


def test_a_floor_that_no_map_has_is_held_against_a_shift() -> None:
    relative = np.concatenate([np.zeros(50), np.ones(50)])
    scores = np.tile([0.9, 0.6], (100, 1))
    scores[50:] = [0.6, 0.9]
    level, sure = floors_by_vote(T_S, scores, [0, 1], relative, KNOWN)
    npt.assert_array_equal(level, relative)
    assert sure.all()


def test_floors_that_sound_alike_are_not_told_apart() -> None:
    scores = np.tile([0.7, 0.69], (100, 1))
    for relative in (np.zeros(100), None):
        level, sure = floors_by_vote(T_S, scores, [0, 1], relative, KNOWN)
        npt.assert_array_equal(level, 0)
        assert not sure.any()


def test_without_a_barometer_each_moment_is_voted_on_by_those_around_it() -> None:
    scores = np.tile([0.9, 0.6], (100, 1))
    scores[50:] = scores[50:, ::-1]
    scores[20] = [0.0, 1.0]
    scores[70] = np.nan
    level, sure = floors_by_vote(T_S, scores, [0, 3], None, KNOWN)
    npt.assert_array_equal(level[:45], 0)
    npt.assert_array_equal(level[55:], 3)
    assert sure[60:].all()


def test_one_floor_needs_no_vote() -> None:
    level, sure = floors_by_vote(T_S, np.full((100, 1), 0.5), [2], np.zeros(100), KNOWN)
    npt.assert_array_equal(level, 2)
    assert sure.all()
