"""Floor plans in SVG, made harmless: shapes and words stay, all that runs or fetches goes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from elfslam.base.errors import InputError

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
    """Layers that are drawn within each other, and masks."""

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
    """The identifiers of parts of the drawing that are drawn for an element."""
    told = {name for value in element.attrib.values() for name in NAMED.findall(value)}
    return told | {element.get(name, "").strip().removeprefix("#") for name in HREFS}


def _is(element: ElementTree.Element, style: re.Pattern[str]) -> bool:
    """Whether an attribute or the style of an element matches."""
    said = (f"{name}:{value}" for name, value in element.attrib.items() if name != "style")
    return any(style.match(each) for each in said) or bool(style.search(element.get("style", "")))


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _clean(root: ElementTree.Element) -> None:
    """Take out elements and attributes that are not drawn, or name what lies elsewhere."""
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
