"""Plans that are no pictures are drawn as one: where a wall was, it is dark."""

import io
import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from PIL import Image
from planted_plans import SVG, pdf

from elfslam.base.errors import InputError
from elfslam.data import plan_pictures
from elfslam.data.floor_plans import read_plan_image
from elfslam.data.map_exports import feature
from elfslam.data.plan_pictures import MOST_DEPTH, MOST_LAYERS, MOST_MASKS, PlanKind, clean_svg


def drawn(tmp_path: Path, content: bytes) -> Image.Image:
    (tmp_path / "plan").write_bytes(content)
    return Image.open(io.BytesIO(plan_pictures.drawn_picture(tmp_path / "plan").content))


@pytest.mark.parametrize("content", [SVG.encode(), pdf(), pdf(3)], ids=["SVG", "PDF", "3 pages"])
def test_a_wall_is_dark_where_it_was_drawn(tmp_path: Path, content: bytes) -> None:
    image = drawn(tmp_path, content)
    assert max(image.size) == plan_pictures.MOST_SIDE_PX
    assert image.width / image.height == pytest.approx(4 / 3, rel=1e-3)
    pixels = np.asarray(image.convert("L"))

    def at(x: float, y: float) -> int:
        return int(pixels[round(y * image.height), round(x * image.width)])

    assert (at(0.5, 0.3), at(0.1, 0.5), at(0.9, 0.5)) == (0, 0, 0)
    assert (at(0.3, 0.3), at(0.5, 0.7), at(0.02, 0.02)) == (255, 255, 255)


@pytest.mark.parametrize(("content", "ending"), [(SVG.encode(), "svg"), (pdf(), "pdf")])
def test_the_command_reads_them_as_images(tmp_path: Path, content: bytes, ending: str) -> None:
    (tmp_path / f"plan.{ending}").write_bytes(content)
    ground = read_plan_image(tmp_path / f"plan.{ending}", 40.0)
    asked = np.array([[10.0, 15.0], [30.0, 15.0], [20.0, 20.0], [20.0, 5.0], [1.0, 1.0]])
    npt.assert_array_equal(ground.holds(asked), [1, 1, 0, 1, 0])


def test_shapes_are_drawn_to_scale(tmp_path: Path) -> None:
    ring = [[0, 0], [20, 0], [20, 10], [0, 10], [0, 0]]
    table = [[2, 2], [4, 2], [4, 4], [2, 4], [2, 2]]
    shapes = [
        feature({"type": "Polygon", "coordinates": [ring]}, {}),
        feature({"type": "Polygon", "coordinates": [table]}, {"accessible": False}),
        {"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[10, 0], [10, 6]]}},
    ]
    (tmp_path / "plan").write_text(json.dumps({"features": shapes}))
    picture = plan_pictures.drawn_picture(tmp_path / "plan")
    image = Image.open(io.BytesIO(picture.content))
    assert picture.width_m == pytest.approx(20.2, abs=0.02)
    pixels, px_per_m = np.asarray(image), image.width / float(picture.width_m or 0)

    def at(x_m: float, y_m: float) -> int:
        row = image.height - 1 - round((y_m + 0.1) * px_per_m)
        return int(pixels[row, round((x_m + 0.1) * px_per_m)])

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
    assert plan_pictures.kind_of(content) is kind


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
def test_what_cannot_be_drawn_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        drawn(tmp_path, content)
    assert str(refused.value).startswith(str(tmp_path / "plan"))
    assert "\n" not in str(refused.value)


FILE = Path("plan.svg")
HEAD = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


def cleaned(inside: str, attributes: str = 'viewBox="0 0 40 30"') -> str:
    return clean_svg(f"<svg {HEAD} {attributes}>{inside}</svg>".encode(), FILE)[0]


def test_what_is_drawn_stays() -> None:
    inside = (
        '<defs><linearGradient id="a"><stop offset="0"/></linearGradient></defs>'
        '<g transform="scale(2)" style="fill:url(#a)"><path d="M0 0L1 1"/><text>Room 3</text></g>'
        '<use xlink:href="#b"/><style>.wall { stroke: black }</style>'
    )
    text = cleaned(inside)
    for kept in ("linearGradient", "url(#a)", "M0 0L1 1", "Room 3", 'href="#b"', "stroke: black"):
        assert kept in text


@pytest.mark.parametrize(
    "inside",
    [
        "<script>alert(1)</script>",
        '<g onclick="alert(1)"/>',
        '<image href="file:///etc/passwd" width="9" height="9"/>',
        '<image href="data:image/svg+xml;base64,alert"/>',
        '<use href="http://alert.example/x.svg#a"/>',
        '<a href="javascript:alert(1)"><path d="M0 0"/></a>',
        "<foreignObject><p>alert</p></foreignObject>",
        '<rect style="fill: url(http://alert.example/a.svg#b)"/>',
        "<rect fill=\"url( 'alert.svg#b')\"/>",
        '<style>@import "alert.css";</style>',
        "<style>rect { fill: url(alert.png) }</style>",
        '<animate attributeName="href" to="javascript:alert(1)"/>',
        '<x:script xmlns:x="http://www.w3.org/1999/xhtml">alert(1)</x:script>',
        "<?xml-stylesheet href='alert.css'?>",
        "<metadata>alert</metadata>",
    ],
)
def test_what_runs_or_fetches_goes(inside: str) -> None:
    text = cleaned(f'<g>{inside}</g><rect id="stays"/>')
    assert "alert" not in text.lower()
    assert "passwd" not in text
    assert "stays" in text


@pytest.mark.parametrize(
    ("attributes", "size"),
    [
        ('viewBox="0 0 40 30"', (40, 30)),
        ('viewBox="-5,-5, 40.5,30" width="10" height="900"', (40.5, 30)),
        ('width="40" height="30px"', (40, 30)),
        ('width="1in" height="25.4mm"', (96, 96)),
    ],
)
def test_its_size_is_told(attributes: str, size: tuple[float, float]) -> None:
    told = clean_svg(f"<svg {HEAD} {attributes}/>".encode(), FILE)[1]
    assert told == pytest.approx(size)


def test_what_older_programs_write_is_read() -> None:
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN"'
    dtd = '"http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    whole = f'{head} {dtd}\n<svg {HEAD} viewBox="0 0 4 3"/>'
    assert clean_svg(b"\xef\xbb\xbf" + whole.encode(), FILE)[1] == (4, 3)


BOMB = "<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"<!DOCTYPE svg [{BOMB}]><svg {HEAD} viewBox='0 0 1 1'>&b;</svg>", "defines entities"),
        ("<!DOCTYPE svg SYSTEM 'file:///etc/passwd' []><svg/>", "defines entities"),
        (f"<svg {HEAD}><g></svg>", "cannot be read as SVG"),
        (f"<svg {HEAD}/>", "neither its size nor a viewBox"),
        (f"<svg {HEAD} viewBox='0 0 nan inf'/>", "neither its size"),
        (f"<svg {HEAD} width='100%' height='9'/>", "neither its size"),
        ("<svg viewBox='0 0 1 1'/>", "XML of another kind"),
        ("<html xmlns='http://www.w3.org/1999/xhtml'/>", "XML of another kind"),
        (
            f"<svg {HEAD} viewBox='0 0 1 1'>{'<g>' * MOST_DEPTH}{'</g>' * MOST_DEPTH}</svg>",
            "levels",
        ),
        ("", "cannot be read as SVG"),
    ],
)
def test_what_is_none_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        clean_svg(text.encode(), FILE)
    assert str(refused.value).startswith("plan.svg: ")
    assert "\n" not in str(refused.value)


MASK = '<mask id="m"><rect/></mask>'


def nested(attribute: str, depth: int) -> str:
    return f"<g {attribute}>" * depth + "<rect/>" + "</g>" * depth


@pytest.mark.parametrize(
    ("inside", "words"),
    [
        (MASK + '<g mask="url(#m)"/>' * (MOST_MASKS + 1), "more than 100 masks"),
        (MASK + '<g style="fill:red;mask: url(#m)"/>' * (MOST_MASKS + 1), "more than 100 masks"),
        (
            f'{MASK}<symbol id="s"><g mask="url(#m)"/></symbol>'
            + '<use href="#s"/>' * (MOST_MASKS + 1),
            "more than 100 masks",
        ),
        (nested('opacity="0.5"', MOST_LAYERS + 1), "20 masked, clipped or translucent"),
        (nested('style="opacity:.5"', MOST_LAYERS + 1), "20 masked, clipped or translucent"),
        (nested('clip-path="url(#c)"', MOST_LAYERS + 1), "20 masked, clipped or translucent"),
        (
            "".join(
                f'<mask id="m{k}"><g mask="url(#m{k + 1})"/></mask>' for k in range(MOST_LAYERS)
            )
            + '<g mask="url(#m0)"/>',
            "20 masked, clipped or translucent",
        ),
        ('<g id="a"><use href="#a"/></g>', "name each other in more than 100 levels"),
        ('<mask id="a"><g mask="url(#a)"/></mask><g mask="url(#a)"/>', "each other"),
    ],
)
def test_what_costs_more_than_it_shows_is_refused(inside: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        cleaned(inside)


@pytest.mark.parametrize(
    "inside",
    [
        MASK + '<g mask="url(#m)"/>' * MOST_MASKS,
        f'<defs>{MASK}<g id="unused">' + '<g mask="url(#m)"/>' * (MOST_MASKS + 1) + "</g></defs>",
        nested('opacity="0.5"', MOST_LAYERS),
        nested('opacity="1.0" style="opacity:1;fill-opacity:0.5"', 2 * MOST_LAYERS),
        '<g opacity="0.9"/>' * 1000,
        '<use href="#nowhere"/><g mask="none" clip-path="url(#nowhere)"/>',
    ],
)
def test_what_an_honest_drawing_has_stays(inside: str) -> None:
    assert cleaned(inside).count("<g") == inside.count("<g")


def test_another_encoding_is_refused() -> None:
    with pytest.raises(InputError, match="UTF-8"):
        clean_svg(f"<svg {HEAD} viewBox='0 0 1 1'/>".encode("utf-16"), FILE)
