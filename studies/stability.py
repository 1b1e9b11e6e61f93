"""How an echo's spectrum at one spot changes with height, heading and the days that pass."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F64
from elfslam.baselines.generic import PSD_BAND_HZ, power_spectral_density
from elfslam.scoring.page import Panel
from elfslam.world.circumstances import Circumstances, air_on, room_on
from elfslam.world.world_file import World
from studies.figures.curves import Curve, curves_figure, shades
from studies.finding import Row
from studies.intervals import curve_of, mean_row
from studies.still_phone import HEIGHT_M, Listener, hear_at, held_still, listener_in

ECHOES = 40
"""Of which a spectrum is the mean."""
HEIGHT, YAW, AGE, ELSEWHERE = "altitude (cm)", "yaw (degrees)", "age (days)", "another spot"
SWEEPS: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        HEIGHT: (100, 105, 110, 115, 120, 125, 130),
        YAW: (0, 10, 20, 30, 40, 60, 90, 135, 180),
        AGE: (0, 5, 10, 20, 30),
    }
)
"""The first of each is the reference; it is heard a second time, and compared with itself."""
WHOLE, PLACE, LEVEL = "correlation", "correlation without the phone's spectrum", "level off by (dB)"
NOTES = {
    HEIGHT: "Against the same spot at 100 cm.",
    YAW: "Against the same spot at a heading of 0 degrees.",
    AGE: "Against the same spot on day 0: furniture moves a little, the temperature changes.",
}

Spectra = dict[float, F64]
"""Spectra in dB (spots, 71) by height, heading or age."""


def measure_stability(world: World, spots: int) -> tuple[list[Row], list[Panel]]:
    """Rows of correlation and level at that many spots of the world, and what to look at.

    After the paper, section 3.2. What correlates is the power spectral density in dB, as it is
    and without its mean over the spots, which is the phone's own. Intervals are over spots.
    """
    generator = np.random.default_rng([30, spots])
    spots_m = generator.choice(world.spots_m, spots, replace=False)
    rows: list[Row] = []
    panels: list[Panel] = []
    for varied, values in SWEEPS.items():
        reference = _spectra(world, spots_m, varied, values[0], generator)
        heard = {at: _spectra(world, spots_m, varied, at, generator) for at in values}
        found = {at: compared(reference, heard[at]) for at in values}
        elsewhere = compared_elsewhere(reference)
        rows += [row for at in values for row in _rows(varied, at, found[at])]
        panels += [_correlation_panel(varied, found, elsewhere), _spectra_panel(varied, heard)]
    return rows + _rows(ELSEWHERE, None, elsewhere), panels


def compared(reference: F64, heard: F64) -> dict[str, F64]:
    """Correlations and levels (spots) of spectra in dB (spots, 71) at the same spots."""
    phone = reference.mean(axis=0)
    return {
        WHOLE: _correlation(reference, heard),
        PLACE: _correlation(reference - phone, heard - phone),
        LEVEL: np.abs(_level_db(reference) - _level_db(heard)),
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


def _rows(varied: str, at: float | None, found: Mapping[str, F64]) -> list[Row]:
    return [mean_row(varied, at, measure, values, "spots") for measure, values in found.items()]


def _correlation_panel(
    varied: str, found: Mapping[float, Mapping[str, F64]], elsewhere: Mapping[str, F64]
) -> Panel:
    curves = {
        name: curve_of([mean_row(varied, at, name, each[name], "") for at, each in found.items()])
        for name in (WHOLE, PLACE)
    }
    anchors = {name: float(elsewhere[name].mean()) for name in curves}
    note = f"{NOTES[varied]} Dotted: against other spots. Bands: 95 % over spots."
    figure = curves_figure(curves, varied, "correlation of spectra", anchors=anchors)
    return Panel(f"Spectrum against {varied.split(' (', maxsplit=1)[0]}", figure, note)


def _spectra_panel(varied: str, heard: Spectra) -> Panel:
    """The spectra of the first spot alone, as the paper shows them."""
    khz = np.linspace(*PSD_BAND_HZ, next(iter(heard.values())).shape[1]) / 1000
    curves = {f"{at:g}": Curve(khz, spectra[0]) for at, spectra in heard.items()}
    figure = curves_figure(curves, "kHz", "power (dB)", colors=shades(len(curves)))
    return Panel(f"One spot, by {varied}", figure, f"Mean of {ECHOES} echoes.")
