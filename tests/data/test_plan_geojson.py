"""Shapes of a floor: told apart by how far they reach, degrees from metres."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.data.floor_plans import read_plan_geojson
from elfslam.data.geographic import Origin
from elfslam.data.geojson_files import feature, polygon_of
from elfslam.data.plan_geojson import read_plan_shapes

ORIGIN = Origin(47.3769, 8.5417, 90.0)
SQUARE = [[2.0, 1.0], [26.5, 1.0], [26.5, 19.0], [2.0, 19.0], [2.0, 1.0]]
WALL = [[14.0, 1.0], [14.0, 12.0]]


def written(file: Path, *shapes: tuple[str, Any, bool]) -> Path:
    features = [
        feature({"type": kind, "coordinates": coordinates}, {"accessible": accessible})
        for kind, coordinates, accessible in shapes
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def test_metres_stay_as_they_are_and_lie_nowhere(tmp_path: Path) -> None:
    file = written(tmp_path / "p.geojson", ("Polygon", [SQUARE], True), ("LineString", WALL, True))
    shapes = read_plan_shapes(file)
    assert shapes.origin is None
    npt.assert_array_equal(shapes.ground[0][0], SQUARE[:-1])
    npt.assert_array_equal(shapes.lines[0], WALL)


def test_degrees_become_metres_about_their_middle(tmp_path: Path) -> None:
    metres = np.array(SQUARE[:-1])
    shape = polygon_of(ORIGIN, (metres,))
    file = written(tmp_path / "p.geojson", ("Polygon", shape["coordinates"], True))
    shapes = read_plan_shapes(file, ORIGIN)
    assert shapes.origin == ORIGIN
    npt.assert_allclose(shapes.ground[0][0], metres, atol=0.02)
    middle = read_plan_shapes(file)
    npt.assert_allclose(np.ptp(middle.corners_m, axis=0), [24.5, 18.0], atol=0.02)


def test_lines_are_walls_on_the_ground(tmp_path: Path) -> None:
    file = written(tmp_path / "p.geojson", ("Polygon", [SQUARE], True), ("LineString", WALL, True))
    ground, origin = read_plan_geojson(file)
    assert origin is None
    asked = np.array([[14.0, 5.0], [13.5, 5.0], [14.5, 5.0], [14.0, 15.0], [1.0, 5.0]])
    npt.assert_array_equal(ground.holds(asked), [0, 1, 1, 1, 0])


@pytest.mark.parametrize("kind", ["LineString", "MultiLineString"])
def test_walls_alone_enclose_the_ground(tmp_path: Path, kind: str) -> None:
    lines = SQUARE if kind == "LineString" else [SQUARE, WALL]
    ground, _ = read_plan_geojson(written(tmp_path / "p.geojson", (kind, lines, True)))
    asked = np.array([[5.0, 5.0], [20.0, 18.0], [1.5, 5.0], [27.5, 5.0], [14.0, 5.0]])
    inside = [1, 1, 0, 0, int(kind == "LineString")]
    npt.assert_array_equal(ground.holds(asked), inside)
    blocked = written(
        tmp_path / "q.geojson",
        ("LineString", SQUARE, True),
        ("Polygon", [[[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]]], False),
    )
    npt.assert_array_equal(read_plan_geojson(blocked)[0].holds(asked[:2]), [0, 1])


@pytest.mark.parametrize(
    ("shapes", "words"),
    [
        ([("LineString", WALL, True)], "enclose no ground"),
        ([("LineString", [[0, 0]], True)], "cannot be read as GeoJSON"),
        ([("LineString", 3, True)], "cannot be read as GeoJSON"),
        ([("LineString", [[0, 0], [1e9, 0]], True)], "cannot be read as GeoJSON"),
        ([("LineString", [[0, 0], [5000, 0]], True)], "5000 m across, wanted 1 to 2000"),
        ([("LineString", [[0, 0], [0.5, 0]], True)], "0.5 m across"),
        ([("LineString", [[8.5, 47.3], [8.55, 47.3]], True)], "keep one floor"),
        ([("LineString", [[8.5, 47.3], [8.5, 47.3]], True)], "0 m across"),
        ([("Point", [0, 0], True)], "no Polygon and no LineString"),
    ],
)
def test_what_is_no_floor_is_refused_in_one_line(
    tmp_path: Path, shapes: list[tuple[str, Any, bool]], words: str
) -> None:
    with pytest.raises(InputError, match=words) as refused:
        read_plan_geojson(written(tmp_path / "p.geojson", *shapes))
    assert str(refused.value).startswith(str(tmp_path / "p.geojson"))
