"""Wi-Fi: path loss, walls, shadows that stay with the place, and scans with stale entries."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import WifiScans
from elfslam.world import wifi
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion

NO_WALLS = np.zeros((0, 2, 2))
SQUARE = np.array([[[0, 0], [4, 0]], [[4, 0], [4, 4]], [[4, 4], [0, 4]], [[0, 4], [0, 0]]], float)
CLEAN = wifi.WifiParameters(shadowing_db=0.0, fading_db=0.0, missed_share=0.0, body_loss_db=0.0)


def point(*position_m: float, bssid: str = "a", power_dbm: float = 16.0) -> wifi.AccessPoint:
    return wifi.AccessPoint(bssid, np.array(position_m), power_dbm)


def straight_walk(duration_s: float, speed_mps: float = 1.0, heading_rad: float = 0.0) -> Motion:
    t_s = np.arange(round(duration_s * KINEMATICS_RATE_HZ)) / KINEMATICS_RATE_HZ
    level = np.full_like(t_s, 1.2)
    way = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    position_m = np.column_stack([speed_mps * t_s[:, None] * way, level])
    heading = np.full_like(t_s, heading_rad)
    return Motion(t_s, position_m, heading, 0 * t_s, 0 * t_s, heading, 0 * t_s)


def scans_of(
    motion: Motion, points: list[wifi.AccessPoint], parameters: wifi.WifiParameters, seed: int = 0
) -> WifiScans:
    made = wifi.scan(motion, points, NO_WALLS, 5, np.random.default_rng(seed), parameters)
    assert made is not None
    return made


@pytest.mark.parametrize(
    ("channel", "mhz"), [(1, 2412), (6, 2437), (13, 2472), (14, 2484), (36, 5180)]
)
def test_channels_have_their_frequencies(channel: int, mhz: float) -> None:
    assert wifi.channel_mhz(channel) == mhz


@pytest.mark.parametrize("channel", [0, 15, 35, 178])
def test_a_channel_that_is_none_is_refused(channel: int) -> None:
    with pytest.raises(InputError, match=f"channel {channel}: wanted 1 to 14 or 36 to 177"):
        wifi.channel_mhz(channel)


def test_free_space_at_one_metre() -> None:
    """20 log10(4 pi d f / c) is 40.2 dB at 1 m and 2437 MHz."""
    at = np.array([[1.0, 0.0, 0.0]])
    loss_db = 20 * np.log10(4 * np.pi * 2437e6 / 299_792_458)
    heard_dbm = wifi.mean_rssi_dbm(point(0, 0, 0), at, NO_WALLS, CLEAN)
    assert heard_dbm[0] == pytest.approx(16 - loss_db, abs=0.01)


@pytest.mark.parametrize("exponent", [2.0, 3.5])
def test_ten_times_the_distance_costs_ten_times_the_exponent(exponent: float) -> None:
    at = np.array([[2.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    near, far = wifi.mean_rssi_dbm(point(0, 0, 0), at, NO_WALLS, replace(CLEAN, exponent=exponent))
    assert near - far == pytest.approx(10 * exponent)


def test_the_power_stays_finite_at_the_antenna() -> None:
    at = np.array([[0.0, 0.0, 0.0], [wifi.NEAREST_M, 0.0, 0.0]])
    touching, near = wifi.mean_rssi_dbm(point(0, 0, 0), at, NO_WALLS, CLEAN)
    assert touching == near


def test_walls_are_counted() -> None:
    inside, beside = np.array([2.0, 2.0]), np.array([6.0, 2.0])
    far = np.array([[2.5, 2.5], [6.0, 2.1], [-3.0, 2.2], [2.0, 9.0], [9.0, 8.0]])
    assert wifi.walls_crossed(far, inside, SQUARE).tolist() == [0, 1, 1, 1, 1]
    assert wifi.walls_crossed(far, beside, SQUARE).tolist() == [1, 0, 2, 0, 0]
    through_a_corner = np.array([[9.0, 9.0], [-3.0, -3.0]])
    assert wifi.walls_crossed(through_a_corner, inside, SQUARE).tolist() == [1, 1]
    assert wifi.walls_crossed(far, inside, NO_WALLS).tolist() == [0] * 5


def test_every_wall_costs_the_same() -> None:
    at = np.array([[-3.0, 2.0, 1.0]])
    behind_two = point(6.0, 2.0, 1.0)
    free, walled = (wifi.mean_rssi_dbm(behind_two, at, by, CLEAN)[0] for by in (NO_WALLS, SQUARE))
    assert free - walled == pytest.approx(2 * CLEAN.wall_loss_db)


@pytest.mark.parametrize("correlation_m", [2.0, 8.0])
def test_shadows_have_their_spread_and_length(correlation_m: float) -> None:
    """Over many places: standard deviation as asked for, correlation exp(-d / length)."""
    lags_m = np.array([0.0, 0.25, 0.5, 1.0, 2.0]) * correlation_m
    line_m = np.column_stack([lags_m, 0.5 * lags_m]) / np.sqrt(1.25)
    fields = np.array(
        [
            wifi.shadow_db(
                wifi.random_shadowing(np.random.default_rng(seed), 4.0, correlation_m), line_m
            )
            for seed in range(3000)
        ]
    )
    correlation = np.corrcoef(fields.T)[0]
    np.testing.assert_allclose(fields.std(axis=0), 4.0, rtol=0.05)
    np.testing.assert_allclose(correlation, np.exp(-lags_m / correlation_m), atol=0.06)


def test_shadows_stay_with_the_place() -> None:
    """Two walks on other days meet the same shadows; another place has others."""
    motion, points = straight_walk(60), [point(0.0, 5.0, 2.0)]
    parameters = replace(CLEAN, shadowing_db=6.0, scan_rate_hz=5.0)
    first, again = (scans_of(motion, points, parameters, seed) for seed in (0, 1))
    elsewhere = wifi.scan(motion, points, NO_WALLS, 6, np.random.default_rng(0), parameters)
    heard_s = [scans.t_s - scans.age_s[:, 0] for scans in (first, again)]
    shared = np.interp(heard_s[0], heard_s[1], again.rssi_dbm[:, 0]) - first.rssi_dbm[:, 0]
    assert np.abs(shared[1:-1]).mean() < 1.5
    assert np.abs(elsewhere.rssi_dbm[:, 0] - first.rssi_dbm[:, 0]).mean() > 2.0


def test_scans_come_at_the_rate() -> None:
    scans = scans_of(straight_walk(200, 0.1), [point(0.0, 5.0, 2.0)], CLEAN)
    assert 1 / np.diff(scans.t_s).mean() == pytest.approx(CLEAN.scan_rate_hz, rel=0.02)
    assert scans.t_s[0] >= 0


def test_a_reading_is_of_where_it_was_heard() -> None:
    """Without noise the law holds at the time of the sighting, not of the scan."""
    motion, access_point = straight_walk(60), point(-1.0, 0.0, 1.2)
    scans = scans_of(motion, [access_point], CLEAN)
    heard_s = scans.t_s - scans.age_s[:, 0]
    at = np.column_stack([heard_s, 0 * heard_s, 0 * heard_s + 1.2])
    expected = wifi.mean_rssi_dbm(access_point, at, NO_WALLS, CLEAN)
    assert np.abs(scans.rssi_dbm[:, 0] - expected).max() <= 0.6
    assert np.abs(np.diff(expected)).max() > 1.0


def test_the_holder_stands_in_the_way() -> None:
    parameters = replace(CLEAN, body_loss_db=8.0)
    ahead, behind = (point(1000.0, 0.0, 1.2), point(-1000.0, 0.0, 1.2, bssid="b"))
    loud = replace(parameters, threshold_dbm=-200.0)
    scans = scans_of(straight_walk(10), [ahead, behind], loud)
    difference = np.nanmean(scans.rssi_dbm[:, 0] - scans.rssi_dbm[:, 1])
    assert difference == pytest.approx(8.0, abs=0.6)


def test_the_weak_are_not_heard_and_the_names_are_sorted() -> None:
    near, nearer = point(0.0, 3.0, 2.0, bssid="z"), point(0.0, 2.0, 2.0, bssid="b")
    scans = scans_of(straight_walk(20), [near, point(1e4, 0.0, 2.0, bssid="m"), nearer], CLEAN)
    assert scans.bssids == ("b", "z")


def test_nothing_heard_is_no_scan() -> None:
    far = [point(1e5, 0.0, 2.0)]
    assert wifi.scan(straight_walk(20), far, NO_WALLS, 5, np.random.default_rng(0), CLEAN) is None


def test_missed_entries_are_repeated_until_they_are_forgotten() -> None:
    seldom = replace(CLEAN, missed_share=0.7, missed_halving_db=1e9)
    parameters = replace(seldom, scan_rate_hz=0.5, forget_s=20.0)
    scans = scans_of(straight_walk(2000, 0.001), [point(0.0, 5.0, 2.0)], parameters)
    age_s = scans.age_s[:, 0]
    stale = np.flatnonzero(age_s > 2.0)
    # A miss repeats the entry of the scan before, older by the time between.
    grown = scans.t_s[stale] - scans.t_s[stale - 1]
    np.testing.assert_allclose(age_s[stale] - age_s[stale - 1], grown, atol=1e-9)
    assert (scans.rssi_dbm[stale, 0] == scans.rssi_dbm[stale - 1, 0]).all()
    assert age_s.max() <= 20.0
    # Two misses in a row, 0.7^2, make an entry older than 4.6 s.
    assert (age_s > 4.6).mean() == pytest.approx(0.49, abs=0.06)


def test_strong_beacons_are_seldom_missed() -> None:
    parameters = replace(CLEAN, missed_share=0.6)
    points = [point(2.0, 0.0, 1.2), point(100.0, 0.0, 1.2, bssid="b")]
    scans = scans_of(straight_walk(2000, 0.0), points, parameters)
    fresh = (scans.age_s < 1.7).mean(axis=0)
    above_db = scans.rssi_dbm[-1] - parameters.threshold_dbm
    expected = 1 - 0.6 * 0.5 ** (above_db / parameters.missed_halving_db)
    np.testing.assert_allclose(fresh, expected, atol=0.04)


def test_a_new_access_point_leaves_the_shadows_of_the_others() -> None:
    parameters = replace(CLEAN, shadowing_db=6.0)
    one = [point(0.0, 5.0, 2.0)]
    alone, together = (
        scans_of(straight_walk(5, 0.0), points, parameters)
        for points in (one, [*one, point(3.0, 5.0, 2.0, bssid="b")])
    )
    first: F64 = alone.rssi_dbm[:1, 0]
    assert (together.rssi_dbm[:1, 0] == first).all()
