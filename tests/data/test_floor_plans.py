"""Floor plans from images and GeoJSON: walls are where they were drawn."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from PIL import Image, ImageDraw

from elfslam.base.errors import InputError
from elfslam.data.floor_plans import read_plan_geojson, read_plan_image
from elfslam.data.geographic import Origin
from elfslam.data.map_exports import feature, polygon_of
from tests.hostile_plans import png_bomb, scanned_jpeg

ORIGIN = Origin(47.3769, 8.5417, 90.0)
SQUARE = np.array([[0, 0], [6, 0], [6, 4], [0, 4]], dtype=float)


@pytest.fixture
def image() -> Image.Image:
    """A house of 8 x 4 m on 10 x 6 m of paper, 20 pixels a metre, with a table."""
    drawing = Image.new("L", (200, 120), 255)
    pen = ImageDraw.Draw(drawing)
    pen.rectangle((20, 20, 180, 100), outline=0, width=3)
    pen.rectangle((40, 70, 60, 90), fill=60)
    return drawing


@pytest.mark.parametrize("ending", ["png", "pgm", "jpg"])
def test_ground_is_light_and_within_walls(image: Image.Image, tmp_path: Path, ending: str) -> None:
    image.save(tmp_path / f"plan.{ending}")
    plan = read_plan_image(tmp_path / f"plan.{ending}", 10.0)
    assert plan.cell_m == pytest.approx(0.05)
    inside = np.array([[2.0, 4.0], [8.5, 1.5], [1.5, 3.0]])
    npt.assert_array_equal(plan.holds(inside), [True] * 3)
    off = np.array([[2.5, 2.0], [1.0, 3.0], [0.5, 0.5], [9.5, 3.0], [2.0, 5.5]])
    npt.assert_array_equal(plan.holds(off), [False] * 5)


def test_a_plan_that_fills_its_image_has_no_outside(tmp_path: Path) -> None:
    pixels = np.full((40, 60), 255, dtype=np.uint8)
    pixels[:, 30] = 0
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    plan = read_plan_image(tmp_path / "plan.png", 6.0)
    npt.assert_array_equal(plan.holds(np.array([[1.0, 2.0], [3.05, 2.0], [5, 2]])), [1, 0, 1])


def test_transparent_paper_is_light(tmp_path: Path) -> None:
    pixels = np.zeros((40, 60, 4), dtype=np.uint8)
    pixels[:, 30, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    plan = read_plan_image(tmp_path / "plan.png", 6.0)
    npt.assert_array_equal(plan.holds(np.array([[1.0, 2.0], [3.05, 2.0]])), [True, False])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("plan.png", png_bomb(6400), r"6400 by 6400 pixels, more than 40 million"),
        ("plan.jpg", scanned_jpeg(101, 80), "more than 100 scans"),
    ],
)
def test_what_unfolds_is_refused(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_plan_image(tmp_path / name, 10.0)


def test_images_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(InputError, match="cannot be read as an image"):
        read_plan_image(tmp_path / "text.png", 10.0)
    Image.new("L", (9, 9), 0).save(tmp_path / "dark.png")
    with pytest.raises(InputError, match="no light pixel"):
        read_plan_image(tmp_path / "dark.png", 10.0)
    for width_m in (0.0, 1e6, float("nan")):
        with pytest.raises(InputError, match="metres the image is wide"):
            read_plan_image(tmp_path / "dark.png", width_m)


def written(file: Path, features: list[dict[str, Any]]) -> Path:
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def test_polygons_are_ground_and_those_not_accessible_are_not(tmp_path: Path) -> None:
    hole = np.array([[1, 1], [1, 2], [2, 2], [2, 1]], dtype=float)
    table = np.array([[4, 1], [5, 1], [5, 2], [4, 2]], dtype=float)
    features = [
        feature(polygon_of(ORIGIN, (SQUARE, hole)), {}),
        feature(polygon_of(ORIGIN, (table,)), {"accessible": False}),
        feature({"type": "Point", "coordinates": [8.5, 47.3]}, {}),
        feature(None, {}),
    ]
    file = written(tmp_path / "plan.geojson", features)
    plan, frame = read_plan_geojson(file, ORIGIN)
    assert frame == ORIGIN
    asked = np.array([[0.5, 0.5], [3, 3], [1.5, 1.5], [4.5, 1.5], [-0.5, 1], [3, 4.5]])
    npt.assert_array_equal(plan.holds(asked), [1, 1, 0, 0, 0, 0])
    middle = read_plan_geojson(file)[1]
    assert middle.bearing_deg == 90.0
    assert read_plan_geojson(file)[0].holds(np.array([[0.0, 1.0]])).all()


def test_geojson_without_ground_is_refused(tmp_path: Path) -> None:
    closed = feature(polygon_of(ORIGIN, (SQUARE,)), {"accessible": False})
    wide = feature({"type": "Polygon", "coordinates": [[[0, 0], [6e8, 0], [9, 9], [0, 0]]]}, {})
    far = feature({"type": "Polygon", "coordinates": [[[0, 0], [6e3, 0], [6, 9], [0, 0]]]}, {})
    for features, what in (
        ([], "no Polygon"),
        ([closed], "no polygon is accessible"),
        ([wide], r"cannot be read .*a corner is beyond 1e\+08 m"),
        ([far], "keep one floor"),
    ):
        with pytest.raises(InputError, match=what):
            read_plan_geojson(written(tmp_path / "p.geojson", features))
    (tmp_path / "p.geojson").write_text("[1, 2]")
    with pytest.raises(InputError, match="cannot be read as GeoJSON"):
        read_plan_geojson(tmp_path / "p.geojson")


CORNERS = [[8.5, 47.3], [8.5001, 47.3], [8.5001, 47.3001], [8.5, 47.3]]


@pytest.mark.parametrize(
    "coordinates",
    [
        [],
        "POLYGON((0 0))",
        [[]],
        [[[8.5, 47.3]]],
        [[[8.5, "north"], *CORNERS]],
        [[[8.5, 10**30], *CORNERS]],
        [[CORNERS]],
        [CORNERS, []],
    ],
)
def test_polygons_that_are_none_are_refused(tmp_path: Path, coordinates: object) -> None:
    shape = {"type": "Polygon", "coordinates": coordinates}
    with pytest.raises(InputError) as refused:
        read_plan_geojson(written(tmp_path / "p.geojson", [feature(shape, {})]))
    assert str(refused.value).startswith(str(tmp_path / "p.geojson"))
    many = feature({"type": "MultiPolygon", "coordinates": [coordinates]}, {})
    with pytest.raises(InputError, match=r"p\.geojson: "):
        read_plan_geojson(written(tmp_path / "p.geojson", [many]))


@pytest.mark.parametrize(
    "text",
    [
        '{"type": "Polygon", "coordinates": [[[1e400, 0], [1, 0], [1, 1], [1e400, 0]]]}',
        '{"features": 3}',
        '{"features": [null]}',
        '{"features": [{"geometry": []}]}',
        '{"features": [{"geometry": [1]}]}',
        '{"features": [{"geometry": {"type": "Polygon"}}]}',
        "[" * 5000,
        "",
    ],
)
def test_geojson_of_another_kind_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.geojson").write_text(text)
    with pytest.raises(InputError, match="geojson"):
        read_plan_geojson(tmp_path / "p.geojson")


def test_a_plan_of_many_corners_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = written(tmp_path / "p.geojson", [feature(polygon_of(ORIGIN, (SQUARE,)), {})])
    monkeypatch.setattr("elfslam.data.plan_geojson.MOST_CORNERS", 3)
    with pytest.raises(InputError, match="has 4 corners"):
        read_plan_geojson(file)


def test_a_plan_that_lies_on_itself_is_refused_by_name(tmp_path: Path) -> None:
    shape = feature(polygon_of(ORIGIN, (100 * SQUARE / 6,)), {})
    with pytest.raises(InputError, match=r"p\.geojson: the polygons lie on each other"):
        read_plan_geojson(written(tmp_path / "p.geojson", [shape] * 500))


def test_a_large_image_is_made_smaller_and_its_walls_stay_closed(tmp_path: Path) -> None:
    """Seven thousand pixels for 70 m: three make one, and the lower left corner stays at 0, 0."""
    pixels = np.full((100, 7000), 255, dtype=np.uint8)
    pixels[:, 3500] = 0
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    plan = read_plan_image(tmp_path / "plan.png", 70.0)
    assert max(plan.free.shape) <= 3000
    assert plan.cell_m == pytest.approx(0.03)
    asked = np.array([[34.9, 0.5], [35.005, 0.5], [35.1, 0.5], [0.01, 0.01], [69.9, 0.9]])
    npt.assert_array_equal(plan.holds(asked), [1, 0, 1, 1, 1])
    assert not plan.free[:, np.flatnonzero(~plan.free.all(axis=0))].any()


def test_only_pictures_are_opened(tmp_path: Path) -> None:
    """Pillow would hand an EPS to another program."""
    (tmp_path / "plan.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n")
    with pytest.raises(InputError, match="cannot identify"):
        read_plan_image(tmp_path / "plan.png", 10.0)


@pytest.mark.parametrize("mode", ["1", "P", "RGBA", "CMYK"])
def test_ground_is_the_same_in_any_image(image: Image.Image, tmp_path: Path, mode: str) -> None:
    ending = "jpg" if mode == "CMYK" else "png"
    image.save(tmp_path / "first.png")
    image.convert("RGB").convert(mode).save(tmp_path / f"plan.{ending}")
    wanted = read_plan_image(tmp_path / "first.png", 10.0)
    found = read_plan_image(tmp_path / f"plan.{ending}", 10.0)
    assert (wanted.free != found.free).mean() < 0.01
