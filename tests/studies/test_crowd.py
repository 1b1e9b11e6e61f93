"""Phones in one room hear each other when and as loud as distances say."""

import numpy as np
import pytest

from elfslam.world.simulate import load_world
from studies.crowd import Crowd, crowd_in, heard_by_all


@pytest.fixture(scope="module")
def crowd() -> Crowd:
    return crowd_in(load_world("studio"), 3, 107)


def test_the_first_phones_are_the_same_however_many_follow(crowd: Crowd) -> None:
    two = crowd_in(load_world("studio"), 2, 107)
    for ours, theirs in zip(crowd.phones, two.phones, strict=False):
        np.testing.assert_array_equal(ours.motion.position_m, theirs.motion.position_m)
        assert (ours.out_s, ours.in_s, ours.clock_ppm) == (
            theirs.out_s,
            theirs.in_s,
            theirs.clock_ppm,
        )
    assert len({phone.out_s for phone in crowd.phones}) == 3


def test_another_phone_is_heard_after_its_way_and_softer(crowd: Crowd) -> None:
    at_s = np.array([5.0, 8.0, 11.0])
    frames = heard_by_all(crowd, 0, at_s)
    assert frames.shape == (3, 3, 4410)
    rows = (
        (at_s * 100).astype(int)
        * len(crowd.phones[0].motion.t_s)
        // round(100 * crowd.phones[0].motion.t_s[-1])
    )
    places = [phone.motion.position_m[rows] for phone in crowd.phones]
    for k in (1, 2):
        way_m = np.linalg.norm(places[k] - places[0], axis=1)
        for row in range(3):
            sound = np.abs(frames[row, k])
            begin = np.argmax(sound > 0.05 * sound.max())
            assert begin >= (way_m[row] - 0.6) / 350 * 44_100
            assert sound.max() < 0.5 * np.abs(frames[row, 0]).max()
