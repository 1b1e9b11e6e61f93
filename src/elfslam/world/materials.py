"""Materials of rooms: how much of a sound of 15 to 20 kHz they absorb and how much they scatter.

No table found covers real surfaces at 15 to 20 kHz. Absorption is therefore the random-incidence
value of the highest band that was measured, 8 or 4 kHz, taken as it is, and every `source` says
which. Two things are computed instead:

- No wall absorbs less than `BOUNDARY_LAYER_ABSORPTION`, what viscosity and heat conduction take in
  the thin layer of air at it (1.8e-4 times the root of the frequency at random incidence). Values
  measured below it at 8 kHz are raised to it.
- A wall scatters by its roughness as `rough_scattering` says; the roughness itself is an estimate.

Across the band, which the shares are those of the middle of, two laws hold for every material. What
a rough surface mirrors is exp(-(4 pi height cos angle / wavelength)^2) (Rayleigh's roughness), so
that a mirrored share m becomes m^((f / f0)^2): shorter waves are scattered more. Fittings, folds
and gaps are taken for roughness as well, which is the most that their scattering can change by.
Absorption grows as that of the boundary layer does, with the root of the frequency. What is neither
absorbed nor mirrored is scattered, at every frequency.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError

BOUNDARY_LAYER_ABSORPTION = 0.024
"""At 17.5 kHz."""

MIDDLE_HZ = 17_500.0
"""Of the band; absorption and scattering are told for it."""
WAVENUMBER_RADPM = 2 * math.pi * MIDDLE_HZ / 343.0
ABSORPTION_GROWS = 0.5
"""Absorption grows with this power of the frequency, as that of the boundary layer does."""
LEAST_KEPT, LEAST_MIRRORED = 0.1, 1e-3
"""How fast smaller shares of energy fall with the frequency is asked for these."""


@dataclass(frozen=True)
class Material:
    """A surface: shares of the energy of sound that it absorbs and, of the rest, scatters.

    Both are those at 17.5 kHz. `source` says where they come from: the band measured, or that it is
    an estimate.
    """

    name: str
    absorption: float
    scattering: float
    source: str

    def __post_init__(self) -> None:
        for share, value in (("absorption", self.absorption), ("scattering", self.scattering)):
            if not 0 <= value <= 1:
                raise InputError(
                    f"material {self.name!r}: wanted {share} from 0 to 1, got {value}; correct it"
                )

    @property
    def reflection(self) -> float:
        """Pressure of the mirrored sound per pressure of the incident one."""
        return math.sqrt((1 - self.absorption) * (1 - self.scattering))

    @property
    def diffuse(self) -> float:
        """Share of the incident energy that leaves in other directions than the mirrored one."""
        return (1 - self.absorption) * self.scattering

    @property
    def mirror_fall(self) -> float:
        """The power of the frequency with which the mirrored pressure falls, about 17.5 kHz."""
        return float(absorption_fall(self.absorption) + mirror_fall(self.scattering))

    @property
    def diffuse_fall(self) -> float:
        """The same of the scattered pressure; negative where it grows."""
        return float(absorption_fall(self.absorption) - scattering_rise(self.scattering))

    def at(self, frequency_hz: float) -> Material:
        """The surface as sound of this frequency finds it."""
        ratio = frequency_hz / MIDDLE_HZ
        return replace(
            self,
            absorption=min(self.absorption * ratio**ABSORPTION_GROWS, 1.0),
            scattering=1 - (1 - self.scattering) ** (ratio**2),
        )


def absorption_fall(absorption: F64 | float) -> F64:
    """The power of the frequency with which the pressure falls that a surface keeps."""
    kept = np.maximum(1 - np.asarray(absorption), LEAST_KEPT)
    return np.asarray(ABSORPTION_GROWS * (1 - kept) / (2 * kept))


def mirror_fall(scattering: F64 | float) -> F64:
    """The power of the frequency with which the mirrored pressure falls, absorption apart."""
    return np.asarray(-np.log(np.maximum(1 - np.asarray(scattering), LEAST_MIRRORED)))


def scattering_rise(scattering: F64 | float) -> F64:
    """The power of the frequency with which the scattered pressure grows, absorption apart.

    It is 1 where hardly anything is scattered, and 0 where everything is.
    """
    share = np.maximum(scattering, 1e-9)
    return np.asarray((1 - share) * mirror_fall(share) / share)


def rough_scattering(roughness_m: float) -> float:
    """Scattering at 17.5 kHz and 45 degrees of a surface of this height, one standard deviation.

    The mirrored share of a rough surface is exp(-(2 k height cos angle)^2) (Beckmann and
    Spizzichino, The Scattering of Electromagnetic Waves from Rough Surfaces, 1963).
    """
    return 1 - math.exp(-2 * (WAVENUMBER_RADPM * roughness_m) ** 2)


def material(name: str) -> Material:
    """The material of this name. Raises InputError that suggests a near name for others."""
    if name not in MATERIALS:
        near = difflib.get_close_matches(name, MATERIALS, n=1)
        advice = f"did you mean {near[0]!r}?" if near else "choose one of them"
        raise InputError(f"material {name!r}: wanted {', '.join(MATERIALS)}; {advice}")
    return MATERIALS[name]


def _annex(row: str, band_khz: int, scattering: str) -> str:
    """Where a number of the annex of Vorlaender, Auralization (Springer 2008) was taken from."""
    band = f"{band_khz} kHz band, Vorlaender 2008, annex, {row!r}"
    return f"absorption: {band}, taken as it is; scattering: {scattering}"


def _raised(row: str, band_khz: int, measured: float, scattering: str) -> str:
    band = f"{band_khz} kHz band, Vorlaender 2008, annex, {row!r}: {measured}"
    return f"absorption: {band}, raised to the boundary layer's; scattering: {scattering}"


def _rough(roughness_mm: float) -> str:
    return f"estimate from a roughness of {roughness_mm} mm"


_TABLES = "8 kHz band, Vorlaender 2008, annex, 'Rows of classroom tables and persons on chairs'"
_AUDIENCE = "8 kHz band, Vorlaender 2008, annex, 'Theatre audience'"

_TABLE = (
    Material("concrete", 0.05, 0.018, _annex("Smooth unpainted concrete", 8, _rough(0.3))),
    Material("brick", 0.07, 0.186, _annex("Brick wall, stuccoed, rough finish", 8, _rough(1.0))),
    Material("plaster", 0.05, 0.008, _annex("Walls, hard surfaces average", 8, _rough(0.2))),
    Material("gypsum board", 0.05, 0.002, _annex("2 * 13 mm plasterboard", 8, _rough(0.1))),
    Material(
        "painted wall", BOUNDARY_LAYER_ABSORPTION, 0.018,
        _raised("Smooth brickwork with flush pointing, painted", 8, 0.02, _rough(0.3)),
    ),
    Material(
        "glass", BOUNDARY_LAYER_ABSORPTION, 0.02,
        _raised("Single pane of glass, 3 mm", 8, 0.02, "estimate for frames and fittings"),
    ),
    Material("wood panel", 0.06, 0.018, _annex("Wooden lining, 12 mm on frame", 8, _rough(0.3))),
    Material("door", 0.10, 0.05, _annex("Solid wooden door", 8, "estimate for frame and handle")),
    Material("wood floor", 0.06, 0.018, _annex("Wood, stage floor", 4, _rough(0.3))),
    Material(
        "parquet", 0.07, 0.008,
        "absorption: 4 kHz band, wood parquet in asphalt on concrete as in common tables (such as "
        f"sengpielaudio.com), taken as it is; scattering: {_rough(0.2)}",
    ),
    Material(
        "vinyl", BOUNDARY_LAYER_ABSORPTION, 0.002,
        _raised("Linoleum, asphalt, rubber or cork tile on concrete", 4, 0.02, _rough(0.1)),
    ),
    Material(
        "tile", BOUNDARY_LAYER_ABSORPTION, 0.018,
        _raised("Ceramic tiles with a smooth surface", 8, 0.02, _rough(0.3)),
    ),
    Material("carpet", 0.44, 0.186, _annex("6 mm pile on closed-cell foam", 8, _rough(1.0))),
    Material("thick carpet", 0.80, 0.370, _annex("9 mm tufted pile on felt", 8, _rough(1.5))),
    Material("curtain", 0.71, 0.5, _annex("Cotton, 0.5 kg/m2, draped", 8, "estimate for folds")),
    Material(
        "acoustic ceiling tile", 0.53, 0.186,
        _annex("Fibre absorber, mineral fibre, 20 mm thick", 4, _rough(1.0))
        + "; tables range from 0.4 (rigid tile) to 0.99 (fissured tile)",
    ),
    Material("sofa", 0.81, 0.6, _annex("Heavily upholstered seats, unoccupied", 4, _TABLES)),
    Material("office chair", 0.70, 0.6, _annex("Empty chairs, cloth cover", 8, _TABLES)),
    Material(
        "fabric partition", 0.40, 0.071,
        _annex("Needle felt 5 mm stuck to concrete", 8, _rough(0.6))
        + "; stands for fabric on a hard board",
    ),
    Material(
        "acoustic partition", 0.98, 0.071,
        _annex("Fabric-covered panel, 8 pcf rockwool core", 8, _rough(0.6)),
    ),
    Material(
        "metal", BOUNDARY_LAYER_ABSORPTION, 0.05,
        "absorption: estimate, the boundary layer's, nothing measured found; "
        "scattering: estimate for the gaps and handles of lockers",
    ),
    Material(
        "metal shutter", BOUNDARY_LAYER_ABSORPTION, 0.5,
        "absorption: estimate, the boundary layer's, nothing measured found; "
        "scattering: estimate for slats as deep as a wave is long",
    ),
    Material(
        "wood furniture", 0.07, 0.2,
        _annex("16 mm wood on 40 mm studs", 8, "estimate for edges, gaps and things on it"),
    ),
    Material(
        "book shelf", 0.30, 0.7,
        "absorption: estimate, nothing measured above 4 kHz found; "
        "scattering: estimate, as an audience",
    ),
    Material("person", 0.78, 0.7, _annex("Audience on wooden chairs, 1 per m2", 8, _AUDIENCE)),
)  # fmt: skip

MATERIALS: Mapping[str, Material] = MappingProxyType({item.name: item for item in _TABLE})
"""Every material by its name."""
