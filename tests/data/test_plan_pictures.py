"""Plans that are no pictures are drawn as one: where a wall was, it is dark."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from PIL import Image
from planted_plans import SVG, pdf

from elfslam.base.errors import InputError
from elfslam.data.floor_plans import read_plan_image
from elfslam.data.plan_pictures import MOST_SIDE_PX, PlanKind, drawn_picture, kind_of


def drawn(tmp_path: Path, content: bytes) -> Image.Image:
    (tmp_path / "plan").write_bytes(content)
    return Image.open(io.BytesIO(drawn_picture(tmp_path / "plan").content))


@pytest.mark.parametrize("content", [SVG.encode(), pdf(), pdf(3)], ids=["SVG", "PDF", "3 pages"])
def test_a_wall_is_dark_where_it_was_drawn(tmp_path: Path, content: bytes) -> None:
    image = drawn(tmp_path, content)
    assert max(image.size) == MOST_SIDE_PX
    assert image.width / image.height == pytest.approx(4 / 3, rel=1e-3)
    pixels = np.asarray(image.convert("L"))

    def at(x: float, y: float) -> int:
        return int(pixels[round(y * image.height), round(x * image.width)])

    assert (at(0.5, 0.3), at(0.1, 0.5), at(0.9, 0.5)) == (0, 0, 0)
    assert (at(0.3, 0.3), at(0.5, 0.7), at(0.02, 0.02)) == (255, 255, 255)


@pytest.mark.parametrize(("content", "ending"), [(SVG.encode(), "svg"), (pdf(), "pdf")])
def test_the_command_reads_them_as_it_reads_an_image(
    tmp_path: Path, content: bytes, ending: str
) -> None:
    (tmp_path / f"plan.{ending}").write_bytes(content)
    ground = read_plan_image(tmp_path / f"plan.{ending}", 40.0)
    asked = np.array([[10.0, 15.0], [30.0, 15.0], [20.0, 20.0], [20.0, 5.0], [1.0, 1.0]])
    npt.assert_array_equal(ground.holds(asked), [1, 1, 0, 1, 0])


def test_shapes_are_drawn_to_scale(tmp_path: Path) -> None:
    ring = [[0, 0], [20, 0], [20, 10], [0, 10], [0, 0]]
    table = [[2, 2], [4, 2], [4, 4], [2, 4], [2, 2]]
    shapes = [
        {
            "type": "Feature",
            "geometry": {"type": "Polygon", "coordinates": [ring]},
            "properties": {},
        },
        {
            "type": "Feature",
            "geometry": {"type": "Polygon", "coordinates": [table]},
            "properties": {"accessible": False},
        },
        {"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[10, 0], [10, 6]]}},
    ]
    (tmp_path / "plan").write_text(json.dumps({"features": shapes}))
    picture = drawn_picture(tmp_path / "plan")
    image = Image.open(io.BytesIO(picture.content))
    assert picture.width_m == pytest.approx(20.2, abs=0.02)
    pixels, px_per_m = np.asarray(image), image.width / float(picture.width_m or 0)

    def at(x_m: float, y_m: float) -> int:
        return int(
            pixels[image.height - 1 - round((y_m + 0.1) * px_per_m), round((x_m + 0.1) * px_per_m)]
        )

    assert (at(0, 5), at(10, 3), at(20, 9)) == (0, 0, 0)
    assert (at(5, 5), at(10, 8)) == (255, 255)
    assert 100 < at(3, 3) < 240


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"\x89PNG\r\n", PlanKind.PNG),
        (b"\xff\xd8\xff\xe0", PlanKind.JPEG),
        (b"\n%PDF-1.7", PlanKind.PDF),
        (b"\xef\xbb\xbf<?xml version='1.0'?><svg/>", PlanKind.SVG),
        (b' {"type": "FeatureCollection"}', PlanKind.GEOJSON),
        (b"GIF89a", None),
        (b"", None),
    ],
)
def test_a_plan_is_known_by_its_content(content: bytes, kind: PlanKind | None) -> None:
    assert kind_of(content) is kind


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"%PDF-1.4\nnothing", "cannot be read as a PDF"),
        (pdf()[:200], "cannot be read as a PDF"),
        (b"<svg", "cannot be read as SVG"),
        (b"{}", "no Polygon"),
        (b"GIF89a", "is no PDF, SVG or GeoJSON"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(
    tmp_path: Path, content: bytes, words: str
) -> None:
    with pytest.raises(InputError, match=words) as refused:
        drawn(tmp_path, content)
    assert str(refused.value).startswith(str(tmp_path / "plan"))
    assert "\n" not in str(refused.value)
