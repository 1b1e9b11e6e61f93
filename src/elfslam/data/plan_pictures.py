"""Floor plans of any kind as pictures: PDF, SVG and GeoJSON drawn as PNG, others as they are.

What a picture shows is drawn here, once, and never again elsewhere: a PDF or an SVG can run
programs and ask for files, a PNG cannot. A process is begun for each plan that comes to a server:
what few plans need is imported where it is used.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elfslam.base.errors import InputError
from elfslam.base.extras import installing
from elfslam.base.text_files import read_bytes
from elfslam.data.plan_svg import clean_svg

if TYPE_CHECKING:
    from elfslam.base.arrays import F64
    from elfslam.data.plan_geojson import PlanShapes

MOST_PIXELS, MOST_SCANS = 40_000_000, 100
"""Of a picture, and of a JPEG that comes in ever finer scans; programs write ten or so."""
SCAN = re.compile(rb"\xff\xda")
MOST_SIDE_PX, MOST_PX_PER_M = 3000, 100.0
"""Of what is drawn here."""
LINE_M = 0.1
"""How thick walls are drawn that have no thickness."""
PAPER, INK, FURNITURE = 255, 0, 170


class PlanKind(StrEnum):
    """What floor plans come as, by their media types."""

    PNG = "image/png"
    JPEG = "image/jpeg"
    PDF = "application/pdf"
    SVG = "image/svg+xml"
    GEOJSON = "application/geo+json"


@dataclass(frozen=True)
class PlanPicture:
    """A PNG, and how many metres it is wide where the plan says so."""

    content: bytes
    width_m: float | None = None


def kind_of(content: bytes) -> PlanKind | None:
    """What a plan is, by how it begins; None where it is none of these."""
    start = content[:1024].lstrip(b"\xef\xbb\xbf \t\r\n")
    if content.startswith(b"\x89PNG"):
        return PlanKind.PNG
    if content.startswith(b"\xff\xd8\xff"):
        return PlanKind.JPEG
    if b"%PDF-" in content[:1024]:
        return PlanKind.PDF
    if start.startswith(b"<"):
        return PlanKind.SVG
    return PlanKind.GEOJSON if start.startswith((b"{", b"[")) else None


@contextmanager
def opened_picture(content: bytes, file: Path, formats: tuple[str, ...]) -> Iterator[Any]:
    """Pillow's image of one of its formats, which is decoded in the block and not before.

    Raises InputError, naming `file`, for what is none, is damaged, or would take too much.
    """
    from PIL import Image

    try:
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(io.BytesIO(content), formats=formats) as image,
        ):
            if image.width * image.height > MOST_PIXELS:
                raise ValueError(
                    f"{image.width} by {image.height} pixels, more than "
                    f"{MOST_PIXELS // 10**6} million; make it smaller"
                )
            if image.format == "JPEG" and len(SCAN.findall(content)) > MOST_SCANS:
                raise ValueError(f"more than {MOST_SCANS} scans; save it as a plain JPEG")
            yield image
    except MemoryError:
        raise
    except Exception as cause:  # Pillow raises whatever the damaged bytes led to
        raise InputError(
            f"{file}: cannot be read as an image ({cause!s:.120}); check it"
        ) from cause


def drawn_picture(file: Path, level: str | None = None) -> PlanPicture:
    """The first page of a PDF, an SVG or the shapes of a level of a GeoJSON file as a PNG.

    Raises InputError, also for what is none of them, as LevelError where a `level` is to be chosen.
    """
    from elfslam.data.plan_geojson import read_plan_shapes

    content = read_bytes(file)
    kind = kind_of(content)
    if kind is PlanKind.PDF:
        return PlanPicture(_of_pdf(content, file))
    if kind is PlanKind.SVG:
        return PlanPicture(_of_svg(content, file))
    if kind is PlanKind.GEOJSON:
        return picture_of_shapes(read_plan_shapes(file, level=level))
    raise InputError(f"{file}: is no PDF, SVG or GeoJSON; save the plan as one of these")


def _of_pdf(content: bytes, file: Path) -> bytes:
    try:
        import pypdfium2
    except ImportError as cause:
        raise _lacking("PDF") from cause
    try:
        with pypdfium2.PdfDocument(content) as pages:
            page = pages[0]
            scale = MOST_SIDE_PX / max(page.get_size())
            image = page.render(scale=scale, may_draw_forms=False).to_pil()
    except (pypdfium2.PdfiumError, ValueError, IndexError, ZeroDivisionError) as cause:
        raise InputError(
            f"{file}: cannot be read as a PDF ({cause!s:.80}); export it again, without a password"
        ) from cause
    return _png(image)


def _of_svg(content: bytes, file: Path) -> bytes:
    try:
        import resvg_py
    except ImportError as cause:
        raise _lacking("SVG") from cause
    text, (width, height) = clean_svg(content, file)
    scale = MOST_SIDE_PX / max(width, height)
    across, down = max(1, round(width * scale)), max(1, round(height * scale))
    try:
        made = resvg_py.svg_to_bytes(svg_string=text, background="white", width=across, height=down)
    except Exception as cause:  # whatever the library makes of a damaged drawing
        raise InputError(
            f"{file}: cannot be drawn ({cause!s:.80}); save it as plain SVG"
        ) from cause
    return bytes(made)


def _lacking(what: str) -> InputError:
    return InputError(f"{what} plans need more packages: {installing('images')}, or save as PNG")


def picture_of_shapes(shapes: PlanShapes) -> PlanPicture:
    """Ground as white with its outline, what stands on it grey, walls black."""
    import numpy as np
    from PIL import Image, ImageDraw

    corners = shapes.corners_m
    low, high = corners.min(axis=0) - LINE_M, corners.max(axis=0) + LINE_M
    px_per_m = min(MOST_PX_PER_M, MOST_SIDE_PX / float((high - low).max()))
    width, height = (max(1, int(side)) for side in np.ceil((high - low) * px_per_m))
    image = Image.new("L", (width, height), PAPER)
    pen, thick = ImageDraw.Draw(image), max(1, round(LINE_M * px_per_m))

    def placed(points_m: F64) -> list[tuple[float, float]]:
        x, y = ((points_m - low) * px_per_m).T
        return list(zip(x.tolist(), (height - y).tolist(), strict=True))

    for polygon in shapes.ground:
        for ring in polygon:
            pen.line(placed(np.vstack([ring, ring[:1]])), INK, thick, joint="curve")
    for polygon in shapes.blocked:
        pen.polygon(placed(polygon[0]), fill=FURNITURE, outline=INK)
    for line in shapes.lines:
        pen.line(placed(line), INK, thick, joint="curve")
    return PlanPicture(_png(image), round(width / px_per_m, 4))


def _png(image: Any) -> bytes:
    content = io.BytesIO()
    image.convert("L" if image.mode == "L" else "RGB").save(content, "PNG", optimize=False)
    return content.getvalue()
