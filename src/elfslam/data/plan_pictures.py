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
from xml.etree import ElementTree

from elfslam.base.errors import InputError
from elfslam.base.extras import installing
from elfslam.base.text_files import read_bytes

if TYPE_CHECKING:
    from elfslam.base.arrays import F64
    from elfslam.data.plan_geojson import PlanShapes

NAMESPACE = "http://www.w3.org/2000/svg"
HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
DRAWN = frozenset(
    (
        "svg", "g", "defs", "symbol", "use", "switch", "path", "rect", "circle", "ellipse", "line",
        "polyline", "polygon", "text", "tspan", "textPath", "style", "clipPath", "mask", "marker",
        "pattern", "linearGradient", "radialGradient", "stop", "title", "desc",
    )
)  # fmt: skip
"""Elements that are kept; scripts, images, animations, links and foreign content are not."""
MOST_ELEMENTS, MOST_DEPTH = 200_000, 100
MOST_LAYERS, MOST_MASKS = 20, 100
"""Translucent, clipped or masked groups within each other, and masks in all: each is drawn as a
picture of its own."""
DEFINED = frozenset(("defs", "symbol", "mask", "pattern", "marker", "clipPath"))
"""What is inside is drawn only where it is named."""
NAMED = re.compile(r"url\(\s*['\"]?\s*#([^'\")\s]+)")
MASKED = re.compile(r"(?:^|;)\s*mask\s*:\s*url")
LAYERED = re.compile(
    r"(?:^|;)\s*(?:(?:mask|clip-path)\s*:\s*url|opacity\s*:\s*(?!1[.0]*\s*(?:;|$)))"
)
DOCTYPE = re.compile(r"<!DOCTYPE[^\[>]*>", re.IGNORECASE)
ELSEWHERE = re.compile(r"url\(\s*['\"]?\s*(?!#)|@import|javascript:|data:", re.IGNORECASE)
"""What a style or an attribute may not say: only parts of the drawing itself may be named."""
LENGTH = re.compile(r"\s*([0-9.]+(?:e[+-]?\d+)?)\s*(px|pt|pc|mm|cm|in|)\s*", re.IGNORECASE)
UNITS = {"": 1.0, "px": 1.0, "pt": 4 / 3, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}
LARGEST = 1e6


def clean_svg(content: bytes, file: Path) -> tuple[str, tuple[float, float]]:
    """The drawing without what is not drawn, and its width and height in pixels.

    Raises InputError, naming `file`, where it is none, has entities, is nested too deep, has too
    many masks or says no size.
    """
    root = _parsed(content, file)
    _check_size(root, file)
    size = _size_of(root)
    if size is None:
        raise InputError(f"{file}: says neither its size nor a viewBox; save it with one")
    _clean(root)
    _check_cost(root, file)
    ElementTree.register_namespace("", NAMESPACE)
    return ElementTree.tostring(root, encoding="unicode"), size


def _parsed(content: bytes, file: Path) -> ElementTree.Element:
    try:
        text = DOCTYPE.sub("", content.decode("utf-8-sig"))
        if "<!DOCTYPE" in text.upper() or "<!ENTITY" in text.upper():
            raise ValueError("it defines entities")
        root = ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))
    except (ValueError, ElementTree.ParseError) as cause:
        raise InputError(
            f"{file}: cannot be read as SVG ({cause!s:.80}); save it as plain SVG in UTF-8"
        ) from cause
    if root.tag != f"{{{NAMESPACE}}}svg":
        raise InputError(f"{file}: is XML of another kind ({root.tag!r:.60}); wanted SVG")
    return root


def _check_size(root: ElementTree.Element, file: Path) -> None:
    level, depth, count = [root], 0, 0
    while level:
        depth, count = depth + 1, count + len(level)
        if depth > MOST_DEPTH or count > MOST_ELEMENTS:
            raise InputError(
                f"{file}: has more than {MOST_ELEMENTS} elements or {MOST_DEPTH} levels; "
                "simplify the drawing"
            )
        level = [child for element in level for child in element]


@dataclass(frozen=True)
class _Cost:
    layers: int
    masks: int


def _check_cost(root: ElementTree.Element, file: Path) -> None:
    """Count what is drawn as often as it is named. Raises InputError."""
    named = {name: each for each in root.iter() if (name := each.get("id"))}
    known: dict[ElementTree.Element, _Cost] = {}

    def cost_of(element: ElementTree.Element, depth: int) -> _Cost:
        if element in known:
            return known[element]
        targets = [named[name] for name in _named_by(element) if name in named]
        drawn = [*targets, *(child for child in element if _tag(child) not in DEFINED)]
        inside = [cost_of(each, depth + 1) for each in drawn] if depth < MOST_DEPTH else []
        found = _Cost(
            _is(element, LAYERED) + max((each.layers for each in inside), default=0),
            _is(element, MASKED) + sum(each.masks for each in inside),
        )
        if depth >= MOST_DEPTH:
            raise InputError(
                f"{file}: its parts name each other in more than {MOST_DEPTH} levels; "
                "simplify the drawing"
            )
        if found.layers > MOST_LAYERS or found.masks > MOST_MASKS:
            raise InputError(
                f"{file}: has more than {MOST_MASKS} masks, or {MOST_LAYERS} masked, clipped or "
                "translucent groups within each other; simplify the drawing"
            )
        known[element] = found
        return found

    cost_of(root, 0)


def _named_by(element: ElementTree.Element) -> set[str]:
    told = {name for value in element.attrib.values() for name in NAMED.findall(value)}
    return told | {element.get(name, "").strip().removeprefix("#") for name in HREFS}


def _is(element: ElementTree.Element, style: re.Pattern[str]) -> bool:
    said = (f"{name}:{value}" for name, value in element.attrib.items() if name != "style")
    return any(style.match(each) for each in said) or bool(style.search(element.get("style", "")))


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _clean(root: ElementTree.Element) -> None:
    left = [root]
    while left:
        element = left.pop()
        for child in list(element):
            if _is_drawn(child):
                left.append(child)
            else:
                element.remove(child)
        for name, value in list(element.attrib.items()):
            if _leads_away(name, value):
                del element.attrib[name]


def _is_drawn(element: ElementTree.Element) -> bool:
    """Comments and instructions have no name."""
    if not isinstance(element.tag, str):
        return False
    namespace, _, name = element.tag.rpartition("}")
    if namespace != f"{{{NAMESPACE}" or name not in DRAWN:
        return False
    return not (name == "style" and ELSEWHERE.search(element.text or ""))


def _leads_away(name: str, value: str) -> bool:
    if name in HREFS:
        return not value.strip().startswith("#")
    return name.lower().startswith("on") or ELSEWHERE.search(value) is not None


def _size_of(root: ElementTree.Element) -> tuple[float, float] | None:
    """Width and height by the view box, whose shape the drawing has, else as they are said."""
    box = re.split(r"[\s,]+", root.get("viewBox", "").strip())
    try:
        said = [float(part) for part in box]
    except ValueError:
        said = []
    if len(said) == 4 and all(0 < side < LARGEST for side in said[2:]):
        return said[2], said[3]
    sides = [_length(root.get(name, "")) for name in ("width", "height")]
    if all(side is not None and 0 < side < LARGEST for side in sides):
        return sides[0], sides[1]  # type: ignore[return-value]
    return None


def _length(text: str) -> float | None:
    found = LENGTH.fullmatch(text)
    try:
        return float(found[1]) * UNITS[found[2].lower()] if found else None
    except ValueError:
        return None


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
