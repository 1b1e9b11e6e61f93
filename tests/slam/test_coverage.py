"""Where a recording has sound and motion, and what is said to be missing: all planted."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.values import ECHO_SAMPLES, Audio, Echoes, Imu, Recording
from elfslam.slam.coverage import Missing, missing_of, spans_of, stretches, within
from elfslam.slam.crop import crop
from elfslam.stages.motion import MotionParameters

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
    recording = Recording(
        "walk", "planted", audio=sound(20.0, (5.0, 8.0), (12.0, 12.3)), imu=motion((0, 6), (9, 20))
    )
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
