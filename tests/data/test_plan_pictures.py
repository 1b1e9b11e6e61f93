"""Plans that are no pictures are drawn as one: where a wall was, it is dark."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from PIL import Image

from elfslam.base.errors import InputError
from elfslam.data.floor_plans import read_plan_image
from elfslam.data.plan_pictures import MOST_SIDE_PX, PlanKind, drawn_picture, kind_of

SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 30">'
    '<rect x="4" y="3" width="32" height="24" fill="none" stroke="black" stroke-width="0.4"/>'
    '<line x1="20" y1="3" x2="20" y2="15" stroke="black" stroke-width="0.4"/></svg>'
)


def pdf(pages: int = 1) -> bytes:
    """A page of 400 by 300 points: the same rooms, drawn by hand."""
    drawing = b"2 w 40 30 320 240 re S 200 270 m 200 150 l S"
    kids = " ".join(f"{3 + 2 * k} 0 R" for k in range(pages))
    bodies = [b"<< /Type /Catalog /Pages 2 0 R >>"]
    bodies.append(f"<< /Type /Pages /Kids [{kids}] /Count {pages} >>".encode())
    for k in range(pages):
        page = f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 400 300] /Contents {4 + 2 * k} 0 R >>"
        bodies.append(page.encode())
        bodies.append(b"<< /Length %d >>\nstream\n%s\nendstream" % (len(drawing), drawing))
    content, places = b"%PDF-1.4\n", []
    for number, body in enumerate(bodies, start=1):
        places.append(len(content))
        content += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    size = len(bodies) + 1
    content += b"xref\n0 %d\n0000000000 65535 f \n%s" % (size, table)
    start = content.rindex(b"xref\n")
    return content + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        size,
        start,
    )


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
