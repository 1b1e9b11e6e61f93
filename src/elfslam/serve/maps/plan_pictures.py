"""The picture of a floor plan, whatever it came as, and what is known of it."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from threading import BoundedSemaphore
from typing import Any

from PIL import Image, UnidentifiedImageError

from elfslam.base.errors import InputError
from elfslam.data.plan_pictures import PlanKind, kind_of
from elfslam.serve.problems import Problem
from elfslam.serve.receiving.reading import run_apart
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.sending import scratch_file

PICTURES = {"PNG": PlanKind.PNG, "JPEG": PlanKind.JPEG}
DRAWER = "elfslam.serve.maps.plan_drawing"
DRAWING_S = 60.0
DRAWING_BYTES = 2 * 2**30
"""Time and memory that drawing a plan may take."""
AT_ONCE = BoundedSemaphore(2)
"""So many are drawn at once; others wait."""
MOST_PIXELS = 40_000_000
TOO_MANY_PIXELS = Problem(
    422, f"the image has more than {MOST_PIXELS // 10**6} million pixels; make it smaller"
)
ORIENTATION, ON_ITS_SIDE = 0x0112, (5, 6, 7, 8)
"""Of EXIF: browsers turn such images by a quarter."""


def picture_of(
    settings: ServerSettings, content: bytes, level: str | None = None
) -> tuple[bytes, dict[str, Any]]:
    """A plan as a PNG or JPEG, with its type, size in pixels, and its width in metres if known.

    Raises Problem 422 for what is no plan, with the levels where a `level` is to be chosen.
    """
    kind, width_m = kind_of(content), None
    if kind in (PlanKind.PDF, PlanKind.SVG, PlanKind.GEOJSON):
        content, width_m = _drawn(settings, content, level)
    return content, {**facts_of_image(content), "width_m": width_m}


def _drawn(
    settings: ServerSettings, content: bytes, level: str | None
) -> tuple[bytes, float | None]:
    """What a process of its own draws."""
    limits = replace(settings.limits, reading_s=DRAWING_S, reading_bytes=DRAWING_BYTES)
    with AT_ONCE, scratch_file(settings, content) as file:
        try:
            told = run_apart(DRAWER, limits, str(file), json.dumps(level))
        except InputError as late:
            raise Problem(422, f"drawing the plan takes too long ({late})") from late
        if "refusal" in told:
            raise Problem(422, told["refusal"], levels=told.get("levels", ()))
        return file.read_bytes(), told["width_m"]


def facts_of_image(content: bytes) -> dict[str, Any]:
    """Type and size of a whole PNG or JPEG, as a browser shows it. Raises Problem 422."""
    try:
        with Image.open(io.BytesIO(content), formats=list(PICTURES)) as image:
            width, height = image.size
            if width * height > MOST_PIXELS:
                raise TOO_MANY_PIXELS
            image.load()
            turned = image.getexif().get(ORIENTATION) in ON_ITS_SIDE
            kind = PICTURES[str(image.format)]
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as cause:
        raise TOO_MANY_PIXELS from cause
    except (OSError, ValueError, SyntaxError) as cause:
        why = "something else" if isinstance(cause, UnidentifiedImageError) else "a damaged one"
        raise Problem(
            422,
            f"wanted a PNG or JPEG image, a PDF, SVG or GeoJSON, got {why}; save the plan again",
        ) from cause
    size = (height, width) if turned else (width, height)
    return {"width_px": size[0], "height_px": size[1], "type": str(kind)}
