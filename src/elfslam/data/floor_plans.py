"""Floor plans from elsewhere: images with their width in metres, and GeoJSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import label

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.grid import FloorGrid, Polygon, drawn_grid
from elfslam.data.geographic import Origin, from_lon_lat

IMAGES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp")
GEOJSON = (".geojson", ".json")
DARK = 128
"""Pixels darker than this are walls."""
NARROWEST_M, WIDEST_M = 1.0, 2000.0
CELL_M = 0.05


def read_plan_image(file: Path, width_m: float) -> FloorGrid:
    """Accessible ground of an image that is `width_m` wide, its lower left corner at the origin.

    Light pixels are ground, but those that hang together with the border of the image, where any
    others are left: that is the outside. Raises InputError.
    """
    if not NARROWEST_M <= width_m <= WIDEST_M:
        raise InputError(
            f"{file}: a width of {width_m:g} m, wanted {NARROWEST_M:g} to {WIDEST_M:g}; "
            "say how many metres the image is wide"
        )
    light = _brightness(file) >= DARK
    ground = light & ~_outside(light)
    ground = ground if ground.any() else light
    if not ground.any():
        raise InputError(f"{file}: has no light pixel; walls are dark, ground is light")
    return FloorGrid(ground[::-1], np.zeros(2), width_m / ground.shape[1])


def read_plan_geojson(file: Path, origin: Origin | None = None) -> tuple[FloorGrid, Origin]:
    """Accessible ground of the polygons of a GeoJSON file, and the frame that it is in.

    Polygons whose property `accessible` is false are walls or furniture. Without an origin that
    is the middle of all corners, x to the east. Raises InputError.
    """
    polygons = _polygons(file)
    corners = np.concatenate([polygon[0] for polygon, _ in polygons])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    frame = origin or Origin(round(float(middle[1]), 7), round(float(middle[0]), 7))
    flat: list[tuple[Polygon, bool]] = [
        (tuple(from_lon_lat(frame, ring) for ring in polygon), open_) for polygon, open_ in polygons
    ]
    size_m = np.ptp(np.concatenate([polygon[0] for polygon, _ in flat]), axis=0)
    if size_m.max() > WIDEST_M:
        raise InputError(
            f"{file}: is {size_m.max():.0f} m across, wanted {WIDEST_M:g} at most; "
            "keep one floor (RFC 7946: longitude and latitude in degrees)"
        )
    ground = [polygon for polygon, open_ in flat if open_]
    blocked = [polygon for polygon, open_ in flat if not open_]
    if not ground:
        raise InputError(f"{file}: no polygon is accessible; remove the property from one")
    return drawn_grid(ground, blocked, max(CELL_M, float(size_m.max()) / 2000)), frame


def _brightness(file: Path) -> Any:
    """Brightness 0 to 255 of each pixel (rows, columns); what is transparent is white."""
    try:
        from PIL import Image
    except ImportError as cause:
        raise InputError(
            f"{file}: images need Pillow, which is not installed; run "
            "pip install 'elfslam[images]' or give the plan as GeoJSON"
        ) from cause
    try:
        with Image.open(file) as image:
            seen = image.convert("RGBA")
    except (OSError, ValueError, Image.DecompressionBombError) as cause:
        raise InputError(f"{file}: cannot be read as an image ({cause}); check it") from cause
    paper = Image.new("RGBA", seen.size, (255, 255, 255, 255))
    return np.asarray(Image.alpha_composite(paper, seen).convert("L"))


def _outside(light: Bool) -> Bool:
    """Light pixels that hang together with the border."""
    parts, _ = label(light)
    border = np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])
    return np.asarray(np.isin(parts, border[border > 0]))


def _polygons(file: Path) -> list[tuple[Polygon, bool]]:
    """Polygons in degrees, and whether each is accessible."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        features = content.get("features", [content])
        found = [each for feature in features for each in _of_feature(feature)]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as cause:
        raise InputError(f"{file}: cannot be read as GeoJSON ({cause!r:.80}); check it") from cause
    if not found:
        raise InputError(f"{file}: holds no Polygon; wanted the accessible ground as polygons")
    return found


def _of_feature(feature: dict[str, Any]) -> list[tuple[Polygon, bool]]:
    geometry = feature.get("geometry", feature) or {}
    kind = geometry.get("type")
    if kind not in ("Polygon", "MultiPolygon"):
        return []
    parts = [geometry["coordinates"]] if kind == "Polygon" else geometry["coordinates"]
    accessible = (feature.get("properties") or {}).get("accessible", True) is not False
    return [(tuple(_ring(ring) for ring in rings), accessible) for rings in parts]


def _ring(positions: list[Any]) -> F64:
    """The corners of a ring, longitude and latitude, without the repeated last one."""
    ring = np.array([position[:2] for position in positions], dtype=np.float64)[:-1]
    if ring.ndim != 2 or len(ring) < 3 or not (np.abs(ring) <= [180, 90]).all():
        raise ValueError("a ring needs three corners or more in degrees")
    return ring
