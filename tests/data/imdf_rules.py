"""The rules of IMDF 1.0.0 (OGC 20-094) for what a walked map can have, by an engine of geometry.

Rules of geometry are those of RFC 7946: rings closed, outer ones counter-clockwise.
"""

import json
import re
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path, PurePath
from typing import Any

import shapely
from shapely.geometry import shape

from elfslam.data.imdf import LANGUAGE, MANIFEST, PROPERTIES, VENUES, VERSION, Archive, Json

CATEGORIES = {
    "venue": VENUES,
    "building": ("parking", "transit", "transit.bus", "transit.train", "unspecified"),
    "footprint": ("aerial", "ground", "subterranean"),
    "level": ("arrivals", "departures", "parking", "transit", "unspecified"),
    "unit": ("room", "walkway", "unspecified"),
    "amenity": ("elevator", "entry", "landmark", "stairs", "unspecified"),
}
POLYGONAL = ("venue", "footprint", "level", "unit")
WITHIN = {"unit": "level", "level": "venue", "footprint": "venue"}
REFERS_TO = {"address_id": "address", "building_ids": "building", "level_id": "level"}
REFERS_TO |= {"unit_ids": "unit"}
EDGE_DEG = 1e-9
"""Corners closer than this are the same."""


def _text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _labels(value: Any) -> bool:
    return bool(value) and all(re.fullmatch(LANGUAGE, k) and _text(v) for k, v in value.items())


def _point(value: Any) -> bool:
    return (
        bool(value)
        and value["type"] == "Point"
        and shape(value).within(shapely.box(-180, -90, 180, 90))
    )


def _references(value: Any) -> bool:
    return isinstance(value, list) and bool(value)


RULES: Mapping[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("category", "address", "locality", "level_id"), _text),
    "country": lambda value: bool(re.fullmatch("[A-Z]{2}", value)),
    "building_ids": _references,
    "unit_ids": _references,
    "outdoor": lambda value: isinstance(value, bool),
    "ordinal": lambda value: type(value) is int,
    "short_name": _labels,
}
"""Of properties that are never null."""
OPTIONAL: Mapping[str, Callable[[Any], bool]] = {
    "name": _labels,
    "display_point": _point,
    "address_id": _text,
    "postal_code": _text,
    "province": lambda value: bool(re.fullmatch("[A-Z]{2}-[A-Z0-9]{1,3}", value)),
}
NAMED = ("venue", "level")
"""Kinds whose name is never null."""


def read_imdf(file: Path) -> dict[str, Json]:
    """What each file of an archive holds, by its name without the ending."""
    with zipfile.ZipFile(file) as packed:
        return {PurePath(name).stem: json.loads(packed.read(name)) for name in packed.namelist()}


def faults_of(archive: Archive) -> list[str]:
    """What breaks the rules, a line each; nothing where the archive is valid."""
    manifest = archive[MANIFEST]
    assert (manifest["version"], archive.keys()) == (VERSION, {MANIFEST, *PROPERTIES})
    assert re.fullmatch(LANGUAGE, manifest["language"])
    assert datetime.fromisoformat(manifest["created"])
    known = {kind: archive[kind]["features"] for kind in PROPERTIES}
    assert len(known["venue"]) == 1
    faults = [
        f"{kind}: {what}"
        for kind, features in known.items()
        for each in features
        for what in _feature_faults(kind, each)
    ]
    return faults or [*_id_faults(known), *_place_faults(known)]


def _feature_faults(kind: str, feature: Json) -> Iterator[str]:
    if (feature["type"], feature["feature_type"]) != ("Feature", kind):
        yield f"is no Feature of feature_type {kind!r}"
    if str(uuid.UUID(feature["id"])) != feature["id"]:
        yield f"id {feature['id']!r} is no UUID"
    given = feature["properties"]
    if given.keys() != set(PROPERTIES[kind]):
        yield f"states {', '.join(given)}"
    for name, value in given.items():
        always = RULES.get(name) or (
            OPTIONAL.get(name) if kind in NAMED and name == "name" else None
        )
        rule = always or (OPTIONAL.get(name) if value is not None else None)
        if rule and not rule(value):
            yield f"property {name} cannot be {value!r}"
    if kind in CATEGORIES and given["category"] not in CATEGORIES[kind]:
        yield f"category {given['category']!r} is none of {', '.join(CATEGORIES[kind])}"
    geometry = feature["geometry"]
    if kind in POLYGONAL:
        made = shape(geometry)
        if not (made.geom_type == "Polygon" and made.is_valid and made.exterior.is_ccw):
            yield "geometry is no Polygon, crosses itself or runs the wrong way round"
    elif (geometry is not None) != (kind == "amenity"):
        yield "geometry is not null, or no Point"


def _id_faults(known: Mapping[str, list[Json]]) -> Iterator[str]:
    ids = {kind: [each["id"] for each in features] for kind, features in known.items()}
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
            made, shown = shape(feature["geometry"]), feature["properties"].get("display_point")
            if shown and not made.contains(shape(shown)):
                yield f"{kind}: the display point lies outside"
            larger = [shape(each["geometry"]) for each in known[WITHIN.get(kind, kind)]]
            if not any(each.buffer(EDGE_DEG).covers(made) for each in larger):
                yield f"{kind}: reaches beyond its {WITHIN.get(kind)}"
