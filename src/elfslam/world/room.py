"""Rooms: a shoebox with six reflecting surfaces and furniture made of point scatterers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Furniture(Value):
    """An axis-parallel box, low corner and size in metres, whose surface scatters sound."""

    name: str
    corner_m: F64 = array(3)
    size_m: F64 = array(3)


@dataclass(frozen=True, eq=False)
class Room(Value):
    """A furnished shoebox with one corner at the origin.

    `reflection` is the pressure reflection of the walls x=0, x=L, y=0, y=W, floor and ceiling in
    the chirp band. A scatterer of radius a returns a / 2 of the incident pressure at 1 m, as a
    rigid sphere does at wavelengths far below its size.
    """

    size_m: F64 = array(3)
    reflection: F64 = array(6)
    scatterers_m: F64 = array("s", 3)
    scatterer_radius_m: F64 = array("s")
    furniture: tuple[Furniture, ...] = ()

    @property
    def outline_m(self) -> F64:
        """Corners of the floor (4, 2)."""
        length, width = self.size_m[:2]
        return np.array([[0, 0], [length, 0], [length, width], [0, width]], dtype=float)


SCATTERERS_PER_M2 = 9.0
"""Points per square metre of furniture surface: edges, handles, books, folds."""
SCATTERER_RADIUS_M = (0.04, 0.18)


def furnish(
    size_m: F64, reflection: F64, furniture: tuple[Furniture, ...], generator: np.random.Generator
) -> Room:
    """A room whose furniture surfaces carry scatterers drawn from `generator`."""
    for item in furniture:
        if (item.corner_m < 0).any() or (item.corner_m + item.size_m > size_m + 1e-9).any():
            raise InputError(f"furniture {item.name!r} stands outside the room; move or shrink it")
    points = [_surface_points(item, generator) for item in furniture]
    scatterers = np.vstack([np.zeros((0, 3)), *points])
    radius = generator.uniform(*SCATTERER_RADIUS_M, len(scatterers))
    return Room(size_m, reflection, scatterers, radius, furniture)


def _surface_points(item: Furniture, generator: np.random.Generator) -> F64:
    """Points on the five visible faces of a box (the underside stands on the floor)."""
    length, width, height = item.size_m
    areas = np.array(
        [length * width, length * height, length * height, width * height, width * height]
    )
    count = max(round(float(areas.sum()) * SCATTERERS_PER_M2), 3)
    face = generator.choice(5, size=count, p=areas / areas.sum())
    share = generator.uniform(0.0, 1.0, (count, 3))
    share[face == 0, 2] = 1.0
    share[face == 1, 1], share[face == 2, 1] = 0.0, 1.0
    share[face == 3, 0], share[face == 4, 0] = 0.0, 1.0
    return np.asarray(item.corner_m + share * item.size_m)
