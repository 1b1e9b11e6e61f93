"""A recording cropped to a stretch: what lies outside has no say; times stay those of the whole."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Odometry, Recording
from elfslam.slam.crop import crop
from elfslam.slam.front_end import dead_reckoning_nodes, extract_echoes
from elfslam.slam.parameters import Parameters
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world

PARAMETERS = Parameters()


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(load_world("studio"), seed=7, rounds=2)[0]


def test_the_steps_and_echoes_of_a_stretch_are_those_of_the_whole(recording: Recording) -> None:
    part = crop(recording, 8.0, 20.0)
    whole, heard = (
        dead_reckoning_nodes(recording, PARAMETERS),
        extract_echoes(recording, PARAMETERS),
    )
    steps, echoes = dead_reckoning_nodes(part, PARAMETERS), extract_echoes(part, PARAMETERS)
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
        extract_echoes(loud, PARAMETERS)
    echoes = extract_echoes(crop(loud, 8.0, 30.0), PARAMETERS)
    npt.assert_allclose(echoes.t_s, extract_echoes(crop(recording, 8.0, 30.0), PARAMETERS).t_s)


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


def test_a_stretch_without_motion_is_refused_with_that_of_the_recording(
    recording: Recording,
) -> None:
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
