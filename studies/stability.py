"""How an echo's spectrum at one spot changes with height, heading and the days that pass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F64
from elfslam.baselines.generic import power_spectral_density
from elfslam.world.circumstances import Circumstances, air_on, room_on
from elfslam.world.world_file import World
from studies.results import Record, mean_of
from studies.still_phone import HEIGHT_M, Listener, hear_at, held_still, listener_in

ECHOES = 40
"""Of which a spectrum is the mean."""
HEIGHT, YAW, AGE = "cm high", "degrees turned", "days later"
ELSEWHERE = "another spot"
SWEEPS: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        HEIGHT: (100, 105, 110, 115, 120, 125, 130),
        YAW: (0, 10, 20, 30, 40, 60, 90, 135, 180),
        AGE: (0, 5, 10, 20, 30),
    }
)
"""The first of each is the reference; it is recorded a second time, and compared with itself."""
WHOLE, PLACE = "correlation of spectra", "correlation of spectra less the mean spot's"
LEVEL = "difference in level (dB)"


def measure_stability(world: World, spots: int) -> list[Record]:
    """Correlation and level at that many spots of the world, by height, heading and age.

    After the paper, section 3.2. What correlates is the power spectral density in dB, as it is
    and without its mean over the spots, which is the phone's own. Intervals are over spots.
    """
    generator = np.random.default_rng([30, spots])
    spots_m = generator.choice(world.spots_m, spots, replace=False)
    records: list[Record] = []
    elsewhere: Mapping[str, F64] = {}
    for varied, values in SWEEPS.items():
        reference = _spectra(world, spots_m, varied, values[0], generator)
        for at in values:
            again = _spectra(world, spots_m, varied, at, generator)
            records += _records(world, f"{at:g} {varied}", compared(reference, again))
        elsewhere = compared_elsewhere(reference)
    return records + _records(world, ELSEWHERE, elsewhere)


def compared(reference: F64, spectra: F64) -> dict[str, F64]:
    """Correlations and levels (spots) of spectra in dB (spots, 71) at the same spots."""
    phone = reference.mean(axis=0)
    return {
        WHOLE: _correlation(reference, spectra),
        PLACE: _correlation(reference - phone, spectra - phone),
        LEVEL: np.abs(_level_db(reference) - _level_db(spectra)),
    }


def compared_elsewhere(reference: F64) -> dict[str, F64]:
    """The same (spots) for each spot against all others, on average."""
    turned = [compared(reference, np.roll(reference, k, axis=0)) for k in range(1, len(reference))]
    return {name: np.mean([each[name] for each in turned], axis=0) for name in turned[0]}


def _spectra(
    world: World, spots_m: F64, varied: str, at: float, generator: np.random.Generator
) -> F64:
    """Mean power (spots, 71) in dB at every spot, by a phone held still."""
    day = Circumstances(day=int(at) if varied == AGE else 0)
    listener = listener_in(room_on(world, day), air=air_on(world, day.day))
    height_m = at / 100 if varied == HEIGHT else HEIGHT_M
    yaw_rad = np.deg2rad(at) if varied == YAW else 0.0
    return np.stack(
        [_spectrum(listener, spot_m, height_m, yaw_rad, generator) for spot_m in spots_m]
    )


def _spectrum(
    listener: Listener, xy_m: F64, height_m: float, yaw_rad: float, generator: np.random.Generator
) -> F64:
    poses = held_still(xy_m, ECHOES, generator, height_m=height_m, yaw_rad=yaw_rad)
    power = power_spectral_density(hear_at(listener, poses, generator))
    return np.asarray(10 * np.log10(power.mean(axis=0, dtype=np.float64)))


def _level_db(spectra_db: F64) -> F64:
    return np.asarray(10 * np.log10((10 ** (spectra_db / 10)).sum(axis=1)))


def _correlation(first: F64, second: F64) -> F64:
    """Pearson's correlation of each row."""
    a = first - first.mean(axis=1, keepdims=True)
    b = second - second.mean(axis=1, keepdims=True)
    length = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.asarray((a * b).sum(axis=1) / length)


def _records(world: World, condition: str, found: Mapping[str, F64]) -> list[Record]:
    of = Record("echo spectrum", "", 0.0, world=world.name, scenario="controlled",
                condition=condition)  # fmt: skip
    return [mean_of(replace(of, metric=metric), values) for metric, values in found.items()]
