"""Where a recording has sound and motion, what it lacks, and stretches of it: all planted."""

import dataclasses
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, Audio, Echoes, Imu, Odometry, Recording
from elfslam.slam.coverage import Missing, missing_of, spans_of, stretches, within
from elfslam.slam.crop import crop
from elfslam.slam.front_end import dead_reckoning_nodes, extract_echoes
from elfslam.slam.parameters import Parameters
from elfslam.stages.motion import MotionParameters
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world

RATE_HZ = 1000
PARAMETERS = MotionParameters()


def motion(*spans: tuple[float, float]) -> Imu:
    """Fifty readings a second in each span."""
    t_s = np.concatenate([np.arange(begin, end, 0.02) for begin, end in spans])
    return Imu(t_s, np.tile([0.0, 0.0, 9.81], (len(t_s), 1)), np.zeros((len(t_s), 3)))


def sound(length_s: float, *silences: tuple[float, float]) -> Audio:
    samples = np.ones((1, round(length_s * RATE_HZ)), dtype=np.float32)
    for begin, end in silences:
        samples[:, round(begin * RATE_HZ) : round(end * RATE_HZ)] = 0.0
    return Audio(samples, RATE_HZ, is_timed=True)


def echoes(*spans: tuple[float, float], every_s: float = 0.1) -> Echoes:
    t_s = np.concatenate([np.arange(begin, end, every_s) for begin, end in spans])
    return Echoes(t_s, np.zeros((len(t_s), ECHO_SAMPLES), dtype=np.float32), np.empty((0, 2)))


def test_spans_are_those_without_longer_interruptions() -> None:
    heard, moved = sound(20.0, (5.0, 8.0), (12.0, 12.3)), motion((0, 6), (9, 20))
    recording = Recording("walk", "planted", audio=heard, imu=moved)
    spans = spans_of(recording, PARAMETERS)
    npt.assert_allclose(spans["sound"], [[0, 5], [8, 20]], atol=1e-9)
    npt.assert_allclose(spans["motion"], [[0, 5.98], [9, 19.98]], atol=1e-9)
    assert spans_of(Recording("walk", "planted"), PARAMETERS) == {}


def test_stretches_of_nothing_and_of_one_time() -> None:
    assert stretches(np.empty(0), 0.5).shape == (0, 2)
    npt.assert_array_equal(stretches(np.array([3.0]), 0.5), [[3.0, 3.0]])
    inside = within(np.array([0.0, 1.0, 2.5, 4.0]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    npt.assert_array_equal(inside, [False, True, False, True])


def missing(recording: Recording, heard: Echoes | None) -> list[tuple[str, float, float]]:
    found = missing_of(recording, heard, PARAMETERS)
    return [(each.what, each.from_s, each.until_s) for each in found]


def test_a_walk_with_all_of_both_lacks_nothing() -> None:
    whole = Recording("walk", "planted", audio=sound(20.0), imu=motion((0.2, 19.9)))
    assert missing(whole, echoes((0.7, 20.0))) == []


@pytest.mark.parametrize(
    ("moved", "heard", "lacks"),
    [
        ([(0, 19.2)], [(0, 19.2)], [("motion", 19.18, 20.0)]),
        ([(3, 20)], [(3, 20)], [("motion", 0.0, 3.0), ("sound", 0.0, 3.0)]),
        ([(0, 8), (11, 20)], [(0, 8), (11, 20)], [("motion", 7.98, 11.0), ("sound", 7.9, 11.0)]),
        ([(0, 20)], [(0, 12), (15, 20)], [("sound", 11.9, 15.0)]),
    ],
    ids=["motion ends early", "motion begins late", "a hole in the motion", "a hole in the sound"],
)
def test_what_is_missing_is_told(
    moved: list[tuple[float, float]],
    heard: list[tuple[float, float]],
    lacks: list[tuple[str, float, float]],
) -> None:
    recording = Recording("walk", "planted", audio=sound(20.0), imu=motion(*moved))
    found = missing(recording, echoes(*heard))
    assert [what for what, _, _ in found] >= [what for what, _, _ in lacks]
    for what, from_s, until_s in lacks:
        nearest = min(abs(from_s - a) + abs(until_s - b) for w, a, b in found if w == what)
        assert nearest < 0.15


def test_sound_that_ends_before_the_motion_is_missing_there() -> None:
    recording = Recording("walk", "planted", audio=sound(12.0), imu=motion((0, 20)))
    ((what, from_s, until_s),) = missing(recording, echoes((0, 12)))
    assert (what, round(from_s, 1)) == ("sound", 11.9)
    assert until_s == pytest.approx(19.9, abs=0.11)


def test_a_walk_mapped_without_echoes_lacks_no_sound() -> None:
    recording = Recording("walk", "planted", audio=sound(40.0), imu=motion((0, 8), (11, 20)))
    assert missing(recording, None) == [("motion", 7.98, 11.0)]


def test_phones_that_take_turns_are_not_said_to_be_silent() -> None:
    recording = Recording("walk", "planted", audio=sound(60.0), imu=motion((0, 60)))
    assert missing(recording, echoes((0.5, 60), every_s=0.9)) == []


def test_a_phone_that_listens_before_it_chirps_lacks_no_sound() -> None:
    recording = Recording("walk", "planted", audio=sound(20.0), imu=motion((0, 20)))
    listened = replace(recording, played_t_s=np.arange(2.5, 20, 0.1))
    assert missing(recording, echoes((2.5, 20)))[0][:2] == ("sound", 0.0)
    assert missing(listened, echoes((2.5, 20))) == []
    (late,) = missing(listened, echoes((6, 20)))
    assert late == ("sound", 2.5, 6.0)


def test_of_a_stretch_only_what_is_missing_within_it_counts() -> None:
    recording = Recording("walk", "planted", audio=sound(20.0), imu=motion((0, 8), (11, 20)))
    assert missing(crop(recording, 10.0, 18.0), echoes((11, 18))) == [("motion", 10.0, 11.0)]


def test_in_words() -> None:
    assert str(Missing("sound", 1.24, 5.0)) == "sound is missing from 1.2 to 5.0 s"


SETTINGS = Parameters()


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(load_world("studio"), seed=7, rounds=2)[0]


def test_the_steps_and_echoes_of_a_stretch_are_those_of_the_whole(recording: Recording) -> None:
    part = crop(recording, 8.0, 20.0)
    whole = dead_reckoning_nodes(recording, SETTINGS)
    heard = extract_echoes(recording, SETTINGS)
    steps, echoes = dead_reckoning_nodes(part, SETTINGS), extract_echoes(part, SETTINGS)
    assert 8 <= steps.t_s[0] < steps.t_s[-1] <= 20
    inner = steps.t_s[2:-2]
    nearest_s = np.min(np.abs(whole.t_s[:, None] - inner), axis=0)
    assert nearest_s.max() < 0.05
    rows = (heard.t_s >= 8) & (heard.t_s <= 20)
    assert len(echoes.t_s) >= rows.sum() - 2
    near = np.min(np.abs(heard.t_s[rows][:, None] - echoes.t_s), axis=0)
    assert near.max() < 1e-6


def test_whatever_was_wrong_outside_does_not_matter(recording: Recording) -> None:
    """A clipped shout, and half a minute without a chirp."""
    samples = recording.audio.samples.copy()
    samples[:, : 6 * 44_100] = np.sign(samples[:, : 6 * 44_100])
    loud = dataclasses.replace(recording, audio=Audio(samples, 44_100))
    with pytest.raises(InputError, match="clipped"):
        extract_echoes(loud, SETTINGS)
    echoes = extract_echoes(crop(loud, 8.0, 30.0), SETTINGS)
    npt.assert_allclose(echoes.t_s, extract_echoes(crop(recording, 8.0, 30.0), SETTINGS).t_s)


def walked(**start: object) -> Recording:
    poses = np.column_stack([np.arange(11.0), np.zeros((11, 2))])
    sigma = np.arange(30.0).reshape(10, 3) + 1
    own = Odometry(np.arange(11.0), poses, sigma)
    return dataclasses.replace(Recording("walk", "planted", odometry=own), **start)


def test_a_start_is_that_of_the_whole() -> None:
    started = walked(start_pose=(1.0, 2.0, 0.5))
    assert crop(started, 0.0, 9.0).start_pose == (1.0, 2.0, 0.5)
    assert crop(started, 0.1, 9.0).start_pose is None


def test_the_devices_own_odometry_is_cut_with_its_sigmas() -> None:
    whole = walked().odometry
    part = crop(walked(), 2.5, 6.0)
    npt.assert_array_equal(part.odometry.t_s, [3, 4, 5, 6])
    npt.assert_array_equal(part.odometry.step_sigma, whole.step_sigma[3:6])
    npt.assert_array_equal(part.motion_t_s, whole.t_s)


def test_a_stretch_without_motion_is_refused_with_the_recording_s(recording: Recording) -> None:
    with pytest.raises(InputError, match=r"wanted motion from 900 to 910 s, got that from 0\.0 to"):
        crop(recording, 900.0, 910.0)
    with pytest.raises(InputError, match="got none; choose a stretch"):
        crop(Recording("walk", "planted"), 0.0, 10.0)


def test_sound_that_may_lack_samples_stays_whole(recording: Recording) -> None:
    audio, part = recording.audio, crop(recording, 8.0, 20.0).audio
    inside = slice(8 * 44_100, 20 * 44_100)
    npt.assert_array_equal(part.samples[:, inside], audio.samples[:, inside])
    assert not np.delete(part.samples, np.r_[inside], axis=1).any()
    lacking = dataclasses.replace(audio, samples=audio.samples[:, 44_100:])
    assert crop(dataclasses.replace(recording, audio=lacking), 8.0, 20.0).audio is lacking
