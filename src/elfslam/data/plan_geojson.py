"""Floor plans in GeoJSON: polygons and lines, in longitude and latitude or in metres.

Which of both they are is told by how far the plan reaches: a floor is less than a tenth of a degree
across, and more than a metre. Metres may be those of a country's grid (UTM, LV95): they stay.

Of a plan with several levels one is read. Levels are told as in OpenStreetMap's Simple Indoor
Tagging, `level` and `repeat_on` ("0", "-1", "0;2", "0-2"), or as in IMDF, by `level_id`. Of an
archive of IMDF the units are read, on the ordinals of their levels.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.grid import Polygon
from elfslam.base.text_files import parse_json, read_json
from elfslam.base.zips import opened_zip
from elfslam.data.geographic import Origin, from_lon_lat

MOST_CORNERS = 100_000
WIDEST_M, WIDEST_DEG = 2000.0, 0.1
NARROWEST_M = 1.0
LINES = {"LineString": False, "MultiLineString": True}
POLYGONS = {"Polygon": False, "MultiPolygon": True}
"""By kind, whether there are several in one."""
LEVEL_KEYS = ("level", "repeat_on", "level_id")
RANGE = re.compile(r"(-?\d{1,4})-(-?\d{1,4})")
MOST_LEVELS = 300
WEB_MERCATOR = re.compile(r"\b(3857|900913|3785|102100)\b")
"""As a member `crs` names it: its metres are longer than metres, by half at 48 degrees."""


class LevelError(InputError):
    """A plan of several `levels` of which none was chosen, or one that is not there."""

    def __init__(self, file: Path, levels: tuple[str, ...], chosen: str | None) -> None:
        named = ", ".join(levels)
        if chosen is None:
            said = f"has the levels {named}; choose one"
        elif levels:
            said = f"has no level {chosen!r:.40}, wanted one of {named}"
        else:
            said = f"names no level, got {chosen!r:.40}; leave it out"
        super().__init__(f"{file}: {said}")
        self.choices = levels


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


@dataclass(frozen=True, eq=False)
class _Feature:
    polygons: list[tuple[Polygon, bool]]
    lines: list[F64]
    levels: set[str]


def read_plan_shapes(
    file: Path, origin: Origin | None = None, level: str | None = None
) -> PlanShapes:
    """The polygons and lines of a GeoJSON file, of one `level` where it has several.

    Polygons whose property `accessible` is false are walls or furniture. In degrees, without an
    origin, that is the middle of all corners, x to the east: levels of one file share a frame.
    Raises InputError, as LevelError where a level is to be chosen.
    """
    every = _features(file)
    found = _shapes(file, _on_level(file, every, level))
    corners = found.corners_m
    if np.ptp(corners, axis=0).max() < WIDEST_DEG and (np.abs(corners) <= [180, 90]).all():
        found = _in_metres(found, origin or _middle(_shapes(file, every).corners_m))
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


CLOSED_UNITS = ("column", "nonpublic", "opentobelow", "structure", "unenclosed.opentobelow")
"""Categories of units that nobody walks on."""


def _units_of(file: Path) -> dict[str, Any]:
    """The units of an archive of IMDF as features that state their level and who may walk there."""
    with opened_zip(file) as packed:
        named = {path.name: entry for path, entry in packed.entries.items()}
        if not {"unit.geojson", "level.geojson"} <= named.keys():
            raise InputError(f"{file}: has no unit.geojson and level.geojson; is it IMDF?")
        units, levels = (
            parse_json(packed.text(named[f"{kind}.geojson"]), f"{file}:{kind}.geojson")["features"]
            for kind in ("unit", "level")
        )
    ordinal = {each["id"]: each["properties"]["ordinal"] for each in levels}
    told = [each["properties"] for each in units]
    return {
        "features": [
            {
                "geometry": unit["geometry"],
                "properties": {
                    "level": ordinal[known["level_id"]],
                    "accessible": known["category"] not in CLOSED_UNITS,
                },
            }
            for unit, known in zip(units, told, strict=True)
        ]
    }


def _features(file: Path) -> list[_Feature]:
    try:
        content = _units_of(file) if file.suffix.lower() == ".zip" else read_json(file)
    except (KeyError, TypeError) as cause:
        raise InputError(f"{file}: cannot be read as IMDF ({cause!r:.80}); check it") from cause
    if isinstance(content, dict) and WEB_MERCATOR.search(json.dumps(content.get("crs"))):
        raise InputError(
            f"{file}: is in Web Mercator, whose metres are longer; wanted longitude and latitude "
            "(RFC 7946) or a metric grid such as UTM; export it as that"
        )
    try:
        return [
            _Feature(_polygons_of(each), _lines_of(each), _levels_of(each))
            for each in content.get("features", [content])
        ]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as cause:
        raise InputError(f"{file}: cannot be read as GeoJSON ({cause!r:.80}); check it") from cause


def _shapes(file: Path, features: list[_Feature]) -> PlanShapes:
    polygons = [polygon for each in features for polygon in each.polygons]
    lines = [line for each in features for line in each.lines]
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


def _on_level(file: Path, features: list[_Feature], level: str | None) -> list[_Feature]:
    """The features of a level, of the only one where none is chosen.

    What states no level is on none of several: a building's outline would open all of its floors.
    Raises LevelError.
    """
    levels = tuple(sorted({name for each in features for name in each.levels}, key=_height))
    if level is None and len(levels) < 2:
        return features
    wanted = None if level is None else _level_name(level)
    if wanted not in levels:
        raise LevelError(file, levels, level)
    return [each for each in features if wanted in each.levels]


def _levels_of(feature: dict[str, Any]) -> set[str]:
    """The names of the levels that a feature states it is on, or that it is repeated on."""
    properties = feature.get("properties") or {}
    stated = [properties[key] for key in LEVEL_KEYS if properties.get(key) is not None]
    if odd := [each for each in stated if type(each) not in (str, int, float)]:
        raise ValueError(f"the level {odd[0]!r:.30} is no text")
    parts = [part.strip() for each in stated for part in str(each).split(";")]
    return {name for part in parts for name in _named(part)}


def _named(part: str) -> Iterator[str]:
    """The levels of "1", of the range "0-2", or of a name. Raises ValueError for far too many."""
    if ends := RANGE.fullmatch(part):
        first, last = sorted(map(int, ends.groups()))
        if last - first >= MOST_LEVELS:
            raise ValueError(f"the levels {part} are no building's")
        yield from map(str, range(first, last + 1))
    elif part:
        yield _level_name(part)


def _level_name(text: str) -> str:
    """A level as it is compared: 0, "0" and "0.0" are one."""
    try:
        return f"{float(text):g}"
    except ValueError:
        return text.strip()


def _height(level: str) -> tuple[float, str]:
    try:
        return float(level), level
    except ValueError:
        return np.inf, level


def _parts(feature: dict[str, Any], kinds: dict[str, bool]) -> list[Any]:
    geometry = feature.get("geometry", feature) or {}
    many = kinds.get(str(geometry.get("type")))
    if many is None:
        return []
    return list(geometry["coordinates"]) if many else [geometry["coordinates"]]


def _polygons_of(feature: dict[str, Any]) -> list[tuple[Polygon, bool]]:
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
    if found.ndim != 2 or len(found) < least:
        raise ValueError("a ring needs three corners or more and a line two")
    # NaN fails the comparison.
    if not (np.abs(found) <= FARTHEST_M).all():
        raise ValueError(f"a corner is beyond {FARTHEST_M:g} m")
    return found
