"""How an echo's spectrum at one spot changes with height, heading and the days that pass."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F64
from elfslam.baselines.generic import PSD_BAND_HZ, power_spectral_density
from elfslam.world.circumstances import Circumstances, air_on, room_on
from elfslam.world.world_file import World, load_world
from studies.results import Record, mean_of
from studies.still_phone import HEIGHT_M, Listener, hear_at, held_still, listener_in
from studies.study import Study, StudyContext

ECHOES = 40
"""Of which a spectrum is the mean."""
SPOTS = 32
HEIGHT, YAW, AGE, ELSEWHERE = "cm high", "degrees of yaw", "days", "another spot"
SWEEPS: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        HEIGHT: (100, 105, 110, 115, 120, 125, 130),
        YAW: (0, 10, 20, 30, 40, 60, 90, 135, 180),
        AGE: (0, 5, 10, 20, 30),
    }
)
"""The first of each is the reference; it is heard a second time, and compared with itself."""
DRAWN: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {HEIGHT: (100, 110, 130), YAW: (0, 40, 90), AGE: (0, 10, 30)}
)
"""Of which the spectra of one spot are kept."""
WHOLE, PLACE, LEVEL = "correlation", "correlation without the phone's spectrum", "level off by (dB)"
POWER_DB = "power (dB)"
PSD = "PSD"


def measure_stability(context: StudyContext, *, spots: int = SPOTS) -> list[Record]:
    """Correlation and level of spectra at that many spots of the lab, and the spectra of the first.

    After the paper, section 4.2. What correlates is the power spectral density in dB, as it is
    and without its mean over the spots, which is the phone's own. Intervals are over spots.
    """
    world, generator = load_world("lab"), np.random.default_rng([30, spots])
    spots_m = generator.choice(world.spots_m, spots, replace=False)
    records: list[Record] = []
    for k, (varied, values) in enumerate(SWEEPS.items()):
        context.announce(varied, k / len(SWEEPS))
        reference = _spectra(world, spots_m, varied, values[0], generator)
        again = {at: _spectra(world, spots_m, varied, at, generator) for at in values}
        for at, spectra in again.items():
            records += _records(f"{at:g} {varied}", compared(reference, spectra))
        for at in DRAWN[varied]:
            records += _spectrum_records(f"{at:g} {varied}", again[at][0])
    return records + list(_records(ELSEWHERE, compared_elsewhere(reference)))


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
    """Mean power (spots, 71) in dB, heard at every spot by a phone held still."""
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


def _records(condition: str, found: Mapping[str, F64]) -> Iterator[Record]:
    for metric, values in found.items():
        yield mean_of(Record(PSD, metric, 0.0, world="lab", condition=condition), values)


def _spectrum_records(method: str, spectrum_db: F64) -> Iterator[Record]:
    """The spectrum of one spot; its method is what was varied, so that each is a curve."""
    for khz, power_db in zip(np.linspace(*PSD_BAND_HZ, len(spectrum_db)) / 1000, spectrum_db,
                             strict=True):  # fmt: skip
        yield Record(method, POWER_DB, round(float(power_db), 2), condition=f"{khz:.4g} kHz")


STUDY = Study(
    "Does the spectrum of a spot stay when the phone is held higher, turned, or a month later?",
    measure_stability, minutes=4, fast={"spots": 3},
)  # fmt: skip
