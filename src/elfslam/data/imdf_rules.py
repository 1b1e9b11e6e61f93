"""The rules of IMDF 1.0.0 (OGC 20-094) for the features that a walked map can have.

Rules of geometry are those of RFC 7946: rings closed, outer ones counter-clockwise.
"""

from __future__ import annotations

import re
import uuid
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.grid import in_polygon, signed_area

MANIFEST = "manifest"
VERSION = "1.0.0"
VENUES = (
    "airport", "airport.intl", "aquarium", "businesscampus", "casino", "communitycenter",
    "conventioncenter", "governmentfacility", "healthcarefacility", "hotel", "museum",
    "parkingfacility", "resort", "retailstore", "shoppingcenter", "stadium", "stripmall",
    "theater", "themepark", "trainstation", "transitstation", "university",
)  # fmt: skip
CATEGORIES: Mapping[str, tuple[str, ...]] = {
    "venue": VENUES,
    "building": ("parking", "transit", "transit.bus", "transit.train", "unspecified"),
    "footprint": ("aerial", "ground", "subterranean"),
    "level": ("arrivals", "departures", "parking", "transit", "unspecified"),
    "unit": ("room", "walkway", "unspecified"),
    "amenity": ("elevator", "entry", "landmark", "stairs", "unspecified"),
}
RESTRICTIONS = ("employeesonly", "restricted")
POLYGONAL = ("venue", "footprint", "level", "unit")
EDGE_DEG = 1e-9
"""Corners closer than this are the same."""

Json = dict[str, Any]
Archive = Mapping[str, Json]
"""What each file of an archive holds, by its name without the ending."""


def _text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _labels(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and bool(value)
        and all(_tag(key) and _text(label) for key, label in value.items())
    )


def _tag(value: Any) -> bool:
    return isinstance(value, str) and bool(
        re.fullmatch(r"[A-Za-z]{2,3}(-[A-Za-z0-9]{2,8})*", value)
    )


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _or_null(rule: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or rule(value)


def _point(value: Any) -> bool:
    return isinstance(value, dict) and value.get("type") == "Point" and _positions([value])


def _positions(points: list[Json]) -> bool:
    try:
        places = np.array([point["coordinates"] for point in points], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        return False
    return bool(places.shape[1:] == (2,) and (np.abs(places) <= [180, 90]).all())


def _country(value: Any) -> bool:
    return isinstance(value, str) and bool(re.fullmatch(r"[A-Z]{2}", value))


def _province(value: Any) -> bool:
    return isinstance(value, str) and bool(re.fullmatch(r"[A-Z]{2}-[A-Z0-9]{1,3}", value))


def _restriction(value: Any) -> bool:
    return value in RESTRICTIONS


def _reference(value: Any) -> bool:
    return isinstance(value, str)


def _references(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(_reference(each) for each in value)


def _list(value: Any) -> bool:
    return isinstance(value, list)


OPTIONAL_LABELS = _or_null(_labels)
PROPERTIES: Mapping[str, Mapping[str, Callable[[Any], bool]]] = {
    "address": {
        "address": _text,
        "unit": _or_null(_text),
        "locality": _text,
        "province": _or_null(_province),
        "country": _country,
        "postal_code": _or_null(_text),
        "postal_code_ext": _or_null(_text),
        "postal_code_vanity": _or_null(_text),
    },
    "venue": {
        "category": _text,
        "restriction": _or_null(_restriction),
        "name": _labels,
        "alt_name": OPTIONAL_LABELS,
        "hours": _or_null(_text),
        "phone": _or_null(_text),
        "website": _or_null(_text),
        "display_point": _point,
        "address_id": _reference,
    },
    "building": {
        "category": _text,
        "restriction": _or_null(_restriction),
        "name": OPTIONAL_LABELS,
        "alt_name": OPTIONAL_LABELS,
        "display_point": _or_null(_point),
        "address_id": _or_null(_reference),
    },
    "footprint": {"category": _text, "name": OPTIONAL_LABELS, "building_ids": _references},
    "level": {
        "category": _text,
        "restriction": _or_null(_restriction),
        "outdoor": lambda value: isinstance(value, bool),
        "ordinal": _whole,
        "name": _labels,
        "short_name": _labels,
        "display_point": _or_null(_point),
        "address_id": _or_null(_reference),
        "building_ids": _or_null(_references),
    },
    "unit": {
        "category": _text,
        "restriction": _or_null(_restriction),
        "accessibility": _or_null(_list),
        "name": OPTIONAL_LABELS,
        "alt_name": OPTIONAL_LABELS,
        "level_id": _reference,
        "display_point": _or_null(_point),
    },
    "amenity": {
        "category": _text,
        "accessibility": _or_null(_list),
        "name": OPTIONAL_LABELS,
        "alt_name": OPTIONAL_LABELS,
        "hours": _or_null(_text),
        "phone": _or_null(_text),
        "website": _or_null(_text),
        "unit_ids": _references,
        "address_id": _or_null(_reference),
        "correlation_id": _or_null(_reference),
    },
}
REFERS_TO = {
    "address_id": "address",
    "building_ids": "building",
    "level_id": "level",
    "unit_ids": "unit",
}
WITHIN = (("unit", "level"), ("level", "venue"), ("footprint", "venue"))


def faults_of(archive: Archive) -> list[str]:
    """What breaks the rules, a line each; nothing where the archive is valid."""
    faults = [*_manifest_faults(archive.get(MANIFEST, {}))]
    for kind in PROPERTIES:
        if kind not in archive:
            faults.append(f"{kind}.geojson is missing")
    for kind in archive:
        if kind != MANIFEST and kind not in PROPERTIES:
            faults.append(f"{kind}.geojson: no such feature type here")
    known = {kind: _features(archive, kind) for kind in PROPERTIES}
    if len(known["venue"]) != 1:
        faults.append(f"venue: wanted one, got {len(known['venue'])}")
    for kind, features in known.items():
        for feature in features:
            faults += [f"{kind}: {what}" for what in _feature_faults(kind, feature)]
    return faults or [*_id_faults(known), *_place_faults(known)]


def _features(archive: Archive, kind: str) -> list[Json]:
    content = archive.get(kind, {})
    return list(content.get("features", [])) if content.get("type") == "FeatureCollection" else []


def _manifest_faults(manifest: Json) -> Iterator[str]:
    if manifest.get("version") != VERSION:
        yield f"manifest: version is {manifest.get('version')!r}, wanted {VERSION!r}"
    if not _tag(manifest.get("language")):
        yield f"manifest: language is {manifest.get('language')!r}, wanted a tag such as 'en'"
    try:
        datetime.fromisoformat(str(manifest.get("created")))
    except ValueError:
        yield f"manifest: created is {manifest.get('created')!r}, wanted a date and time"


def _feature_faults(kind: str, feature: Json) -> Iterator[str]:
    if feature.get("type") != "Feature" or feature.get("feature_type") != kind:
        yield f"is no Feature of feature_type {kind!r}"
    if not _is_uuid(feature.get("id")):
        yield f"id {feature.get('id')!r} is no UUID"
    given = feature.get("properties") or {}
    for name, rule in PROPERTIES[kind].items():
        if name not in given:
            yield f"property {name} is missing"
        elif not rule(given[name]):
            yield f"property {name} cannot be {given[name]!r}"
    wanted = CATEGORIES.get(kind)
    if wanted and given.get("category") not in wanted:
        yield f"category {given.get('category')!r} is none of {', '.join(wanted)}"
    geometry = feature.get("geometry", "")
    if kind in POLYGONAL:
        yield from _geometry_faults(geometry)
    elif kind == "amenity":
        if not _point(geometry):
            yield "geometry is no Point"
    elif geometry is not None:
        yield "geometry is not null"


def _is_uuid(value: Any) -> bool:
    try:
        return bool(str(uuid.UUID(value)) == value)
    except (ValueError, AttributeError, TypeError):
        return False


def polygons_of(geometry: Json) -> list[list[F64]]:
    """The polygons of a geometry as lists of rings (k, 2) without their repeated last point."""
    parts = geometry["coordinates"]
    parts = [parts] if geometry["type"] == "Polygon" else parts
    return [[np.array(ring, dtype=np.float64)[:-1] for ring in rings] for rings in parts]


def _geometry_faults(geometry: Any) -> Iterator[str]:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon"):
        yield f"geometry is {kind}, wanted a Polygon or MultiPolygon"
        return
    parts = geometry["coordinates"]
    for rings in [parts] if kind == "Polygon" else parts:
        for k, ring in enumerate(rings):
            yield from _ring_faults(np.array(ring, dtype=np.float64), hole=k > 0)


def _ring_faults(closed: F64, *, hole: bool) -> Iterator[str]:
    if closed.ndim != 2 or closed.shape[1] != 2 or len(closed) < 4:
        yield "a ring has fewer than four positions"
        return
    ring = closed[:-1]
    if (closed[0] != closed[-1]).any():
        yield "a ring is not closed"
    elif not (np.abs(closed) <= [180, 90]).all():
        yield "a ring leaves longitude and latitude"
    elif (signed_area(ring) > 0) == hole:
        yield "a ring runs the wrong way round"
    elif crosses_itself(ring):
        yield "a ring crosses or touches itself"


def crosses_itself(ring: F64) -> bool:
    """Whether two sides of a ring (k, 2) meet, neighbours at their common corner aside."""
    if len(np.unique(ring, axis=0)) < len(ring):
        return True
    a, b = ring, np.roll(ring, -1, axis=0)
    for k in range(len(ring) - 2):
        rest = slice(k + 2, len(ring) - (k == 0))
        c, d = a[rest], b[rest]
        sides = (_side(a[k], b[k], c), _side(a[k], b[k], d), _side(c, d, a[k]), _side(c, d, b[k]))
        if ((sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)).any():
            return True
    return False


def _side(a: F64, b: F64, point: F64) -> F64:
    """Which side of the line ab a point lies on: -1, 0 or 1."""
    along, to = b - a, point - a
    return np.asarray(np.sign(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]))


def _id_faults(known: Mapping[str, list[Json]]) -> Iterator[str]:
    ids = {kind: [feature["id"] for feature in features] for kind, features in known.items()}
    every = [each for of_kind in ids.values() for each in of_kind]
    if len(set(every)) < len(every):
        yield "two features share an id"
    for kind, features in known.items():
        for feature in features:
            for name, target in REFERS_TO.items():
                named = feature["properties"].get(name) or []
                for each in named if isinstance(named, list) else [named]:
                    if each not in ids[target]:
                        yield f"{kind}: {name} names {each}, which is no {target}"


def _place_faults(known: Mapping[str, list[Json]]) -> Iterator[str]:
    for kind in POLYGONAL:
        for feature in known[kind]:
            shown = feature["properties"].get("display_point")
            if shown and not _holds(feature, np.array([shown["coordinates"]])):
                yield f"{kind}: the display point lies outside"
    for kind, larger in WITHIN:
        for feature in known[kind]:
            corners = np.concatenate([rings[0] for rings in polygons_of(feature["geometry"])])
            if not any(_holds(each, corners) for each in known[larger]):
                yield f"{kind}: reaches beyond its {larger}"


def _holds(feature: Json, points: F64) -> bool:
    """Whether all points lie within a feature; its own corners do."""
    inside = np.zeros(len(points), dtype=np.bool_)
    for rings in polygons_of(feature["geometry"]):
        inside |= in_polygon(tuple(rings), points)
        inside |= (np.abs(points[:, None] - rings[0]).max(axis=2) <= EDGE_DEG).any(axis=1)
    return bool(inside.all())
