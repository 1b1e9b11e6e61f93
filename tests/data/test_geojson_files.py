"""Maps as GeoJSON: what another reader finds is what the map says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import shapely
from shapely.geometry import shape

from elfslam.base.values import FloorMap, PointKind, PointOfInterest
from elfslam.data.geographic import Origin, from_lon_lat
from elfslam.data.geojson_files import walk_lines, write_geojson

ORIGIN = Origin(47.3769, 8.5417, 30.0)


@pytest.fixture
def floor_map() -> FloorMap:
    """Two walks, the second one with a gap, its spots out of order."""
    xy_m = np.array([[0, 0], [1, 0], [2, 0], [9, 1], [0, 1], [1, 1], [8, 1]], dtype=float)
    walk, order = np.array([0, 0, 0, 1, 1, 1, 1]), np.array([0, 1, 2, 3, 0, 1, 2])
    covariance = np.tile(np.diag([0.04, 0.0]), (7, 1, 1))
    heading = np.linspace(0, 3, 7)
    return FloorMap(xy_m, heading, walk, order, covariance, (), "", ("first", "second"))


def read(file: Path, kind: str) -> list[dict[str, object]]:
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["type"] == "FeatureCollection"
    assert "crs" not in content, "RFC 7946 knows WGS84 alone"
    return [each for each in content["features"] if each["properties"]["kind"] == kind]


def test_walks_spots_and_cells_are_where_the_map_has_them(
    floor_map: FloorMap, tmp_path: Path
) -> None:
    ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    write_geojson(tmp_path / "m.geojson", floor_map, ORIGIN, [(ring, {"kind": "coverage"})])
    spots = read(tmp_path / "m.geojson", "spot")
    points = shapely.get_coordinates([shape(each["geometry"]) for each in spots])
    npt.assert_allclose(from_lon_lat(ORIGIN, points), floor_map.xy_m, atol=1e-3)
    told = [each["properties"] for each in spots]
    assert [each["walk"] for each in told] == floor_map.walk.tolist()
    assert told[0]["sigma_m"] == pytest.approx(np.sqrt(0.02), abs=1e-4)
    assert told[0]["bearing_deg"] == 30.0
    walks = read(tmp_path / "m.geojson", "walk")
    assert [each["geometry"]["type"] for each in walks] == ["LineString"] * 3
    assert [each["properties"]["source"] for each in walks] == ["first", "second", "second"]
    (cell,) = read(tmp_path / "m.geojson", "coverage")
    polygon = shape(cell["geometry"])
    assert polygon.is_valid
    assert polygon.exterior.is_ccw


def test_points_of_interest_are_points_with_a_name(floor_map: FloorMap, tmp_path: Path) -> None:
    door = PointOfInterest("Tür 5", PointKind.DOOR, 1.5, -2.0)
    write_geojson(tmp_path / "m.geojson", floor_map, ORIGIN, points_of_interest=[door])
    (told,) = read(tmp_path / "m.geojson", "point_of_interest")
    assert told["properties"] == {"kind": "point_of_interest", "name": "Tür 5", "category": "door"}
    place = shapely.get_coordinates(shape(told["geometry"]))
    npt.assert_allclose(from_lon_lat(ORIGIN, place), [[1.5, -2.0]], atol=1e-3)


def test_walks_are_ordered_and_cut_at_gaps(floor_map: FloorMap) -> None:
    lines = walk_lines(floor_map)
    assert [walk for walk, _ in lines] == [0, 1, 1]
    npt.assert_allclose(lines[1][1], [[0, 1], [1, 1]])
    npt.assert_allclose(lines[2][1], [[8, 1], [9, 1]])
