"""Maps as IMDF 1.0.0 archives (OGC 20-094): walked ground as units, named places as amenities.

That is all that a map knows. What the standard wants to be told on top (name, kind and address of
the venue, the level) comes from a TOML file; the extent of venue, footprint and level is the
convex hull of the walked ground with a margin.
"""

import json
import re
import uuid
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

import elfslam
from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.grid import Polygon, in_polygon, outlines, walked_grid
from elfslam.base.text_files import read_toml
from elfslam.base.values import PointKind, PointOfInterest
from elfslam.data.geographic import Origin
from elfslam.data.map_exports import feature, point_of, polygon_of

MANIFEST, VERSION = "manifest", "1.0.0"
VENUES = (
    "airport", "airport.intl", "aquarium", "businesscampus", "casino", "communitycenter",
    "conventioncenter", "governmentfacility", "healthcarefacility", "hotel", "museum",
    "parkingfacility", "resort", "retailstore", "shoppingcenter", "stadium", "stripmall",
    "theater", "themepark", "trainstation", "transitstation", "university",
)  # fmt: skip
"""Categories of a venue."""
PROPERTIES = {
    "address": (
        "address", "unit", "locality", "province", "country", "postal_code", "postal_code_ext",
        "postal_code_vanity",
    ),
    "venue": (
        "category", "restriction", "name", "alt_name", "hours", "phone", "website",
        "display_point", "address_id",
    ),
    "building": (
        "category", "restriction", "name", "alt_name", "display_point", "address_id",
    ),
    "footprint": ("category", "name", "building_ids"),
    "level": (
        "category", "restriction", "outdoor", "ordinal", "name", "short_name", "display_point",
        "address_id", "building_ids",
    ),
    "unit": (
        "category", "restriction", "accessibility", "name", "alt_name", "level_id",
        "display_point",
    ),
    "amenity": (
        "category", "accessibility", "name", "alt_name", "hours", "phone", "website", "unit_ids",
        "address_id", "correlation_id",
    ),
}  # fmt: skip
"""All that a feature of each kind must state, be it null."""
TEXT, LANGUAGE = r"(?s).*\S.*", r"[A-Za-z]{2,3}(-[A-Za-z0-9]{2,8})*"
ADDRESS = {
    "address": TEXT,
    "locality": TEXT,
    "province": r"[A-Z]{2}-[A-Z0-9]{1,3}",
    "country": r"[A-Z]{2}",
    "postal_code": TEXT,
}
"""What an address may say: ISO 3166 codes of the country and its part."""
Json = dict[str, Any]
Archive = Mapping[str, Json]
"""What each file of an archive holds, by its name without the ending."""
CELL_M = 0.1
REACH_M = 0.5
"""Ground counts as walked this far from the middle of a person, who keeps 0.4 m from walls."""
MARGIN_M = 0.5
OF_A_LEVEL = ("level", "unit", "amenity")
NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "imdf.elfslam")
CATEGORY_OF = {
    PointKind.ROOM: "unspecified",
    PointKind.DOOR: "entry",
    PointKind.STAIRS: "stairs",
    PointKind.LIFT: "elevator",
    PointKind.OTHER: "landmark",
}
"""What the standard calls each kind of point; it has rooms as units alone, whose walls we lack."""
LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""The date of every file in the archive, so that equal maps give equal bytes."""


@dataclass(frozen=True)
class Venue:
    """What an IMDF archive must say and no walk can tell."""

    name: str
    category: str
    address: str
    locality: str
    country: str
    level: str
    ordinal: int
    level_short_name: str | None = None
    province: str | None = None
    postal_code: str | None = None
    language: str = "en"


def read_place(file: Path) -> Venue:
    """The place that a TOML file describes, a line for each field. Raises InputError."""
    given = read_toml(file)
    known = {field.name: field for field in fields(Venue)}
    for name in given:
        if name not in known:
            raise InputError(f"{file}: {name:.60} is unknown, wanted {', '.join(known)}; remove it")
    for name, field in known.items():
        wanted = int if name == "ordinal" else str
        if name not in given and field.default is MISSING:
            raise InputError(
                f"{file}: {name} is missing and nobody can guess it; add a line for it"
            )
        if name in given and type(given[name]) is not wanted:
            raise InputError(
                f"{file}: {name} is {given[name]!r:.60}, wanted a {wanted.__name__}; correct it"
            )
    return Venue(**given)


@dataclass(frozen=True, eq=False)
class WalkedLevel:
    """A level of a venue: the walks on it as lines (each n, 2), and its named places."""

    place: Venue
    lines_m: Sequence[F64]
    points_of_interest: Sequence[PointOfInterest] = ()


def write_imdf(
    file: Path, levels: Sequence[WalkedLevel], origin: Origin, created: datetime
) -> None:
    """The archive of a map of one floor or several, which share a frame.

    Raises InputError where what the place says breaks a rule of the standard.
    """
    for each in levels:
        for fault in _faults_of(each.place):
            raise InputError(f"venue: would make no valid IMDF: {fault}; correct the file about it")
    archive = imdf_archive(levels, origin, created)
    [ring] = archive["venue"]["features"][0]["geometry"]["coordinates"]
    if np.ptp(np.array(ring)[:, 0]) > 180:
        raise InputError("venue: lies across longitude 180, which IMDF has no rings for; move it")
    with zipfile.ZipFile(file, "w") as packed:
        for name, content in archive.items():
            ending = "json" if name == MANIFEST else "geojson"
            entry = zipfile.ZipInfo(f"{name}.{ending}", LONG_AGO)
            entry.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(entry, json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def _faults_of(place: Venue) -> Iterator[str]:
    """What is told and breaks a rule of the standard; the rest is made to keep them."""
    if not re.fullmatch(LANGUAGE, place.language):
        yield f"manifest: language is {place.language!r}, wanted a tag such as 'en'"
    for name, allowed in ADDRESS.items():
        value = getattr(place, name)
        if value is not None and not re.fullmatch(allowed, value):
            yield f"address: property {name} cannot be {value!r}"
    if place.category not in VENUES:
        yield f"venue: category {place.category!r} is none of {', '.join(VENUES)}"
    labels = {("venue", "name"): place.name, ("level", "name"): place.level}
    labels["level", "short_name"] = place.level_short_name or place.level
    for (kind, name), label in labels.items():
        if not label.strip():
            yield f"{kind}: property {name} cannot be {_labels(place, label)!r}"


def imdf_archive(levels: Sequence[WalkedLevel], origin: Origin, created: datetime) -> Archive:
    """The manifest and a collection for each feature type; an amenity for each point."""
    place = levels[0].place
    units = [outlines(walked_grid(each.lines_m, REACH_M, CELL_M)) for each in levels]
    corners = np.concatenate([unit[0] for walked in units for unit in walked])
    extent = (_hull(corners, MARGIN_M),)
    around, middle = polygon_of(origin, extent), point_of(origin, extent[0].mean(axis=0))
    building = {"category": "unspecified", "address_id": _id(place, "address")}
    footprint = {"category": "ground", "building_ids": [_id(place, "building")]}
    features: dict[str, list[Json]] = {
        "address": [_feature(place, "address", None, _address(place))],
        "venue": [_feature(place, "venue", around, _venue(place, middle))],
        "building": [_feature(place, "building", None, building)],
        "footprint": [_feature(place, "footprint", around, footprint)],
        **{kind: [] for kind in OF_A_LEVEL},
    }
    for each, walked in zip(levels, units, strict=True):
        for made in _level_features(each, walked, origin):
            features[made["feature_type"]].append(made)
    manifest = {
        "version": VERSION,
        "created": created.astimezone(UTC).isoformat(timespec="seconds"),
        "generated_by": f"elfslam {elfslam.__version__}",
        "language": place.language,
        "extensions": None,
    }
    collections = {
        kind: {"type": "FeatureCollection", "name": kind, "features": of_kind}
        for kind, of_kind in features.items()
    }
    return {MANIFEST: manifest, **collections}


def _level_features(level: WalkedLevel, units: Sequence[Polygon], origin: Origin) -> Iterator[Json]:
    """A level, its walked ground as units, and its named places as amenities."""
    place = level.place
    extent = (_hull(np.concatenate([unit[0] for unit in units]), MARGIN_M),)
    around, middle = polygon_of(origin, extent), point_of(origin, extent[0].mean(axis=0))
    yield _feature(place, "level", around, _level(place, middle))
    for k, unit in enumerate(units):
        yield _feature(place, "unit", polygon_of(origin, unit), _unit(place, origin, unit), k)
    for k, point in enumerate(level.points_of_interest):
        spot = point_of(origin, np.array([point.x_m, point.y_m]))
        yield _feature(place, "amenity", spot, _amenity(place, point, units), k)


def _id(place: Venue, kind: str, count: int = 0) -> str:
    """The same for the same place, every time."""
    level = (place.level, str(place.ordinal)) if kind in OF_A_LEVEL else ()
    return str(uuid.uuid5(NAMESPACE, json.dumps([place.name, place.address, kind, count, *level])))


def _feature(place: Venue, kind: str, geometry: Json | None, told: Json, count: int = 0) -> Json:
    identified = {"id": _id(place, kind, count), "feature_type": kind}
    return {**identified, **feature(geometry, {**dict.fromkeys(PROPERTIES[kind]), **told})}


def _labels(place: Venue, text: str) -> Json:
    return {place.language: text}


def _address(place: Venue) -> Json:
    names = ("address", "locality", "province", "country", "postal_code")
    return {name: getattr(place, name) for name in names}


def _venue(place: Venue, middle: Json) -> Json:
    return {
        "category": place.category,
        "name": _labels(place, place.name),
        "display_point": middle,
        "address_id": _id(place, "address"),
    }


def _level(place: Venue, middle: Json) -> Json:
    return {
        "category": "unspecified",
        "outdoor": False,
        "ordinal": place.ordinal,
        "name": _labels(place, place.level),
        "short_name": _labels(place, place.level_short_name or place.level),
        "display_point": middle,
        "building_ids": [_id(place, "building")],
    }


def _unit(place: Venue, origin: Origin, unit: Polygon) -> Json:
    return {
        "category": "walkway",
        "level_id": _id(place, "level"),
        "display_point": point_of(origin, _inner_point(unit)),
    }


def _amenity(place: Venue, point: PointOfInterest, units: Sequence[Polygon]) -> Json:
    """It belongs to the walked ground that it is nearest to."""
    spot = np.array([point.x_m, point.y_m])
    away_m = [np.linalg.norm(unit[0] - spot, axis=1).min() for unit in units]
    inside = [in_polygon(unit, spot[None])[0] for unit in units]
    nearest = min(range(len(units)), key=lambda k: (not inside[k], away_m[k]))
    return {
        "category": CATEGORY_OF[point.kind],
        "name": _labels(place, point.name),
        "unit_ids": [_id(place, "unit", nearest)],
    }


def _inner_point(polygon: Polygon) -> F64:
    """The point well within a polygon that lies nearest its middle."""
    low, high = polygon[0].min(axis=0), polygon[0].max(axis=0)
    across = [np.arange(a + CELL_M / 2, b, CELL_M) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*across), axis=-1).reshape(-1, 2)
    inside = points[in_polygon(polygon, points)]
    corners = np.concatenate(polygon)
    room_m = [np.linalg.norm(corners - point, axis=1).min() for point in inside]
    roomy = inside[np.array(room_m) >= min(REACH_M / 2, max(room_m))]
    return np.asarray(roomy[np.argmin(np.linalg.norm(roomy - polygon[0].mean(axis=0), axis=1))])


def _hull(points: F64, margin_m: float) -> F64:
    """The convex hull of points (n, 2) with a margin, counter-clockwise."""
    turns = np.arange(8) * np.pi / 4
    around = margin_m * np.column_stack([np.cos(turns), np.sin(turns)])
    spread = (points[:, None, :] + around).reshape(-1, 2)
    return np.asarray(spread[ConvexHull(spread).vertices])
