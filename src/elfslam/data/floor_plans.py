"""Floor plans from elsewhere: images with their width in metres, and GeoJSON."""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import label

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.grid import FloorGrid, Polygon, drawn_grid
from elfslam.base.text_files import read_bytes, read_json
from elfslam.data.geographic import Origin, from_lon_lat

IMAGES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp")
FORMATS = ("PNG", "PPM", "JPEG", "BMP")
"""Others are run by other programs, or hold more than a picture."""
MOST_PIXELS, MOST_SIDE = 40_000_000, 3000
"""Of the image, and along each side of what is made of it."""
MOST_CORNERS = 100_000
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
    light, pixels = _shrunk(_brightness(file) >= DARK)
    ground = light & ~_outside(light)
    ground = ground if ground.any() else light
    if not ground.any():
        raise InputError(f"{file}: has no light pixel; walls are dark, ground is light")
    return FloorGrid(ground[::-1], np.zeros(2), width_m / pixels)


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
    try:
        return drawn_grid(ground, blocked, max(CELL_M, float(size_m.max()) / 2000)), frame
    except InputError as cause:
        raise InputError(f"{file}: {cause}") from cause


def _brightness(file: Path) -> Any:
    """Brightness 0 to 255 of each pixel (rows, columns); what is transparent is white."""
    from PIL import Image

    content = BytesIO(read_bytes(file))
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(content, formats=FORMATS) as image,
        ):
            if image.width * image.height > MOST_PIXELS:
                raise ValueError(f"{image.width} by {image.height} pixels; make it smaller")
            if not image.has_transparency_data:
                return np.asarray(image.convert("RGB").convert("L"))
            seen = image.convert("RGBA")
    except Exception as cause:  # Pillow raises whatever the damaged bytes led to
        raise InputError(
            f"{file}: cannot be read as an image ({cause!s:.120}); check it"
        ) from cause
    paper = Image.new("RGBA", seen.size, (255, 255, 255, 255))
    return np.asarray(Image.alpha_composite(paper, seen).convert("L"))


def _shrunk(light: Bool) -> tuple[Bool, float]:
    """The image with so few pixels that plans can be worked with, and how many its width takes.

    A pixel is light where all are of which it is made, so that walls stay closed.
    """
    factor = -(-max(light.shape) // MOST_SIDE)
    rows, columns = (-(-size // factor) * factor for size in light.shape)
    whole = np.ones((rows, columns), dtype=np.bool_)
    # The lower left corner is the origin.
    whole[rows - light.shape[0] :, : light.shape[1]] = light
    parts = whole.reshape(rows // factor, factor, columns // factor, factor)
    return np.asarray(parts.all(axis=(1, 3))), light.shape[1] / factor


def _outside(light: Bool) -> Bool:
    """Light pixels that hang together with the border."""
    parts, count = label(light)
    outside = np.zeros(count + 1, dtype=np.bool_)
    for side in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        outside[side] = True
    outside[0] = False
    return np.asarray(outside[parts])


def _polygons(file: Path) -> list[tuple[Polygon, bool]]:
    """Polygons in degrees, and whether each is accessible."""
    content = read_json(file)
    try:
        features = content.get("features", [content])
        found = [each for feature in features for each in _of_feature(feature)]
    except (ValueError, KeyError, TypeError, AttributeError) as cause:
        raise InputError(f"{file}: cannot be read as GeoJSON ({cause!r:.80}); check it") from cause
    if not found:
        raise InputError(f"{file}: holds no Polygon; wanted the accessible ground as polygons")
    corners = sum(len(ring) for polygon, _ in found for ring in polygon)
    if corners > MOST_CORNERS:
        raise InputError(f"{file}: has {corners} corners, wanted {MOST_CORNERS}; simplify it")
    return found


def _of_feature(feature: dict[str, Any]) -> list[tuple[Polygon, bool]]:
    geometry = feature.get("geometry", feature) or {}
    kind = geometry.get("type")
    if kind not in ("Polygon", "MultiPolygon"):
        return []
    parts = [geometry["coordinates"]] if kind == "Polygon" else geometry["coordinates"]
    accessible = (feature.get("properties") or {}).get("accessible", True) is not False
    return [(_rings(rings), accessible) for rings in parts]


def _rings(rings: list[Any]) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise ValueError("a polygon needs a ring")
    return tuple(_ring(ring) for ring in rings)


def _ring(positions: list[Any]) -> F64:
    """The corners of a ring, longitude and latitude, without the repeated last one."""
    ring = np.array([position[:2] for position in positions], dtype=np.float64)[:-1]
    if ring.ndim != 2 or len(ring) < 3 or not (np.abs(ring) <= [180, 90]).all():
        raise ValueError("a ring needs three corners or more in degrees")
    return ring
