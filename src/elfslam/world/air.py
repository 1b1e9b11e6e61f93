"""Sound in air: speed and absorption."""

from __future__ import annotations

import math

SPEED_OF_SOUND_MPS = 343.0
"""At 20 degrees Celsius, rounded as is usual; `speed_of_sound_mps` gives 343.2 there."""


def speed_of_sound_mps(temperature_c: float) -> float:
    """Speed of sound in air of this temperature (ISO 9613-1:1993, annex A)."""
    return 343.2 * math.sqrt((temperature_c + 273.15) / 293.15)


def absorption_db_per_m(
    frequency_hz: float, temperature_c: float = 20.0, humidity_percent: float = 50.0
) -> float:
    """Attenuation of a pure tone in air at normal pressure (ISO 9613-1:1993, equations 3 to 5)."""
    kelvin = temperature_c + 273.15
    relative = kelvin / 293.15
    saturation = 10 ** (-6.8346 * (273.16 / kelvin) ** 1.261 + 4.6151)
    vapour_percent = humidity_percent * saturation
    oxygen_hz = 24 + 4.04e4 * vapour_percent * (0.02 + vapour_percent) / (0.391 + vapour_percent)
    nitrogen_hz = relative**-0.5 * (
        9 + 280 * vapour_percent * math.exp(-4.170 * (relative ** (-1 / 3) - 1))
    )
    oxygen = 0.01275 * math.exp(-2239.1 / kelvin) / (oxygen_hz + frequency_hz**2 / oxygen_hz)
    nitrogen = 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen_hz + frequency_hz**2 / nitrogen_hz)
    classical = 1.84e-11 * relative**0.5
    return float(8.686 * frequency_hz**2 * (classical + relative**-2.5 * (oxygen + nitrogen)))
