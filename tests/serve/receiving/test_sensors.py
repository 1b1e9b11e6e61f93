"""Curves of sensors: no peak is lost, gaps stay gaps, and few numbers are enough."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from elfslam.base.values import Audio, Barometer, Imu, Magnetometer, Recording, WifiScans
from elfslam.serve.receiving.reader import MOST_STRETCHES, Curve, Look, curve, look_at, loudness
from elfslam.stages.chirp import ChirpParameters, make_chirp

T_S = np.arange(3000) / 100


def walk(**more: object) -> Recording:
    return Recording("walk", "phone", **more)  # type: ignore[arg-type]


def by_name(look: Look) -> dict[str, Curve]:
    return {each.name: each for each in look.curves}


def known(values: list[float | None]) -> np.ndarray:
    return np.array([value for value in values if value is not None])


def test_a_peak_of_one_sample_is_kept() -> None:
    values = np.sin(T_S)
    values[1234], values[77] = 9.0, -7.0
    made = curve("any", "1", T_S, values)
    assert len(made.low) == len(made.high) == MOST_STRETCHES
    assert (max(known(made.high)), min(known(made.low))) == (9.0, -7.0)
    at = int(np.argmax(known(made.high)))
    assert made.start_s + at * made.step_s <= T_S[1234] <= made.start_s + (at + 1) * made.step_s


def test_low_and_high_hold_every_value_of_their_stretch() -> None:
    values = np.random.default_rng(3).normal(size=len(T_S))
    made = curve("any", "1", T_S, values)
    low, high = known(made.low), known(made.high)
    at = np.minimum((T_S / made.step_s).astype(int), MOST_STRETCHES - 1)
    assert (values >= low[at] - 1e-4).all()
    assert (values <= high[at] + 1e-4).all()


def test_where_nothing_was_read_there_is_a_gap() -> None:
    kept = (T_S < 10) | (T_S > 20)
    made = curve("any", "1", T_S[kept], T_S[kept])
    middle = made.low[round(12 / made.step_s) : round(18 / made.step_s)]
    assert middle
    assert set(middle) == {None}


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_readings_are_no_more_stretches(count: int) -> None:
    made = curve("any", "1", T_S[:count], T_S[:count] + 1)
    assert len(made.low) == count
    np.testing.assert_allclose(known(made.low), T_S[:count] + 1, rtol=1e-4)


def test_a_turn_about_the_vertical_is_told_in_degrees_however_the_phone_is_held() -> None:
    """Turned by 90 degrees a second between 10 and 15 s, the screen upright."""
    turning = np.where((T_S > 10) & (T_S < 15), np.pi / 2, 0.0)
    accel = np.tile([0.0, 9.81, 0.0], (len(T_S), 1))
    gyro = np.column_stack([0 * T_S, turning, 0 * T_S])
    told = by_name(look_at(walk(imu=Imu(T_S, accel, gyro))))["yaw rate"]
    seconds = told.start_s + (np.arange(len(told.high)) + 0.5) * told.step_s
    high = np.array(told.high, dtype=float)
    np.testing.assert_allclose(high[(seconds > 10.5) & (seconds < 14.5)], 90, atol=0.5)
    np.testing.assert_allclose(high[(seconds < 9.5) | (seconds > 15.5)], 0, atol=0.5)
    assert by_name(look_at(walk(imu=Imu(T_S, accel, gyro))))["acceleration"].high[0] == 9.81


def test_sound_is_told_in_decibels_of_full_scale() -> None:
    rate_hz = 44_100
    tone = 0.1 * np.sin(2 * np.pi * 1000 * np.arange(rate_hz) / rate_hz)
    sound = np.concatenate([tone, np.zeros(rate_hz)]).astype(np.float32)
    t_s, level_db = loudness(Audio(sound[None], rate_hz))
    np.testing.assert_allclose(level_db[:10], 20 * np.log10(0.1 / np.sqrt(2)), atol=0.01)
    np.testing.assert_array_equal(level_db[10:], -120)
    np.testing.assert_allclose(t_s[:2], [0.05, 0.15])


def test_field_and_access_points_and_rates() -> None:
    field = np.tile([30.0, 40.0, 0.0], (len(T_S), 1))
    scans = WifiScans(
        np.array([1.0, 5.0]),
        ("a", "b"),
        np.array([[-50.0, np.nan], [-60.0, -70.0]]),
        np.full((2, 2), np.nan),
    )
    air = Barometer(T_S[::10], np.full(len(T_S[::10]), 1003.25))
    look = look_at(walk(magnetometer=Magnetometer(T_S, field), barometer=air, wifi=scans))
    assert set(known(by_name(look)["air pressure"].low)) == {1003.25}
    assert set(known(by_name(look)["magnetic field"].high)) == {50.0}
    assert list(known(by_name(look)["access points"].high)) == [1, 2]
    rates = {each.name: (each.readings, each.rate_hz) for each in look.sensors}
    assert rates.pop("barometer") == (300, 10.0)
    assert rates == {"magnetometer": (3000, 100.0), "wifi": (2, 0.25)}


def test_hours_are_few_numbers() -> None:
    t_s = np.arange(100_000) / 10
    accel = np.tile([0.0, 0.0, 9.8], (len(t_s), 1))
    field = Magnetometer(t_s, accel)
    look = look_at(walk(imu=Imu(t_s, accel, 0 * accel), magnetometer=field))
    text = json.dumps(asdict(look), allow_nan=False)
    assert sum(len(each.low) + len(each.high) for each in look.curves) <= 3 * 2 * MOST_STRETCHES
    assert len(text) < 40_000


def test_a_recording_of_nothing_has_nothing_to_show() -> None:
    assert look_at(walk()) == Look([], [], None, None)
    played = look_at(walk(played_t_s=np.array([0.1, 0.2])))
    assert played.chirps_played == 2


def chirping(missing: int) -> Audio:
    """Four seconds of chirps ten times a second, the last so many of them silent."""
    chirp = make_chirp(ChirpParameters(), 44_100)
    sound = np.random.default_rng(1).normal(0, 1e-4, (1, 4 * 44_100)).astype(np.float32)
    for k in range(40 - missing):
        at = 1000 + 4410 * k
        sound[0, at : at + len(chirp.samples)] += 0.5 * chirp.samples[: 4 * 44_100 - at]
    return Audio(sound, 44_100)


def test_the_share_of_chirps_that_are_heard() -> None:
    due_s = (1000 + 4410 * np.arange(40)) / 44_100
    share = [
        look_at(walk(audio=chirping(missing), played_t_s=due_s)).chirps_heard_share
        for missing in (0, 10)
    ]
    assert share == pytest.approx([1.0, 0.75], abs=0.03)
    assert look_at(walk(audio=chirping(0))).chirps_heard_share == pytest.approx(1, abs=0.03)


def test_sound_without_chirps_holds_none() -> None:
    noise = np.random.default_rng(2).normal(0, 0.01, (1, 3 * 44_100)).astype(np.float32)
    assert look_at(walk(audio=Audio(noise, 44_100))).chirps_heard_share == 0
