"""Maps as GeoJSON (RFC 7946) in WGS84 degrees: walks, spots, coverage and points of interest."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.grid import Polygon
from elfslam.base.values import FloorMap, PointOfInterest
from elfslam.data.geographic import Origin, bearings_deg, to_lon_lat

DIGITS = 9
"""Of a degree: a tenth of a millimetre."""
GAP_M = 2.0
"""Spots of one walk further apart than this are not joined: between them nothing is known."""

Feature = dict[str, Any]


def walk_lines(floor_map: FloorMap) -> list[tuple[int, F64]]:
    """The lines (n, 2) of each walk in their order, cut where spots lie far apart."""
    found = []
    for walk in np.unique(floor_map.walk):
        rows = np.flatnonzero(floor_map.walk == walk)
        line = floor_map.xy_m[rows[np.argsort(floor_map.order[rows], kind="stable")]]
        gaps = np.flatnonzero(np.linalg.norm(np.diff(line, axis=0), axis=1) > GAP_M) + 1
        found += [(int(walk), part) for part in np.split(line, gaps)]
    return found


def sigma_m(floor_map: FloorMap) -> F64:
    """The uncertainty (m) of each spot, root mean square per axis."""
    return np.asarray(np.sqrt(np.trace(floor_map.covariance_m2, axis1=1, axis2=2) / 2))


def write_geojson(
    file: Path,
    floor_map: FloorMap,
    origin: Origin,
    cells: Sequence[tuple[F64, Feature]] = (),
    points_of_interest: Sequence[PointOfInterest] = (),
) -> None:
    """Walks as LineStrings, spots and points of interest as Points, and cells as Polygons.

    A cell is a ring (k, 2) and its properties.
    """
    features = [*_walks(floor_map, origin), *_spots(floor_map, origin)]
    features += [feature(polygon_of(origin, (ring,)), told) for ring, told in cells]
    features += [_point_of_interest(origin, each) for each in points_of_interest]
    content = {"type": "FeatureCollection", "features": features}
    file.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")


def feature(geometry: Feature | None, properties: Feature) -> Feature:
    """A GeoJSON feature."""
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def polygon_of(origin: Origin, polygon: Polygon) -> Feature:
    """A polygon's geometry; its rings are closed."""
    rings = [positions(origin, np.vstack([ring, ring[:1]])) for ring in polygon]
    return {"type": "Polygon", "coordinates": rings}


def point_of(origin: Origin, xy_m: F64) -> Feature:
    """A point's geometry."""
    return {"type": "Point", "coordinates": positions(origin, xy_m[None, :])[0]}


def positions(origin: Origin, xy_m: F64) -> list[list[float]]:
    """Longitude and latitude of points (n, 2), rounded."""
    rounded: list[list[float]] = np.round(to_lon_lat(origin, xy_m), DIGITS).tolist()
    return rounded


def _point_of_interest(origin: Origin, point: PointOfInterest) -> Feature:
    told = {"kind": "point_of_interest", "name": point.name, "category": point.kind}
    return feature(point_of(origin, np.array([point.x_m, point.y_m])), told)


def _walks(floor_map: FloorMap, origin: Origin) -> Iterator[Feature]:
    for walk, line in walk_lines(floor_map):
        if len(line) > 1:
            geometry = {"type": "LineString", "coordinates": positions(origin, line)}
            told = {"kind": "walk", "walk": walk, "source": _source(floor_map, walk)}
            yield feature(geometry, told)


def _source(floor_map: FloorMap, walk: int) -> str | None:
    return floor_map.sources[walk] if walk < len(floor_map.sources) else None


def _spots(floor_map: FloorMap, origin: Origin) -> Iterator[Feature]:
    places = positions(origin, floor_map.xy_m)
    bearings = bearings_deg(origin, floor_map.heading_rad)
    for k, sigma in enumerate(sigma_m(floor_map)):
        told = {
            "kind": "spot",
            "walk": int(floor_map.walk[k]),
            "order": int(floor_map.order[k]),
            "bearing_deg": round(float(bearings[k]), 2),
            "sigma_m": round(float(sigma), 4),
        }
        yield feature({"type": "Point", "coordinates": places[k]}, told)
