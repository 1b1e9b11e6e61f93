"""What the line is given of a walk: footsteps, echoes, and one-line refusals."""

import dataclasses
import re
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import compose, interpolate_poses
from elfslam.base.parameters import load
from elfslam.base.values import Audio, Imu, Magnetometer, Odometry, Recording
from elfslam.data.mall import read_walk, walks_in
from elfslam.slam import front_end
from elfslam.slam.coverage import missing_of
from elfslam.slam.crop import crop
from elfslam.slam.front_end import (
    compass_of,
    dead_reckoning_nodes,
    extract_echoes,
    too_noisy,
    with_missed_half_turn,
)
from elfslam.slam.parameters import Parameters
from elfslam.stages.feature import Encoder, load_encoder
from elfslam.stages.motion import half_turned
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from tests.stages.magnetic_walk import walk

PARAMETERS = Parameters()


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(load_world("studio"), seed=7, rounds=2)[0]


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    return load_encoder("compact")


def test_a_walk_at_48_khz_gives_the_same_echoes(encoder: Encoder) -> None:
    slow, fast = (
        extract_echoes(simulate(load_world("studio"), 7, rounds=1, rate_hz=rate_hz)[0], PARAMETERS)
        for rate_hz in (44_100, 48_000)
    )
    count = min(len(slow.t_s), len(fast.t_s))
    assert count > 100
    npt.assert_allclose(slow.t_s[:count], fast.t_s[:count], atol=1e-3)
    same = np.sum(encoder.embed(slow.samples[:count]) * encoder.embed(fast.samples[:count]), axis=1)
    assert np.median(same) > 0.9


@pytest.mark.parametrize(
    ("device", "said"),
    [
        ("iphone 5c down", "echoes lie 1[0-9] dB under the noise .*, wanted at most 3 dB under it"),
        ("galaxy s5 mic 1", None),
        ("galaxy s4 mic 1", None),
        ("ordinary phone", None),
    ],
)
def test_a_phone_that_cannot_map_is_told_from_one_that_can(device: str, said: str | None) -> None:
    today = Circumstances(device=device, engine="diffuse")
    walk = simulate(load_world("studio"), 7, rounds=1, circumstances=today)[0]
    told = too_noisy(extract_echoes(walk, PARAMETERS))
    assert told is None if said is None else re.match(said, str(told))


def test_what_hears_nothing_at_all_is_refused() -> None:
    today = Circumstances(device="iphone 5c up in hand")
    walk = simulate(load_world("studio"), 7, rounds=1, circumstances=today)[0]
    with pytest.raises(InputError, match=r"no chirps .*, or by another microphone or phone"):
        extract_echoes(walk, PARAMETERS)


def test_echoes_of_which_nobody_measured_the_noise_are_not_blamed(recording: Recording) -> None:
    echoes = extract_echoes(recording, PARAMETERS)
    assert too_noisy(dataclasses.replace(echoes, over_noise_db=float("nan"))) is None


@pytest.mark.parametrize("stretch", [(0.0, 1e6), (3.0, 8.0)])
def test_a_dead_channel_changes_nothing(recording: Recording, stretch: tuple[float, float]) -> None:
    """For maps and for fixes; and none of the sound is missing."""
    audio, quiet = recording.audio, np.random.default_rng(0)
    dead = 1e-5 * quiet.standard_normal(audio.samples.shape[1])
    both = dataclasses.replace(audio, samples=np.stack([dead, audio.samples[0]]))
    silent = dataclasses.replace(audio, samples=np.stack([0 * dead, audio.samples[0]]))
    part = crop(recording, *stretch)
    wanted = extract_echoes(part, PARAMETERS)
    for sound in (both, silent):
        stereo = crop(dataclasses.replace(recording, audio=sound), *stretch)
        npt.assert_array_equal(extract_echoes(stereo, PARAMETERS).samples, wanted.samples)
        asked, _ = front_end.extract_query_echoes(stereo, PARAMETERS)
        npt.assert_array_equal(asked.samples, wanted.samples)
    lacked = [missing_of(each, wanted, PARAMETERS.motion) for each in (stereo, part)]
    assert lacked[0] == lacked[1]


def test_sound_that_ends_before_the_motion_keeps_its_times(recording: Recording) -> None:
    whole = extract_echoes(recording, PARAMETERS)
    samples = recording.audio.samples[:, : -2 * 44_100]
    shorter = dataclasses.replace(recording, audio=Audio(samples, 44_100))
    heard = extract_echoes(shorter, PARAMETERS)
    npt.assert_allclose(heard.t_s, whole.t_s[: len(heard.t_s)], atol=1e-9)
    assert 15 < len(whole.t_s) - len(heard.t_s) < 25
    blind = extract_echoes(dataclasses.replace(shorter, imu=None), PARAMETERS)
    npt.assert_array_equal(blind.t_s, heard.t_s)


def without_motion(recording: Recording, from_s: float, until_s: float) -> Recording:
    imu = recording.imu
    kept = (imu.t_s < from_s) | (imu.t_s > until_s)
    cut = Imu(imu.t_s[kept], imu.accel_mps2[kept], imu.gyro_radps[kept])
    return dataclasses.replace(recording, imu=cut)


def test_only_sound_that_has_motion_is_heard(recording: Recording) -> None:
    whole = extract_echoes(recording, PARAMETERS)
    echoes = extract_echoes(without_motion(recording, 10.0, 13.0), PARAMETERS)
    lost = (whole.t_s > 10.0) & (whole.t_s < 13.0)
    npt.assert_allclose(echoes.t_s, whole.t_s[~lost], atol=1e-9)
    ended = extract_echoes(without_motion(recording, 20.0, 1e9), PARAMETERS)
    npt.assert_allclose(ended.t_s, whole.t_s[whole.t_s < 20.5], atol=1e-9)


def test_sound_of_a_time_without_motion_alone_is_refused(recording: Recording) -> None:
    samples = recording.audio.samples.copy()
    samples[:, 5 * 44_100 :] = 0.0
    early = dataclasses.replace(recording, audio=Audio(samples, 44_100, is_timed=True))
    with pytest.raises(InputError, match="its sound and its motion do not meet in time"):
        extract_echoes(without_motion(early, 0.0, 9.0), PARAMETERS)


@pytest.mark.parametrize("timed", [True, False], ids=["with times of its own", "counted"])
def test_a_hole_in_the_sound_is_no_refusal(recording: Recording, timed: bool) -> None:
    """A call of which most of the walk is silent: only the sound that is there is judged."""
    samples = recording.audio.samples.copy()
    length = samples.shape[1]
    samples[:, length // 6 : 5 * length // 6] = 0.0
    audio = Audio(samples, 44_100, is_timed=timed)
    echoes = extract_echoes(dataclasses.replace(recording, audio=audio), PARAMETERS)
    whole = extract_echoes(recording, PARAMETERS)
    third = (whole.t_s < length / 6 / 44_100 - 0.1) | (whole.t_s > 5 * length / 6 / 44_100 + 0.1)
    nearest = np.min(np.abs(echoes.t_s[:, None] - whole.t_s[third]), axis=0)
    assert nearest.max() < 1e-6


def test_jumps_of_sound_with_times_of_its_own_are_no_losses(recording: Recording) -> None:
    """A browser that lost sound knows when the rest was heard, however early the walk ended."""
    at, lost = 12 * 44_100 + 2_000, 1_300
    samples = np.delete(recording.audio.samples, np.s_[at : at + lost], axis=1)[:, : -3 * 44_100]
    counted = dataclasses.replace(recording, audio=Audio(samples, 44_100))
    timed = dataclasses.replace(recording, audio=Audio(samples, 44_100, is_timed=True))
    early, late = (extract_echoes(each, PARAMETERS) for each in (counted, timed))
    assert late.losses_s[:, 1].tolist() == [0.0]
    assert len(late.t_s) > len(early.t_s) or early.losses_s[0, 1] > 0


def test_nodes_over_a_hole_in_the_motion_are_uncertain(recording: Recording) -> None:
    nodes = dead_reckoning_nodes(without_motion(recording, 10.0, 13.0), PARAMETERS)
    across = int(np.argmax(np.diff(nodes.t_s)))
    assert nodes.step_sigma[across, 0] > 2.0 > 5 * np.median(nodes.step_sigma[:, 0])


def test_nodes_are_footsteps_from_the_start_pose(recording: Recording) -> None:
    placed = dataclasses.replace(recording, start_pose=(3.0, -2.0, 1.0))
    nodes = dead_reckoning_nodes(placed, PARAMETERS)
    unplaced = dead_reckoning_nodes(recording, PARAMETERS).world_from_body
    npt.assert_allclose(nodes.world_from_body, compose(np.array([3.0, -2.0, 1.0]), unplaced))
    assert 0.1 < np.hypot(*unplaced[0, :2]) < 0.6
    steps_m = np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1)
    assert 0.4 < np.median(steps_m) < 1.0


def magnetic_recording(start_rad: float, **planted: Any) -> Recording:
    """Forty seconds straight on, but for the turns that are planted."""
    imu, magnetometer = walk(start_rad, **planted)
    return Recording("walk", "planted", imu=imu, magnetometer=magnetometer)


def way_rad(nodes: Odometry) -> float:
    ahead = nodes.world_from_body[-1] - nodes.world_from_body[0]
    return float(np.arctan2(ahead[1], ahead[0]))


def test_a_half_turn_that_was_missed_is_put_in_with_a_note() -> None:
    true = magnetic_recording(0.3, turns=[(6.0, np.pi / 2)])
    assert true.imu is not None
    assert with_missed_half_turn(true, PARAMETERS) is true
    missed = dataclasses.replace(true, imu=half_turned(true.imu, 20.0))
    mended = with_missed_half_turn(missed, PARAMETERS)
    assert [note.split(",")[0] for note in mended.notes] == [
        "the gyroscope missed a half turn after 20 s"
    ]
    ways = [way_rad(dead_reckoning_nodes(each, PARAMETERS)) for each in (true, mended, missed)]
    assert ways[1] == pytest.approx(ways[0], abs=0.05)
    assert abs(ways[2] - ways[0]) > 0.5
    deaf = dataclasses.replace(missed, magnetometer=None)
    assert with_missed_half_turn(deaf, PARAMETERS) is deaf


@pytest.mark.parametrize("start_rad", [-2.0, 0.3, 1.9])
def test_a_walk_that_declares_no_heading_goes_by_the_compass(start_rad: float) -> None:
    """Magnetic north is the map's y, or where it is said to be; the walk turns about its start."""
    bare = magnetic_recording(start_rad)
    assert compass_of(bare, PARAMETERS) is not None
    assert way_rad(dead_reckoning_nodes(bare, PARAMETERS)) == pytest.approx(start_rad, abs=0.02)
    somewhere = dataclasses.replace(bare, start_pose=(7.0, -3.0, np.nan))
    nodes = dead_reckoning_nodes(somewhere, PARAMETERS)
    assert way_rad(nodes) == pytest.approx(start_rad, abs=0.02)
    assert np.hypot(*(nodes.world_from_body[0, :2] - [7.0, -3.0])) < 0.5
    turned = load(PARAMETERS, None, ["motion.magnetic_north_rad=1.0"])
    moved = way_rad(dead_reckoning_nodes(bare, turned)) - start_rad
    assert np.angle(np.exp(1j * moved)) == pytest.approx(1.0 - np.pi / 2, abs=0.02)


def test_a_turn_before_the_first_footstep_is_not_taken_twice() -> None:
    """The compass says how the first footstep heads, a declared start how the walker stood."""
    bare = magnetic_recording(1.0, turns=[(0.0, -0.5)])
    assert way_rad(dead_reckoning_nodes(bare, PARAMETERS)) == pytest.approx(0.5, abs=0.05)
    later = magnetic_recording(1.0, turns=[(0.6, -0.5)])
    assert way_rad(dead_reckoning_nodes(later, PARAMETERS)) == pytest.approx(0.5, abs=0.05)


def test_a_declared_heading_stands_and_a_compass_has_a_sigma() -> None:
    bare = magnetic_recording(1.0, bend_ut=4.0)
    declared = dataclasses.replace(bare, start_pose=(0.0, 0.0, -0.7))
    assert compass_of(declared, PARAMETERS) is None
    nodes, by_compass = (dead_reckoning_nodes(one, PARAMETERS) for one in (declared, bare))
    assert way_rad(nodes) == pytest.approx(-0.7, abs=0.02)
    assert by_compass.step_sigma[0, 2] > nodes.step_sigma[0, 2]
    npt.assert_array_equal(by_compass.step_sigma[1:], nodes.step_sigma[1:])


def test_a_start_without_heading_needs_a_compass() -> None:
    bare = dataclasses.replace(magnetic_recording(1.0), magnetometer=None)
    assert compass_of(bare, PARAMETERS) is None
    with pytest.raises(InputError, match=r"walk: the start has no heading \(.*no magnetometer\)"):
        dead_reckoning_nodes(dataclasses.replace(bare, start_pose=(1.0, 2.0, np.nan)), PARAMETERS)
    imu, field = walk(1.0)
    plumb = Magnetometer(field.t_s, 0 * field.field_ut)
    nowhere = Recording("walk", "planted", imu=imu, magnetometer=plumb)
    poses = [dead_reckoning_nodes(one, PARAMETERS).world_from_body for one in (nowhere, bare)]
    npt.assert_array_equal(*poses)
    with pytest.raises(InputError, match=r"no heading \(compass: the field has no horizontal"):
        dead_reckoning_nodes(dataclasses.replace(nowhere, start_pose=(1, 2, np.nan)), PARAMETERS)


def straight_odometry() -> Odometry:
    """A device that brings its own odometry: 10 m straight ahead in steps of 10 cm."""
    poses = np.column_stack([np.linspace(0, 10, 101), np.zeros((101, 2))])
    return Odometry(0.1 * np.arange(101), poses, np.full((100, 3), 0.01))


def test_a_device_with_odometry_needs_no_footsteps() -> None:
    bare = Recording("arkit", "tablet", odometry=straight_odometry())
    nodes = dead_reckoning_nodes(bare, load(PARAMETERS, None, ["motion.node_spacing_m=1.0"]))
    npt.assert_allclose(nodes.world_from_body[:, 0], np.arange(11), atol=0.11)
    npt.assert_allclose(nodes.step_sigma[1:-1], 0.01 * np.sqrt(10), rtol=0.06)


def test_motion_sensors_come_before_the_devices_odometry(recording: Recording) -> None:
    both = dataclasses.replace(recording, odometry=straight_odometry())
    one, other = (dead_reckoning_nodes(each, PARAMETERS).t_s for each in (both, recording))
    npt.assert_array_equal(one, other)


def test_recordings_without_motion_or_sound_or_at_another_rate_are_refused(
    recording: Recording,
) -> None:
    with pytest.raises(InputError, match=r"studio: it has neither motion sensors nor odom"):
        dead_reckoning_nodes(dataclasses.replace(recording, imu=None), PARAMETERS)
    with pytest.raises(InputError, match=r"studio: it has no sound; map it by magn"):
        extract_echoes(dataclasses.replace(recording, audio=None), PARAMETERS)
    strange = Audio(np.zeros((1, 99_000), dtype=np.float32), 22_050)
    with pytest.raises(InputError, match="wanted 44100 or 48000 Hz, got 22050"):
        extract_echoes(dataclasses.replace(recording, audio=strange), PARAMETERS)


def test_steps_of_a_known_length_stay_as_they_are(recording: Recording) -> None:
    nodes = dead_reckoning_nodes(recording, PARAMETERS)
    echoes = extract_echoes(recording, PARAMETERS)
    sure = dataclasses.replace(nodes, scale_sigma=0.0)
    assert front_end.apply_acoustic_scale(sure, echoes, PARAMETERS) is sure
    heard = front_end.apply_acoustic_scale(nodes, echoes, PARAMETERS)
    assert 0 < heard.scale_sigma < nodes.scale_sigma
    before, after = (np.diff(each.world_from_body[:, :2], axis=0) for each in (nodes, heard))
    scale = np.linalg.norm(after) / np.linalg.norm(before)
    npt.assert_allclose(after, scale * before, atol=1e-9)
    assert 0 < abs(scale - 1) < 3 * nodes.scale_sigma


def test_without_a_schedule_the_echoes_for_fixes_are_the_echoes(recording: Recording) -> None:
    assert recording.played_t_s is None
    echoes, suspect = front_end.extract_query_echoes(recording, PARAMETERS)
    npt.assert_array_equal(echoes.samples, extract_echoes(recording, PARAMETERS).samples)
    assert not suspect(echoes.t_s).any()


def test_real_walks_end_where_they_should_by_the_compass_alone(shared_data: Path) -> None:
    """Ten walks of a mall, north as drawn: within an eighth of the way in the median."""
    shares = []
    for path in islice(walks_in(shared_data / "mall_walks" / "site1-F1.tar.xz"), 10):
        found = read_walk(path)
        true = found.truth.world_from_body[:, :2]
        start = (float(true[0, 0]), float(true[0, 1]), np.nan)
        begun = dataclasses.replace(found.recording, start_pose=start)
        nodes = dead_reckoning_nodes(begun, PARAMETERS)
        end = interpolate_poses(nodes.t_s, nodes.world_from_body, found.truth.t_s[-1:])[0, :2]
        way_m = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
        shares.append(np.linalg.norm(end - true[-1]) / way_m)
    assert np.median(shares) < 0.125
