"""Absorption in air against the tables of the standard."""

from __future__ import annotations

import pytest

from elfslam.world.pulses import SPEED_OF_SOUND_MPS, absorption_db_per_m, speed_of_sound_mps

OCTAVES_HZ = [1000.0 * 10 ** (0.3 * k) for k in range(-4, 4)]
"""Exact midband frequencies of the octaves named 63 Hz to 8 kHz."""

# ISO 9613-2:1996, table 2: (degrees Celsius, percent) and dB/km per octave.
TABLE = {
    (10, 70): [0.1, 0.4, 1.0, 1.9, 3.7, 9.7, 32.8, 117],
    (20, 70): [0.1, 0.3, 1.1, 2.8, 5.0, 9.0, 22.9, 76.6],
    (30, 70): [0.1, 0.3, 1.0, 3.1, 7.4, 12.7, 23.1, 59.3],
    (15, 20): [0.3, 0.6, 1.2, 2.7, 8.2, 28.2, 88.8, 202],
    (15, 50): [0.1, 0.5, 1.2, 2.2, 4.2, 10.8, 36.2, 129],
    (15, 80): [0.1, 0.3, 1.1, 2.4, 4.1, 8.3, 23.7, 82.8],
}


@pytest.mark.parametrize(("weather", "expected"), TABLE.items(), ids=str)
def test_the_table_of_the_standard_comes_out(
    weather: tuple[int, int], expected: list[float]
) -> None:
    temperature_c, humidity_percent = weather
    for frequency_hz, db_per_km in zip(OCTAVES_HZ, expected, strict=True):
        rounding = 0.5 if db_per_km > 100 else 0.06
        computed = 1000 * absorption_db_per_m(frequency_hz, temperature_c, humidity_percent)
        assert computed == pytest.approx(db_per_km, abs=rounding)


# ISO 9613-1:1993, table 1: (degrees Celsius, percent, one-third octaves above 1 kHz) and dB/km.
HIGH_TABLE = {
    (20, 80, 10): 105,
    (20, 15, 8): 175,
    (0, 10, 9): 26.4,
    (10, 10, 9): 69.4,
    (50, 10, 9): 155,
    (50, 70, 9): 80.3,
}


@pytest.mark.parametrize(("weather", "expected"), HIGH_TABLE.items(), ids=str)
def test_the_highest_bands_of_the_standard_come_out(
    weather: tuple[int, int, int], expected: float
) -> None:
    temperature_c, humidity_percent, third = weather
    computed = 1000 * absorption_db_per_m(10 ** (3 + third / 10), temperature_c, humidity_percent)
    assert computed == pytest.approx(expected, rel=5e-3)


def test_ten_kilohertz_at_room_temperature() -> None:
    assert absorption_db_per_m(10_000.0) == pytest.approx(0.159, abs=5e-4)


@pytest.mark.parametrize(("temperature_c", "expected_mps"), [(0, 331.3), (20, 343.2), (40, 354.7)])
def test_the_speed_of_sound_is_the_one_of_the_tables(
    temperature_c: float, expected_mps: float
) -> None:
    assert speed_of_sound_mps(temperature_c) == pytest.approx(expected_mps, abs=0.06)


def test_the_constant_is_the_speed_at_room_temperature() -> None:
    assert speed_of_sound_mps(20.0) == pytest.approx(SPEED_OF_SOUND_MPS, abs=0.25)


def test_one_kilohertz_at_room_temperature() -> None:
    """ISO 9613-1:1993, table 1: 20 degrees Celsius, 50 %, 1 kHz gives 4.66 dB/km."""
    assert absorption_db_per_m(1000.0) == pytest.approx(4.66e-3, abs=5e-6)


def test_the_chirp_loses_four_tenths_of_a_decibel_per_metre() -> None:
    assert 0.3 < absorption_db_per_m(15_000.0) < absorption_db_per_m(17_500.0) < 0.5
    assert absorption_db_per_m(17_500.0) < absorption_db_per_m(20_000.0) < 0.6
