"""What the line is given of a walk: footsteps, echoes, and one-line refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose
from elfslam.base.parameters import load
from elfslam.base.values import Audio, Odometry, Recording
from elfslam.line.feature import Encoder, load_encoder
from elfslam.slam.front_end import hear, hear_for_fixes, walk_nodes, with_heard_steps
from elfslam.slam.parameters import Parameters
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world

PARAMETERS = Parameters()


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(load_world("studio"), seed=7, rounds=2)[0]


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    return load_encoder("compact")


def test_a_walk_at_48_khz_gives_the_same_echoes(encoder: Encoder) -> None:
    slow, fast = (
        hear(simulate(load_world("studio"), 7, rounds=1, rate_hz=rate_hz)[0], PARAMETERS)
        for rate_hz in (44_100, 48_000)
    )
    count = min(len(slow.t_s), len(fast.t_s))
    assert count > 100
    npt.assert_allclose(slow.t_s[:count], fast.t_s[:count], atol=1e-3)
    same = np.sum(encoder.embed(slow.samples[:count]) * encoder.embed(fast.samples[:count]), axis=1)
    assert np.median(same) > 0.9


def test_lost_sound_is_measured_against_the_motion_sensors(recording: Recording) -> None:
    assert recording.audio is not None
    samples = recording.audio.samples[:, : -2 * 44_100]
    shorter = dataclasses.replace(recording, audio=Audio(samples, 44_100))
    with pytest.raises(InputError, match=r"1.99 s shorter than the motion and nothing tells where"):
        hear(shorter, PARAMETERS)
    ended_early = load(PARAMETERS, None, ["echo.shortfall_s=2.5"])
    assert len(hear(shorter, ended_early).losses_s) == 0
    blind = hear(dataclasses.replace(shorter, imu=None), PARAMETERS)
    assert len(blind.losses_s) == 0


def test_nodes_are_footsteps_from_the_start_pose(recording: Recording) -> None:
    placed = dataclasses.replace(recording, start_pose=(3.0, -2.0, 1.0))
    nodes = walk_nodes(placed, PARAMETERS)
    unplaced = walk_nodes(recording, PARAMETERS).world_from_body
    npt.assert_allclose(nodes.world_from_body, compose(np.array([3.0, -2.0, 1.0]), unplaced))
    assert 0.1 < np.hypot(*unplaced[0, :2]) < 0.6
    steps_m = np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1)
    assert 0.4 < np.median(steps_m) < 1.0


def straight_odometry() -> Odometry:
    """A device that brings its own odometry: 10 m straight ahead in steps of 10 cm."""
    poses = np.column_stack([np.linspace(0, 10, 101), np.zeros((101, 2))])
    return Odometry(0.1 * np.arange(101), poses, np.full((100, 3), 0.01))


def test_a_device_with_odometry_needs_no_footsteps() -> None:
    bare = Recording("arkit", "tablet", odometry=straight_odometry())
    nodes = walk_nodes(bare, load(PARAMETERS, None, ["motion.node_spacing_m=1.0"]))
    npt.assert_allclose(nodes.world_from_body[:, 0], np.arange(11), atol=0.11)
    npt.assert_allclose(nodes.step_sigma[1:-1], 0.01 * np.sqrt(10), rtol=0.06)


def test_motion_sensors_come_before_the_devices_odometry(recording: Recording) -> None:
    both = dataclasses.replace(recording, odometry=straight_odometry())
    npt.assert_array_equal(walk_nodes(both, PARAMETERS).t_s, walk_nodes(recording, PARAMETERS).t_s)


def test_a_recording_without_motion_is_refused(recording: Recording) -> None:
    still = dataclasses.replace(recording, imu=None)
    with pytest.raises(InputError, match=r"studio: it has neither motion sensors nor odom"):
        walk_nodes(still, PARAMETERS)


def test_a_recording_without_sound_is_refused(recording: Recording) -> None:
    deaf = dataclasses.replace(recording, audio=None)
    with pytest.raises(InputError, match=r"studio: it has no sound; map it with --by magn"):
        hear(deaf, PARAMETERS)


def test_a_recording_at_another_rate_is_refused(recording: Recording) -> None:
    samples: F32 = np.zeros((1, 99_000), dtype=np.float32)
    strange = dataclasses.replace(recording, audio=Audio(samples, 22_050))
    with pytest.raises(InputError, match="wanted 44100 or 48000 Hz, got 22050"):
        hear(strange, PARAMETERS)


def test_steps_of_a_known_length_stay_as_they_are(recording: Recording) -> None:
    nodes, echoes = walk_nodes(recording, PARAMETERS), hear(recording, PARAMETERS)
    sure = dataclasses.replace(nodes, scale_sigma=0.0)
    assert with_heard_steps(sure, echoes, PARAMETERS) is sure
    heard = with_heard_steps(nodes, echoes, PARAMETERS)
    assert 0 < heard.scale_sigma < nodes.scale_sigma
    before, after = (np.diff(each.world_from_body[:, :2], axis=0) for each in (nodes, heard))
    scale = np.linalg.norm(after) / np.linalg.norm(before)
    npt.assert_allclose(after, scale * before, atol=1e-9)
    assert 0 < abs(scale - 1) < 3 * nodes.scale_sigma


def test_without_a_schedule_the_echoes_for_fixes_are_the_echoes(recording: Recording) -> None:
    assert recording.played_t_s is None
    echoes, suspect = hear_for_fixes(recording, PARAMETERS)
    npt.assert_array_equal(echoes.samples, hear(recording, PARAMETERS).samples)
    assert not suspect(echoes.t_s).any()
