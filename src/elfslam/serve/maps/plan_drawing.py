"""Parses a floor plan of any kind, in a child of the server: a picture, drawn where it is none.

A PDF, an SVG or a picture may make whoever draws it slow, large or worse.
"""

from pathlib import Path
from typing import Any

from elfslam.data.plan_pictures import PlanKind, drawn_picture, kind_of, opened_picture

PICTURES = {"PNG": PlanKind.PNG, "JPEG": PlanKind.JPEG}
"""What a plan is kept and sent as, whatever it came as."""
ORIENTATION, ON_ITS_SIDE = 0x0112, (5, 6, 7, 8)
"""Of EXIF: browsers turn such images by a quarter."""
SMALLER = 8
"""A JPEG is looked through at this part of its size: whether it is whole shows there, too."""


def parse(file: str, level: str | None = None) -> dict[str, Any]:
    """Type, size in pixels, and width in metres if known of a plan.

    A PNG stands in the place of what was none. Raises InputError, with the levels as its choices
    where a `level` is to be chosen.
    """
    place, width_m = Path(file), None
    content = place.read_bytes()
    if kind_of(content) in (PlanKind.PDF, PlanKind.SVG, PlanKind.GEOJSON):
        picture = drawn_picture(place, level)
        content, width_m = picture.content, picture.width_m
        place.write_bytes(content)
    return {**_facts(content, place), "width_m": width_m}


def _facts(content: bytes, file: Path) -> dict[str, Any]:
    """Type and size of a whole PNG or JPEG, as a browser shows it."""
    with opened_picture(content, file, tuple(PICTURES)) as image:
        width, height = image.size
        kind = PICTURES[str(image.format)]
        turned = image.getexif().get(ORIENTATION) in ON_ITS_SIDE
        image.draft(None, (width // SMALLER, height // SMALLER))
        image.load()
    size = (height, width) if turned else (width, height)
    return {"width_px": size[0], "height_px": size[1], "type": str(kind)}
