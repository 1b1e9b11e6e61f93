"""Floor plans in GeoJSON: polygons and lines, in longitude and latitude or in metres.

Which of both they are is told by how far the plan reaches: a floor is less than a tenth of a degree
across, and more than a metre.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.grid import Polygon
from elfslam.base.text_files import read_json
from elfslam.data.geographic import Origin, from_lon_lat

MOST_CORNERS = 100_000
WIDEST_M, WIDEST_DEG = 2000.0, 0.1
NARROWEST_M = 1.0
LINES = {"LineString": False, "MultiLineString": True}
POLYGONS = {"Polygon": False, "MultiPolygon": True}
"""By kind, whether there are several in one."""


@dataclass(frozen=True, eq=False)
class PlanShapes:
    """What is drawn of a floor, in metres: ground, what stands on it, and walls (each n, 2).

    `origin` says where the frame lies on the Earth, where the file does.
    """

    ground: tuple[Polygon, ...]
    blocked: tuple[Polygon, ...]
    lines: tuple[F64, ...]
    origin: Origin | None

    @property
    def corners_m(self) -> F64:
        """All outer corners and ends (n, 2)."""
        outer = [polygon[0] for polygon in (*self.ground, *self.blocked)]
        return np.concatenate([*outer, *self.lines])


def read_plan_shapes(file: Path, origin: Origin | None = None) -> PlanShapes:
    """The polygons and lines of a GeoJSON file.

    Polygons whose property `accessible` is false are walls or furniture. In degrees, without an
    origin, that is the middle of all corners, x to the east. Raises InputError.
    """
    found = _shapes(file)
    corners = found.corners_m
    if np.ptp(corners, axis=0).max() < WIDEST_DEG and (np.abs(corners) <= [180, 90]).all():
        found = _in_metres(found, origin or _middle(corners))
    size_m = float(np.ptp(found.corners_m, axis=0).max())
    if not NARROWEST_M <= size_m <= WIDEST_M:
        raise InputError(
            f"{file}: is {size_m:.4g} m across, wanted {NARROWEST_M:g} to {WIDEST_M:g}; keep one "
            "floor (in metres, or RFC 7946: longitude and latitude in degrees)"
        )
    return found


def _middle(corners: F64) -> Origin:
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return Origin(round(float(middle[1]), 7), round(float(middle[0]), 7))


def _in_metres(degrees: PlanShapes, origin: Origin) -> PlanShapes:
    def flat(polygon: Polygon) -> Polygon:
        return tuple(from_lon_lat(origin, ring) for ring in polygon)

    return PlanShapes(
        tuple(map(flat, degrees.ground)),
        tuple(map(flat, degrees.blocked)),
        tuple(from_lon_lat(origin, line) for line in degrees.lines),
        origin,
    )


def _shapes(file: Path) -> PlanShapes:
    """What a file holds, in its own unit."""
    content = read_json(file)
    polygons: list[tuple[Polygon, bool]] = []
    lines: list[F64] = []
    try:
        for feature in content.get("features", [content]):
            polygons += _polygons_of(feature)
            lines += _lines_of(feature)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as cause:
        raise InputError(f"{file}: cannot be read as GeoJSON ({cause!r:.80}); check it") from cause
    if not polygons and not lines:
        raise InputError(
            f"{file}: holds no Polygon and no LineString; wanted the accessible ground as "
            "polygons, or its walls as lines"
        )
    rings = [ring for polygon, _ in polygons for ring in polygon]
    if (count := sum(map(len, [*rings, *lines]))) > MOST_CORNERS:
        raise InputError(f"{file}: has {count} corners, wanted {MOST_CORNERS}; simplify it")
    return PlanShapes(
        tuple(polygon for polygon, open_ in polygons if open_),
        tuple(polygon for polygon, open_ in polygons if not open_),
        tuple(lines),
        None,
    )


def _parts(feature: dict[str, Any], kinds: dict[str, bool]) -> list[Any]:
    """Coordinates of the geometries of some kind in a feature."""
    geometry = feature.get("geometry", feature) or {}
    many = kinds.get(str(geometry.get("type")))
    if many is None:
        return []
    return list(geometry["coordinates"]) if many else [geometry["coordinates"]]


def _polygons_of(feature: dict[str, Any]) -> list[tuple[Polygon, bool]]:
    """Polygons, and whether each is accessible."""
    accessible = (feature.get("properties") or {}).get("accessible", True) is not False
    return [(_rings(rings), accessible) for rings in _parts(feature, POLYGONS)]


def _lines_of(feature: dict[str, Any]) -> list[F64]:
    return [_positions(line, 2) for line in _parts(feature, LINES)]


def _rings(rings: list[Any]) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise ValueError("a polygon needs a ring")
    return tuple(_positions(ring, 4)[:-1] for ring in rings)


def _positions(positions: list[Any], least: int) -> F64:
    """Corners (n, 2) of a ring, which ends where it began, or of a line."""
    found = np.array([position[:2] for position in positions], dtype=np.float64)
    if found.ndim != 2 or len(found) < least or not (np.abs(found) <= FARTHEST_M).all():
        raise ValueError("a ring needs three corners or more and a line two, near enough")
    return found
