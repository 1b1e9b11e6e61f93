"""Laws of acoustics by mirror images: decay by Eyring, level by distance, reciprocity."""

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS
from elfslam.world.materials import Material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, air_at, image_echoes
from elfslam.world.pulses import BASEBAND_HZ, C64
from elfslam.world.room import shoebox
from elfslam.world.scene import scene_of

DECAY_DB = (-5.0, -25.0)
LONG = Reach(longest_m=34.0, order=24, plan_order=24)
"""A frame's length of sound, with all reflections within it."""
PLACES = 40
SIZES_M = ((4.0, 4.3, 3.8), (5.0, 4.6, 4.8), (3.2, 3.0, 3.5))


def eyring_s(size_m: tuple[float, float, float], absorption: float) -> float:
    """Time in which sound falls by 60 dB in a diffuse field, walls and air taken together.

    Eyring, J. Acoust. Soc. Am. 1, 1930, with the air of Knudsen, ibid. 3, 1931.
    """
    x, y, z = size_m
    surface_m2, air = 2 * (x * y + y * z + z * x), air_at()
    area_m2 = -surface_m2 * np.log(1 - absorption) + 8 * air.attenuation_per_m * x * y * z
    return float(24 * np.log(10) * x * y * z / (air.speed_mps * area_m2))


def decay_s(size_m: tuple[float, float, float], absorption: float) -> float:
    """The same from sound: backward integration (Schroeder, 1965) of a mean over places."""
    generator = np.random.default_rng(17)
    speaker, microphone = generator.uniform(0.5, np.array(size_m) - 0.5, (2, PLACES, 3))
    responses = heard(size_m, absorption, omnidirectional(speaker, microphone), LONG)
    left = np.cumsum((np.abs(responses) ** 2).mean(axis=0)[::-1])[::-1]
    level_db = 10 * np.log10(left / left[0])
    within = (level_db < DECAY_DB[0]) & (level_db > DECAY_DB[1])
    t_s = np.arange(BAND_BINS) / BASEBAND_HZ
    return float(-60 / np.polyfit(t_s[within], level_db[within], 1)[0])


def heard(
    size_m: tuple[float, float, float], absorption: float, ends: Transducers, reach: Reach
) -> C64:
    room = shoebox(np.array(size_m), (Material("surface", absorption, 0.0, "uniform"),) * 6)
    nobody = np.zeros((len(ends.speaker), 0, 2))
    return image_echoes(scene_of(room), ends, nobody, air_at(), reach, threads=2)


def omnidirectional(speaker: F64, microphone: F64) -> Transducers:
    count = len(speaker)
    axis, ahead = np.tile([1.0, 0.0, 0.0], (count, 1)), np.tile([1.0, 0.0], (count, 1))
    still = np.zeros((count, 3))
    return Transducers(speaker, microphone, axis, axis, ahead, still, still, 0.0, 0.0, False)


@pytest.mark.parametrize("size_m", SIZES_M)
@pytest.mark.parametrize("absorption", [0.4, 0.6])
def test_sound_decays_as_by_eyring(size_m: tuple[float, float, float], absorption: float) -> None:
    assert decay_s(size_m, absorption) == pytest.approx(eyring_s(size_m, absorption), rel=0.1)


def test_eyring_of_a_cube() -> None:
    """4 m, half absorbed, air left out: 0.161 x 64 / (96 ln 2) = 0.155 s; air shortens it."""
    dry_s, air = 0.155, 8 * 64 * 0.047 / (96 * np.log(2))
    assert eyring_s((4.0, 4.0, 4.0), 0.5) == pytest.approx(dry_s / (1 + air), rel=0.15)
