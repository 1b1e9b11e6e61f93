"""Wi-Fi similarity: planted strengths, stale entries, laws of the scores, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import Odometry, WifiScans
from elfslam.baselines import wifi as by_wifi

TUNED = by_wifi.WifiFingerprintParameters()
PAPER = by_wifi.WifiFingerprintParameters(variant="paper")
POINTS_M = np.array([0.0, 15.0, 30.0])
NAMES = ("a", "b", "c")


def nodes(count=121):
    poses = np.column_stack([0.5 * np.arange(count), *np.zeros((2, count))])
    return Odometry(0.5 * np.arange(count), poses, np.full((count - 1, 3), 0.05))


def there_and_back(age_s=0.0):
    """A corridor of 30 m with three access points, walked there and back at 1 m/s."""
    t_s = np.arange(0.0, 60.1, 1.0)
    x_m = 30.0 - np.abs(30.0 - (t_s - age_s))
    rssi = -40.0 - 20.0 * np.log10(np.maximum(np.abs(x_m[:, None] - POINTS_M), 1.0)) * 1.4
    return WifiScans(t_s, NAMES, rssi, np.full(rssi.shape, age_s))


@pytest.mark.parametrize("parameters", [TUNED, PAPER])
def test_a_place_is_found_again_on_the_way_back(parameters):
    scores = by_wifi.wifi_similarity(there_and_back(), nodes(), parameters).scores
    rows = np.arange(10, 50)
    best = 70 + np.argmax(scores[rows, 70:], axis=1)
    assert np.abs(best - (119 - rows)).max() <= 3


@pytest.mark.parametrize("parameters", [TUNED, PAPER])
def test_scores_are_symmetric_bounded_and_one_on_the_diagonal(parameters):
    scores = by_wifi.wifi_similarity(there_and_back(), nodes(), parameters).scores
    assert scores == pytest.approx(scores.T, abs=1e-6)
    assert np.diag(scores) == pytest.approx(1.0, abs=1e-6)
    assert 0.0 <= scores.min() <= scores.max() <= 1.0 + 1e-6


def test_the_paper_takes_the_nearest_scan_and_euclid():
    wifi = WifiScans(
        np.array([0.0, 2.0]), ("a", "b"), np.array([[-50.0, np.nan], [-60.0, -70.0]]),
        np.zeros((2, 2)),
    )  # fmt: skip
    walk = Odometry(np.array([0.0, 0.5, 2.0]), np.zeros((3, 3)), np.full((2, 3), 0.1))
    heard = by_wifi.fingerprints(wifi, walk, PAPER)
    assert heard.rssi_dbm.tolist() == [[-50.0, PAPER.floor_dbm], [-60.0, -70.0]]
    distance_db = np.hypot(10.0, PAPER.floor_dbm + 70.0)
    wanted = np.exp(-distance_db / PAPER.distance_scale_db)
    assert by_wifi.wifi_scores(heard, heard, PAPER)[0, 1] == pytest.approx(wanted)


def test_an_old_entry_counts_where_it_was_heard():
    both = (by_wifi.fingerprints(there_and_back(age_s), nodes(), TUNED) for age_s in (0.0, 5.0))
    fresh, stale = (each.rssi_dbm for each in both)
    assert stale[20:90] == pytest.approx(fresh[20:90], abs=0.5)


def test_what_scans_repeat_counts_once():
    rssi = np.array([[-50.0], [-50.0], [-60.0]])
    wifi = WifiScans(np.array([1.0, 3.0, 5.0]), ("a",), rssi, np.array([[0.0], [2.01], [0.5]]))
    heard_s, column, strength = by_wifi.sightings(wifi)
    assert heard_s == pytest.approx([0.99, 4.5], abs=0.02)
    assert column.tolist() == [0, 0]
    assert strength.tolist() == [-50.0, -60.0]


def test_common_power_over_all_power():
    here = by_wifi.Fingerprints(("a", "b"), np.array([[-53.0, TUNED.floor_dbm]]))
    there = by_wifi.Fingerprints(("a", "c"), np.array([[-73.0, -83.0]]))
    known = replace(TUNED, power=1.0)
    assert by_wifi.wifi_scores(here, there, known)[0, 0] == pytest.approx(20.0 / (40.0 + 10.0))
    assert by_wifi.wifi_scores(there, here, known)[0, 0] == pytest.approx(0.4)


def test_walks_with_nothing_in_common_score_nothing():
    one, other = (by_wifi.Fingerprints((name,), np.array([[-50.0], [-60.0]])) for name in "ab")
    assert (by_wifi.wifi_scores(one, other, TUNED) == 0.0).all()


def test_scans_of_another_hour_are_refused():
    late = there_and_back()
    late = WifiScans(late.t_s + 3600.0, NAMES, late.rssi_dbm, late.age_s)
    with pytest.raises(InputError, match="Wi-Fi: got no scan between"):
        by_wifi.wifi_similarity(late, nodes(), TUNED)


def test_an_unknown_variant_is_refused():
    with pytest.raises(ParameterError, match="wanted tuned or paper, got 'other'"):
        by_wifi.wifi_similarity(
            there_and_back(), nodes(), by_wifi.WifiFingerprintParameters(variant="other")
        )


KNOWN = by_wifi.WifiFingerprintParameters()


def random_prints(names, count, seed):
    rssi_dbm = np.random.default_rng(seed).uniform(-110, -40, (count, len(names)))
    return by_wifi.Fingerprints(tuple(names), np.maximum(rssi_dbm, KNOWN.floor_dbm))


def test_scores_are_those_between_two_walks_whatever_each_has_heard():
    walks = [random_prints("abc", 5, 0), random_prints("bd", 4, 1)]
    places = by_wifi.wifi_places(walks, [np.zeros((5, 2)), np.zeros((4, 2))], KNOWN)
    heard = random_prints("cdxe", 6, 2)
    expected = np.hstack([by_wifi.wifi_scores(heard, walk, KNOWN) for walk in walks])
    assert by_wifi.place_scores(heard, places, KNOWN) == pytest.approx(expected)


def test_a_place_is_the_weighted_mean_of_the_best():
    xy_m = np.array([[0.0, 0.0], [2.0, 0.0], [90.0, 90.0]])
    scores = np.array([[0.5, 0.25, 0.1], [0.0, 0.0, 0.0]])
    at, scatter = by_wifi.placed_by(scores, xy_m, by_wifi.PlaceParameters(count=2, wifi_power=1.0))
    assert at[0] == pytest.approx([2.0 / 3, 0.0])
    assert scatter[0] == pytest.approx(np.diag([2 * (2 / 3) ** 2 / 3 + (4 / 3) ** 2 / 3, 0.0]))
    assert np.isnan(scatter[1]).all()
    assert np.isnan(at[1]).all()


def test_a_map_needs_a_walk():
    with pytest.raises(InputError, match="got no walk"):
        by_wifi.wifi_places([], [], KNOWN)
