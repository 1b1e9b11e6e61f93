"""Floor plans from elsewhere: images, PDF and SVG with their width in metres, and GeoJSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import label

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.grid import FloorGrid, Polygon, drawn_grid
from elfslam.base.text_files import read_bytes
from elfslam.data.geographic import Origin
from elfslam.data.plan_geojson import NARROWEST_M, WIDEST_M, read_plan_shapes
from elfslam.data.plan_pictures import PlanKind, drawn_picture, kind_of, opened_picture

IMAGES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp", ".pdf", ".svg")
FORMATS = ("PNG", "PPM", "JPEG", "BMP")
"""Others are run by other programs, or hold more than a picture."""
DRAWN = (PlanKind.PDF, PlanKind.SVG)
"""These are drawn first."""
MOST_SIDE = 3000
"""Pixels along each side of what is made of an image."""
GEOJSON = (".geojson", ".json", ".zip")
"""An archive of IMDF holds such."""
DARK = 128
"""Pixels darker than this are walls."""
CELL_M, MOST_CELLS, WALL_CELLS = 0.05, 2000, 2
"""Squares of ground: how wide, how many across, and how many a wall of no width is thick."""


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


def read_plan_geojson(
    file: Path, origin: Origin | None = None, level: str | None = None
) -> tuple[FloorGrid, Origin | None]:
    """Accessible ground of the polygons of a GeoJSON file, and where on the Earth its frame lies.

    Lines are walls; without polygons the ground is what they enclose. No origin is known of a
    file in metres. Raises InputError, as LevelError where a `level` is to be chosen.
    """
    shapes = read_plan_shapes(file, origin, level)
    cell_m = max(CELL_M, float(np.ptp(shapes.corners_m, axis=0).max()) / MOST_CELLS)
    walls = [wall for line in shapes.lines for wall in _walls(line, WALL_CELLS * cell_m)]
    blocked = [*shapes.blocked, *walls]
    try:
        if shapes.ground:
            return drawn_grid(shapes.ground, blocked, cell_m), shapes.origin
        if shapes.lines:
            return _enclosed(shapes.corners_m, blocked, cell_m), shapes.origin
    except InputError as cause:
        raise InputError(f"{file}: {cause}") from cause
    raise InputError(f"{file}: no polygon is accessible; remove the property from one")


def _walls(line: F64, thick_m: float) -> list[Polygon]:
    """A line (n, 2) as thin rectangles, one a segment, that overlap where it bends."""
    ahead = np.diff(line, axis=0)
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    ahead = ahead / np.where(length > 0, length, 1) * thick_m / 2
    aside = ahead @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    first, last = line[:-1] - ahead, line[1:] + ahead
    rings = np.stack([first - aside, last - aside, last + aside, first + aside], axis=1)
    return [(ring,) for ring in rings[length[:, 0] > 0]]


def _enclosed(corners_m: F64, blocked: Sequence[Polygon], cell_m: float) -> FloorGrid:
    """What lines enclose. Raises InputError where they are open."""
    margin_m = (WALL_CELLS + 1) * cell_m
    (left, low), (right, high) = corners_m.min(axis=0) - margin_m, corners_m.max(axis=0) + margin_m
    around = np.array([[left, low], [right, low], [right, high], [left, high]])
    grid = drawn_grid([(around,)], blocked, cell_m)
    rows, columns = (np.flatnonzero(grid.free.any(axis=axis)) for axis in (1, 0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    free = np.zeros_like(grid.free)
    free[box] = grid.free[box] & ~_outside(grid.free[box])
    if not free.any():
        raise InputError("its lines enclose no ground; close the walls, or give polygons")
    return FloorGrid(free, grid.corner_m, cell_m)


def _brightness(file: Path) -> Any:
    """Brightness 0 to 255 of each pixel (rows, columns); what is transparent is white."""
    from PIL import Image

    content = read_bytes(file)
    if kind_of(content) in DRAWN:
        content = drawn_picture(file).content
    with opened_picture(content, file, FORMATS) as image:
        if not image.has_transparency_data:
            return np.asarray(image.convert("RGB").convert("L"))
        seen = image.convert("RGBA")
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
