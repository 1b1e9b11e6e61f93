"""Logs of GetSensorData, with planted values and the damage that logs have."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.data.geographic import Origin, to_lon_lat
from elfslam.data.getsensordata import read_getsensordata

HEADER = """% LogFile created by the 'GetSensorData' App for Android.
% Phone used for this logfile:
% Manufacturer:            \tSamsung
% Model:                   \tSM-A520F
% LogFile Data format:
% Accelerometer data: \t'ACCE;AppTimestamp(s);SensorTimestamp(s);Acc_X(m/s^2);...'
"""
START_S = 2.5
T_S = np.arange(150) * 0.02
BOOT_S = 41_234.125
"""Between the app's clock and the sensors'."""
TILT = 0.4
UP = np.array([0.0, np.sin(TILT), np.cos(TILT)])
ORIGIN = Origin(40.3133, -3.4837)


def record(kind: str, values: Iterable[float], delays_s: np.ndarray | None = None) -> list[str]:
    """A line per time: the sensor's is exact, the app's comes late by a delay of its own."""
    late = np.zeros(len(T_S)) if delays_s is None else delays_s
    cells = ";".join(f"{value:.6f}" for value in values)
    return [
        f"{kind};{START_S + t_s + delay_s:.4f};{t_s + BOOT_S:.6f};{cells};3"
        for t_s, delay_s in zip(T_S, late, strict=True)
    ]


def motion(delays_s: np.ndarray | None = None) -> list[str]:
    return [*record("ACCE", 9.81 * UP, delays_s), *record("GYRO", [0.1, -0.2, 0.3])]


def log(folder: Path, lines: Iterable[str]) -> Path:
    (folder / "T01.txt").write_text(HEADER + "\n".join(lines) + "\n", encoding="utf-8")
    return folder / "T01.txt"


def test_motion_is_on_the_clock_of_the_app_with_the_steps_of_the_sensor(tmp_path: Path) -> None:
    delays_s = np.random.default_rng(0).uniform(0, 0.02, len(T_S))
    lines = [*motion(delays_s), *record("MAGN", [10, 20, -30])]
    read = read_getsensordata(log(tmp_path, lines))
    recording = read.recording
    assert (recording.name, recording.device) == ("T01", "Samsung SM-A520F")
    np.testing.assert_allclose(np.diff(recording.imu.t_s), 0.02, atol=1e-5)
    np.testing.assert_allclose(recording.imu.t_s[-1] - recording.magnetometer.t_s[-1], 0, atol=0.02)
    np.testing.assert_allclose(recording.imu.accel_mps2[7], 9.81 * UP, atol=1e-5)
    np.testing.assert_allclose(recording.imu.gyro_radps[7], [0.1, -0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(recording.magnetometer.field_ut[7], [10, 20, -30])
    assert read.damaged_lines == 0
    assert read.truth is None


def test_a_sensor_whose_clock_runs_otherwise_keeps_the_app_s(tmp_path: Path) -> None:
    zero = [line.replace(line.split(";")[2], "0.000000", 1) for line in record("MAGN", [1, 2, 3])]
    recording = read_getsensordata(log(tmp_path, [*motion(), *zero])).recording
    np.testing.assert_allclose(recording.magnetometer.t_s, T_S, atol=0.02)


def test_the_attitude_lacks_its_w_and_agrees_with_gravity(tmp_path: Path) -> None:
    xyz = [np.sin(TILT / 2), 0, 0]
    lines = [*motion(), *record("AHRS", [22.9, 0.0, 0.0, *xyz])]
    attitude = read_getsensordata(log(tmp_path, lines)).recording.orientation.world_from_phone
    np.testing.assert_allclose(rotation_from_quaternion(attitude[3]) @ UP, [0, 0, 1], atol=1e-5)


def test_networks_of_both_versions_are_read(tmp_path: Path) -> None:
    lines = [
        "WIFI;3.5;41235.2;eduroam;00:0B:86:27:36:c1;2412;-70",
        "WIFI;3.5;41235.2;a;b;c;00:0b:86:27:36:c2;5180;-60",  # a name with semicolons
        "WIFI;4.5;41236.2;;00:0b:86:27:36:c1;-71;",  # no frequency, and a semicolon at the end
    ]
    wifi = read_getsensordata(log(tmp_path, [*motion(), *lines])).recording.wifi
    assert wifi.bssids == ("00:0b:86:27:36:c1", "00:0b:86:27:36:c2")
    np.testing.assert_allclose(wifi.t_s, [1.0, 2.0])
    np.testing.assert_array_equal(wifi.rssi_dbm, [[-70, -60], [-71, np.nan]])


def test_landmarks_become_waypoints_in_metres(tmp_path: Path) -> None:
    xy_m = np.array([[0.0, 0.0], [12.5, 0.0], [12.5, -8.25]])
    lon_lat = to_lon_lat(ORIGIN, xy_m)
    numbered = enumerate(lon_lat)
    lines = [f"POSI;{START_S + k};{k + 1};{b:.10f};{a:.10f};1;2" for k, (a, b) in numbered]
    upstairs = f"POSI;{START_S + 9};4;{ORIGIN.latitude_deg + 1e-3};{ORIGIN.longitude_deg};2;2"
    truth = read_getsensordata(log(tmp_path, [*motion(), *lines, upstairs])).truth
    np.testing.assert_allclose(truth.t_s, [0, 1, 2], atol=1e-9)
    np.testing.assert_allclose(truth.world_from_body[:, :2], xy_m, atol=1e-3)
    assert np.isnan(truth.world_from_body[:, 2]).all()


def test_with_a_barometer_landmarks_of_all_floors_are_the_truth(tmp_path: Path) -> None:
    lines = [
        f"POSI;{START_S + k / 2};{k + 1};{ORIGIN.latitude_deg};{ORIGIN.longitude_deg};{floor};2"
        for k, floor in enumerate([1, 1, 3, 3])
    ]
    elsewhere = f"POSI;{START_S + 9};5;{ORIGIN.latitude_deg};{ORIGIN.longitude_deg};1;4"
    pressed = record("PRES", [1003.25])
    read = read_getsensordata(log(tmp_path, [*motion(), *pressed, *lines, elsewhere]))
    assert read.damaged_lines == 0
    barometer, levels = read.recording.barometer, read.truth.levels
    np.testing.assert_allclose(barometer.pressure_hpa, 1003.25)
    np.testing.assert_allclose(barometer.t_s, T_S, atol=0.02)
    np.testing.assert_allclose(read.truth.t_s, [0, 0.5, 1, 1.5], atol=1e-9)
    at = levels.at(np.array([0.0, 0.5, 0.8, 1.0, 1.5]))
    np.testing.assert_array_equal(at, [1, 1, np.nan, 3, 3])


def test_a_decimal_comma_is_one(tmp_path: Path) -> None:
    lines = [line.replace(".", ",") for line in motion()]
    imu = read_getsensordata(log(tmp_path, lines)).recording.imu
    np.testing.assert_allclose(imu.accel_mps2[0], 9.81 * UP, atol=1e-5)


@pytest.mark.parametrize(
    "bad",
    [
        "ACCE;2.51;41234.135;1;2;x;3",
        "ACCE;2.51;41234.135;1;2;nan;3",
        "ACCE;2.51;41234.135;1;2;1e160;3",
        "ACCE;5000;41234.135;0;0;9.81;3",  # leaps ahead of every other
        "POSI;3;1;140.0;0;0;0",
        "WIFI;3.5;41235.2;eduroam;no address;2412;-70",
        "ACCE;2.5;41234.1;0;0;9.8GYRO;2.5;1;2;3",
        "\x00\x01;;;",
    ],
)
def test_a_damaged_line_is_counted_and_costs_no_other(tmp_path: Path, bad: str) -> None:
    whole = motion()
    read = read_getsensordata(log(tmp_path, [*whole[:20], bad, *whole[20:], "PRES;1;2;1013;3"]))
    assert read.damaged_lines == 1
    clean = read_getsensordata(log(tmp_path, whole)).recording.imu
    np.testing.assert_array_equal(read.recording.imu.t_s, clean.t_s)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda lines: [line for line in lines if line[0] == "G"], "has no ACCE lines"),
        (lambda lines: lines[:150], "has no GYRO lines"),
        (lambda lines: [], "wanted a text log of GetSensorData"),
        (
            lambda lines: (
                [line.replace("ACCE", "LACC").replace("GYRO", "ACCE") for line in lines]
                + lines[150:]
            ),
            "give m/s2 with gravity left in",
        ),
    ],
)
def test_a_file_that_is_no_such_log_is_refused(
    tmp_path: Path, change: Callable[[list[str]], list[str]], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        read_getsensordata(log(tmp_path, change(motion())))
