"""Absorption in air against the tables of the standard."""

from __future__ import annotations

import pytest

from elfslam.world.air import absorption_db_per_m

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


def test_one_kilohertz_at_room_temperature() -> None:
    """ISO 9613-1:1993, table 1: 20 degrees Celsius, 50 %, 1 kHz gives 4.66 dB/km."""
    assert absorption_db_per_m(1000.0) == pytest.approx(4.66e-3, abs=5e-6)


def test_the_chirp_loses_four_tenths_of_a_decibel_per_metre() -> None:
    assert 0.3 < absorption_db_per_m(15_000.0) < absorption_db_per_m(17_500.0) < 0.5
    assert absorption_db_per_m(17_500.0) < absorption_db_per_m(20_000.0) < 0.6
