"""Shapes of a floor: told apart by how far they reach, degrees from metres."""

import json
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.data.floor_plans import read_plan_geojson
from elfslam.data.geographic import Origin
from elfslam.data.imdf import Venue, WalkedLevel, write_imdf
from elfslam.data.map_exports import feature, polygon_of
from elfslam.data.plan_geojson import LevelError, PlanShapes, read_plan_shapes
from elfslam.data.plan_pictures import drawn_picture

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
        ([("LineString", [[0, 0]], True)], "a ring needs three corners or more and a line two"),
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


GRIDS = {
    "UTM 32N": [691_000.25, 5_335_000.5],
    "LV95": [2_600_000.0, 1_200_000.0],
    "British National Grid": [530_000.5, 180_000.25],
    "Gauss-Krueger": [4_468_000.0, 5_333_000.0],
}


@pytest.mark.parametrize("corner_m", GRIDS.values(), ids=GRIDS)
def test_a_plan_in_the_grid_of_a_country_is_in_metres_and_stays_there(
    tmp_path: Path, corner_m: list[float]
) -> None:
    moved = [("Polygon", [np.add(SQUARE, corner_m).tolist()], True)]
    moved.append(("LineString", np.add(WALL, corner_m).tolist(), True))
    shapes = ("Polygon", [SQUARE], True), ("LineString", WALL, True)
    here, _ = read_plan_geojson(written(tmp_path / "p.geojson", *shapes))
    there, origin = read_plan_geojson(written(tmp_path / "q.geojson", *moved))
    assert origin is None
    npt.assert_array_equal(there.free, here.free)
    npt.assert_allclose(there.corner_m - here.corner_m, corner_m, atol=1e-6)


def test_metres_of_a_web_map_are_refused(tmp_path: Path) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}
    file = tmp_path / "p.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [room(0)]}))
    with pytest.raises(InputError, match="Web Mercator"):
        read_plan_shapes(file)
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [room(0)]}))
    assert lefts_m(read_plan_shapes(file)) == [0.0]


def room(left_m: float, **stated: Any) -> dict[str, Any]:
    """A room 4 m wide with what is stated of it."""
    ring = [[left_m, 0], [left_m + 4, 0], [left_m + 4, 5], [left_m, 5], [left_m, 0]]
    return feature({"type": "Polygon", "coordinates": [ring]}, stated)


def lefts_m(shapes: PlanShapes) -> list[float]:
    return sorted(float(polygon[0][:, 0].min()) for polygon in shapes.ground)


HOUSE = [
    room(0, level="0"),
    room(10, level=1),
    room(20, level="0;1"),
    room(30, level="-1-1"),
    room(40, level="1", repeat_on="2-3"),
    room(50, building="yes"),
]


def in_file(file: Path, features: list[dict[str, Any]]) -> Path:
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


@pytest.mark.parametrize(
    ("level", "lefts"),
    [("-1", [30]), ("0", [0, 20, 30]), ("1", [10, 20, 30, 40]), ("1.0", [10, 20, 30, 40]),
     ("3", [40])],
)  # fmt: skip
def test_a_level_is_read_alone(tmp_path: Path, level: str, lefts: list[float]) -> None:
    """What states none, as the outline of the building, is on none of them."""
    house = in_file(tmp_path / "house.geojson", HOUSE)
    assert lefts_m(read_plan_shapes(house, level=level)) == lefts


def test_levels_are_never_mixed(tmp_path: Path) -> None:
    house = in_file(tmp_path / "house.geojson", HOUSE)
    with pytest.raises(LevelError, match=r"has the levels -1, 0, 1, 2, 3; choose one") as refused:
        read_plan_shapes(house)
    assert refused.value.choices == ("-1", "0", "1", "2", "3")
    with pytest.raises(LevelError, match=r"has no level '7', wanted one of -1, 0, 1, 2, 3"):
        read_plan_geojson(house, level="7")
    with pytest.raises(LevelError, match="choose one"):
        drawn_picture(house)
    assert drawn_picture(house, "0").width_m == pytest.approx(34.2, abs=0.01)


def test_levels_may_have_names(tmp_path: Path) -> None:
    named = [room(0, level_id="ground"), room(10, level_id="8f2e"), room(20, level="EG")]
    with pytest.raises(LevelError, match="has the levels 8f2e, EG, ground; choose one"):
        read_plan_shapes(in_file(tmp_path / "imdf.geojson", named))
    found = read_plan_shapes(tmp_path / "imdf.geojson", level="ground")
    assert lefts_m(found) == [0]


def test_a_plan_of_one_level_or_none_needs_no_choice(tmp_path: Path) -> None:
    one = in_file(tmp_path / "one.geojson", [room(0, level="4"), room(10, level=4), room(20)])
    assert lefts_m(read_plan_shapes(one)) == [0, 10, 20]
    assert lefts_m(read_plan_shapes(one, level="4")) == [0, 10]
    none = in_file(tmp_path / "none.geojson", [room(0), room(10, level=None)])
    assert lefts_m(read_plan_shapes(none)) == [0, 10]
    with pytest.raises(LevelError, match="names no level, got '4'; leave it out"):
        read_plan_shapes(none, level="4")


@pytest.mark.parametrize("level", ["0-9999", "-9999-9999", {"a": 1}, ["0", "1"], True])
def test_odd_levels_are_refused(tmp_path: Path, level: object) -> None:
    odd = in_file(tmp_path / "odd.geojson", [room(0, level=level), room(10, level="0")])
    with pytest.raises(InputError, match=r"odd\.geojson: cannot be read as GeoJSON .*level"):
        read_plan_shapes(odd)


@pytest.mark.parametrize("level", ["", ";;", None])
def test_an_empty_level_is_none(tmp_path: Path, level: object) -> None:
    odd = in_file(tmp_path / "odd.geojson", [room(0, level=level), room(10, level="0")])
    assert lefts_m(read_plan_shapes(odd)) == [0, 10]


def test_levels_of_one_file_lie_in_one_frame(tmp_path: Path) -> None:
    house = [room(0, level="0"), room(10, level="1")]
    for each in house:
        ring = np.array(each["geometry"]["coordinates"][0], dtype=float)
        each["geometry"] = polygon_of(ORIGIN, (ring[:-1],))
    file = in_file(tmp_path / "house.geojson", house)
    low, high = (read_plan_shapes(file, level=level) for level in ("0", "1"))
    assert low.origin == high.origin
    npt.assert_allclose(high.ground[0][0] - low.ground[0][0], [[10, 0]] * 4, atol=0.02)


def test_the_levels_of_an_archive_of_imdf_are_read_by_their_ordinals(tmp_path: Path) -> None:
    place = Venue("Tower", "hotel", "Hauptstrasse 1", "Bern", "CH", "Ground floor", 0)
    lines_m = {0: np.array([[0.0, 0.0], [8.0, 0.0]]), 1: np.array([[3.0, 0.0], [3.0, 20.0]])}
    levels = [WalkedLevel(replace(place, ordinal=k), [line_m]) for k, line_m in lines_m.items()]
    write_imdf(tmp_path / "tower.zip", levels, ORIGIN, datetime(2026, 1, 2, tzinfo=UTC))
    with pytest.raises(LevelError, match="levels 0, 1"):
        read_plan_shapes(tmp_path / "tower.zip")
    for level, line_m in lines_m.items():
        drawn = read_plan_shapes(tmp_path / "tower.zip", ORIGIN, str(level))
        low, high = drawn.corners_m.min(axis=0), drawn.corners_m.max(axis=0)
        npt.assert_allclose(low, line_m.min(axis=0) - 0.5, atol=0.1)
        npt.assert_allclose(high, line_m.max(axis=0) + 0.5, atol=0.1)


@pytest.mark.parametrize(
    ("levels", "said"),
    [(None, "has no unit.geojson"), ('{"features": []}', "cannot be read as IMDF"), ("{}", "IMDF")],
)
def test_an_archive_of_no_imdf_is_refused(tmp_path: Path, levels: str | None, said: str) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        unit = {"geometry": None, "properties": {"level_id": "a", "category": "room"}}
        packed.writestr("unit.geojson", json.dumps({"features": [unit]}))
        if levels is not None:
            packed.writestr("level.geojson", levels)
    with pytest.raises(InputError, match=said):
        read_plan_shapes(tmp_path / "a.zip")
