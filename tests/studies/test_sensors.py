"""Simulated sensors beside real ones: planted statistics come out."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Imu, Magnetometer, Recording, Truth, WifiScans
from elfslam.world.simulate import load_world
from studies import sensors
from studies.study import StudyContext

CADENCE_HZ = 1.8
BOUNCE_MPS2 = 4.0
FIELD_LENGTH_M = 3.0


def walk_of(seed: int, length_m: float = 300.0) -> tuple[Recording, Truth]:
    """Straight on at 1 m/s: known cadence, scans and an Ornstein-Uhlenbeck field."""
    generator = np.random.default_rng(seed)
    t_s = np.arange(0.0, length_m, 0.02)
    up = 9.81 + BOUNCE_MPS2 * np.cos(2 * np.pi * CADENCE_HZ * t_s)
    imu = Imu(t_s, np.column_stack([0 * t_s, 0 * t_s, up]), np.zeros((len(t_s), 3)))
    magnitude_ut = 45 + seed + smooth_noise(generator, t_s, FIELD_LENGTH_M)
    field_ut = np.column_stack([0 * t_s, 0 * t_s, -magnitude_ut])
    truth = Truth([0.0, length_m], [[0, 0, np.nan], [length_m, 0, np.nan]])
    field = Magnetometer(t_s, field_ut)
    recording = Recording(f"{seed}", "planted", imu=imu, magnetometer=field, wifi=scans(seed))
    return recording, truth


def smooth_noise(generator: np.random.Generator, t_s: F64, length_m: float) -> F64:
    """Standard deviation 5, correlation exp(-d / length) along a walk at 1 m/s."""
    keep = np.exp(-0.02 / length_m)
    value, rows = generator.standard_normal(), []
    for push in generator.standard_normal(len(t_s)):
        rows.append(value)
        value = keep * value + np.sqrt(1 - keep**2) * push
    return 5 * np.array(rows)


def scans(seed: int) -> WifiScans:
    """One access point with 3 dB of noise, and one that was last seen long before."""
    t_s = 2.0 + 2.5 * np.arange(100)
    noise = 3 * np.random.default_rng([seed, 1]).standard_normal(100)
    rssi_dbm = np.column_stack([-60 - 0.1 * t_s + noise, np.full(100, -90.0)])
    return WifiScans(t_s, ("a", "b"), rssi_dbm, np.tile([1.0, 9.0], (100, 1)))


@pytest.fixture(scope="module")
def planted() -> list[tuple[Recording, Truth]]:
    return [walk_of(seed) for seed in range(6)]


def test_what_was_planted_comes_out(planted: list[tuple[Recording, Truth]]) -> None:
    """The trend of 0.1 dB per metre adds 0.5 dB (over root 2) at 5 m and 1 dB at 10 m to noise."""
    found = sensors.statistics([planted])
    assert found["walks", ""] == 6
    assert found["step rate (Hz)", ""] == pytest.approx(CADENCE_HZ, rel=0.02)
    assert found["scatter of step intervals (share)", ""] < 0.01
    peak = found["acceleration above rest, 99th percentile (m/s2)", ""]
    assert peak == pytest.approx(BOUNCE_MPS2, abs=0.1)
    assert found["gyroscope scatter (rad/s)", "quietest second"] == 0.0
    assert found["time between scans (s)", ""] == pytest.approx(2.5)
    assert found["access points in a scan", ""] == 2
    assert found["stale scan entries (share)", ""] == 0.5
    assert found["RSSI spread (dB)", "0 m"] == pytest.approx(3.0, rel=0.15)
    over_m = [found["RSSI spread (dB)", f"{lag} m"] ** 2 for lag in (5, 10)]
    assert over_m[1] - over_m[0] == pytest.approx((1.0 - 0.25) / 2, abs=0.8)
    total = found["RSSI spread (dB)", "whole walks"] ** 2
    assert total == pytest.approx(9 + (0.1 * 250) ** 2 / 12, rel=0.1)
    assert found["magnetic field, mean (uT)", ""] == pytest.approx(47.5, abs=1.0)
    assert found["magnetic field, spread along a walk (uT)", ""] == pytest.approx(5.0, rel=0.12)
    for lag_m in (1, 2, 5):
        wanted = np.exp(-lag_m / FIELD_LENGTH_M)
        assert found["magnetic field correlation", f"{lag_m} m"] == pytest.approx(wanted, abs=0.09)


def test_uneven_steps_are_told_from_pauses_and_from_another_pace() -> None:
    generator = np.random.default_rng(0)
    noise = 1 + 0.06 * generator.standard_normal(4000)
    pace = np.linspace(0.5, 0.6, 4000)
    pauses = np.where(np.arange(4000) % 50 == 0, 5.0, 0.0)
    assert sensors.unevenness(np.cumsum(0.55 * noise)) == pytest.approx(0.06, rel=0.05)
    assert sensors.unevenness(np.cumsum(pace * noise + pauses)) == pytest.approx(0.06, rel=0.1)


def test_places_are_not_mixed(planted: list[tuple[Recording, Truth]]) -> None:
    """Two floors whose signals differ by 40 dB at the same spot: no spread at one place."""
    (recording, truth), other, *_ = planted
    assert recording.wifi is not None
    wifi = recording.wifi
    louder = WifiScans(wifi.t_s, wifi.bssids, wifi.rssi_dbm + 40, wifi.age_s)
    shifted = Recording("louder", "planted", imu=recording.imu, wifi=louder)
    field = (Recording("f", "planted", imu=other[0].imu, magnetometer=other[0].magnetometer), truth)
    apart = sensors.statistics([[(recording, truth), field], [(shifted, truth)]])
    mixed = sensors.statistics([[(recording, truth), field, (shifted, truth)]])
    assert not apart["RSSI spread (dB)", "0 m"] > 0.01
    assert mixed["RSSI spread (dB)", "0 m"] == pytest.approx(40 / 2**0.5)


def test_waypoints_are_tapped_on_the_way_and_a_little_off() -> None:
    t_s = np.arange(0.0, 600.0, 0.02)
    truth = Truth(t_s, np.column_stack([t_s, 0 * t_s, 0 * t_s]))
    tapped = sensors.as_tapped(truth, np.random.default_rng(0))
    off_m = tapped.world_from_body[:, :2] - np.column_stack([tapped.t_s, 0 * tapped.t_s])
    assert np.diff(tapped.t_s) == pytest.approx(sensors.WAYPOINTS_M, abs=0.05)
    assert off_m.std(axis=0) == pytest.approx([sensors.WAYPOINT_SIGMA_M] * 2, rel=0.2)
    assert np.isnan(tapped.world_from_body[:, 2]).all()


def test_the_simulation_is_near_the_mall(shared_data: Path) -> None:
    """What the constants were chosen for; the hall is the simulated place most like the mall.

    Two walks, since one alone is hardly ever twice within a metre of a place.
    """
    surveyed = sensors.statistics([sensors.simulated_floor(sensors.hall(), 2, "surveyor")])
    strolled = sensors.statistics([sensors.simulated_floor(load_world("studio"), 2, "person")])
    real = sensors.statistics(list(sensors.mall_floors(shared_data, 8)))
    for found, metric, condition, factor in (
        (surveyed, "step rate (Hz)", "", 1.1),
        (surveyed, "time between scans (s)", "", 1.25),
        (surveyed, "access points in a scan", "", 2.0),
        (surveyed, "stale scan entries (share)", "", 1.6),
        (surveyed, "RSSI spread (dB)", "0 m", 1.4),
        (surveyed, "RSSI spread (dB)", "10 m", 1.4),
        (surveyed, "magnetic field, spread along a walk (uT)", "", 1.7),
        (surveyed, "magnetic field correlation", "1 m", 1.2),
        (strolled, "step rate (Hz)", "", 1.15),
        (strolled, "scatter of step intervals (share)", "", 1.4),
        (strolled, "acceleration above rest, 99th percentile (m/s2)", "", 1.5),
        (strolled, "gyroscope scatter (rad/s)", "median second", 1.5),
    ):
        ratio = found[metric, condition] / real[metric, condition]
        assert 1 / factor < ratio < factor, (metric, condition)


def test_a_folder_without_mall_walks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no mall_walks/\*.tar.xz"):
        sensors.measure_sensors(StudyContext(tmp_path), walks=1)
