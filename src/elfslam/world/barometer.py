"""What a phone's barometer reads: height, weather, doors, wind and noise."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from elfslam.base.arrays import F64
from elfslam.base.values import Barometer
from elfslam.world.imu import GRAVITY_MPS2, gauss_markov, sample_times
from elfslam.world.walker import Motion

RATE_HZ = 25.0
"""As Android phones log it; iPhones give one a second."""
GAS_CONSTANT_JPKGK = 287.05
"""Of dry air."""
INDOORS_K = 294.15
ENTRANCE_HPA = (990.0, 1030.0)
WEATHER_HPAPH = 1.0
"""The fastest trend, either way; three times as fast is called a rapid change at sea."""
NOISE_HPA = 0.02
"""The data sheet of the Bosch BMP280 has 1.3 to 3.3 Pa without its filter, by oversampling."""
SLOW_HPA, SLOW_S = 0.02, 120.0
"""Of ventilation and of the sensor as it warms in the hand; estimates."""
DOORS_PER_MIN = 0.3
DOOR_HPA, DOOR_S = (0.05, 0.2), (1.5, 12.0)
"""How much a door of a ventilated building holds back, and within what time it evens out, until it
is shut again: estimates, of the size by which such buildings are held above the open."""
GUST_HPA, GUST_S = 0.06, 2.0
"""The pressure of a wind of 4 m/s at a door, about."""
WINDY_M, WINDY_LOW_M = 8.0, 2.5
"""So near an entrance wind is felt, and on its floor alone."""


def pressure_at(ground_hpa: float, height_m: F64) -> F64:
    """The barometric formula for air of one temperature: pressure (n) at heights (n)."""
    scale_m = GAS_CONSTANT_JPKGK * INDOORS_K / GRAVITY_MPS2
    return np.asarray(ground_hpa * np.exp(-height_m / scale_m))


def read_barometer(
    motion: Motion,
    generator: np.random.Generator,
    doors_s: Sequence[float] = (),
    entrances_m: F64 | None = None,
) -> Barometer:
    """Pressure along a walk, whose heights are above the entrance.

    Besides height: a trend of the weather, slow unrest and noise, jumps that decay whenever a door
    opens (at `doors_s`, and now and then), and gusts near entrances (n, 2).
    """
    t_s = sample_times(motion, RATE_HZ)
    height_m = np.interp(t_s, motion.t_s, motion.position_m[:, 2])
    pressure = pressure_at(generator.uniform(*ENTRANCE_HPA), height_m)
    pressure += generator.uniform(-WEATHER_HPAPH, WEATHER_HPAPH) * t_s / 3600
    pressure += SLOW_HPA * gauss_markov(generator, (len(t_s), 1), SLOW_S, RATE_HZ)[:, 0]
    pressure += _doors(t_s, doors_s, generator)
    gusts = gauss_markov(generator, (len(t_s), 1), GUST_S, RATE_HZ)[:, 0]
    pressure += GUST_HPA * _exposure(motion, t_s, entrances_m) * gusts
    return Barometer(t_s, pressure + NOISE_HPA * generator.standard_normal(len(t_s)))


def _doors(t_s: F64, doors_s: Sequence[float], generator: np.random.Generator) -> F64:
    """Jumps of the pressure (n), up or down, that decay as air flows through the door."""
    chance = generator.poisson(DOORS_PER_MIN * t_s[-1] / 60)
    moments = np.append(np.asarray(doors_s, np.float64), generator.uniform(0, t_s[-1], chance))
    jumps = np.zeros(len(t_s))
    for moment in moments:
        size = generator.uniform(*DOOR_HPA) * generator.choice([-1, 1])
        after = t_s - moment
        decay = np.exp(-np.maximum(after, 0.0) / generator.uniform(*DOOR_S))
        jumps += np.where(after >= 0, size * decay, 0.0)
    return np.asarray(gaussian_filter1d(jumps, 0.2 * RATE_HZ))


def _exposure(motion: Motion, t_s: F64, entrances_m: F64 | None) -> F64:
    """How much of the wind is felt (n): all at an entrance, none far from it."""
    if entrances_m is None or not len(entrances_m):
        return np.zeros(len(t_s))
    xy = np.column_stack([np.interp(t_s, motion.t_s, motion.position_m[:, k]) for k in range(2)])
    away_m = np.linalg.norm(xy[:, None] - entrances_m, axis=2).min(axis=1)
    is_low = np.abs(np.interp(t_s, motion.t_s, motion.position_m[:, 2])) < WINDY_LOW_M
    return np.asarray(is_low * np.exp(-((away_m / WINDY_M) ** 2)))
