"""Where Wi-Fi places a walker: the scores are those of two walks, and planted places are found."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.baselines.wifi import Fingerprints, WifiFingerprintParameters, wifi_scores
from elfslam.baselines.wifi_places import PlaceParameters, place_scores, placed_by, wifi_places

KNOWN = WifiFingerprintParameters()


def random_prints(names, count, seed):
    rssi_dbm = np.random.default_rng(seed).uniform(-110, -40, (count, len(names)))
    return Fingerprints(tuple(names), np.maximum(rssi_dbm, KNOWN.floor_dbm))


def test_scores_are_those_between_two_walks_whatever_each_has_heard():
    walks = [random_prints("abc", 5, 0), random_prints("bd", 4, 1)]
    places = wifi_places(walks, [np.zeros((5, 2)), np.zeros((4, 2))], KNOWN)
    heard = random_prints("cdxe", 6, 2)
    expected = np.hstack([wifi_scores(heard, walk, KNOWN) for walk in walks])
    assert place_scores(heard, places, KNOWN) == pytest.approx(expected)


def test_a_place_is_the_weighted_mean_of_the_best():
    xy_m = np.array([[0.0, 0.0], [2.0, 0.0], [90.0, 90.0]])
    scores = np.array([[0.5, 0.25, 0.1], [0.0, 0.0, 0.0]])
    at, scatter = placed_by(scores, xy_m, PlaceParameters(count=2, wifi_power=1.0))
    assert at[0] == pytest.approx([2.0 / 3, 0.0])
    assert scatter[0] == pytest.approx(np.diag([2 * (2 / 3) ** 2 / 3 + (4 / 3) ** 2 / 3, 0.0]))
    assert np.isnan(scatter[1]).all()
    assert np.isnan(at[1]).all()


def test_a_map_needs_a_walk():
    with pytest.raises(InputError, match="got no walk"):
        wifi_places([], [], KNOWN)
