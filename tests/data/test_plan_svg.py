"""What of an SVG stays, what goes, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.data.plan_pictures import MOST_DEPTH, MOST_LAYERS, MOST_MASKS, clean_svg

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
        '<g ONLOAD="alert(1)"/>',
        '<image href="file:///etc/passwd" width="9" height="9"/>',
        '<image xlink:href="http://alert.example/x.png"/>',
        '<image href="data:image/svg+xml;base64,alert"/>',
        '<use href="http://alert.example/x.svg#a"/>',
        '<use xlink:href="other.svg#alert"/>',
        '<a href="javascript:alert(1)"><path d="M0 0"/></a>',
        "<foreignObject><p>alert</p></foreignObject>",
        '<rect style="fill: url(http://alert.example/a.svg#b)"/>',
        "<rect fill=\"url( 'alert.svg#b')\"/>",
        '<style>@import "alert.css";</style>',
        "<style>rect { fill: url(alert.png) }</style>",
        '<animate attributeName="href" to="javascript:alert(1)"/>',
        '<set attributeName="href" to="alert"/>',
        '<x:script xmlns:x="http://www.w3.org/1999/xhtml">alert(1)</x:script>',
        "<!-- alert -->",
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
        (f"<svg {HEAD} viewBox='0 0 0 9'/>", "neither its size"),
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
def test_what_is_none_is_refused_in_one_line(text: str, words: str) -> None:
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
    cleaned(inside)


def test_another_encoding_is_refused() -> None:
    with pytest.raises(InputError, match="UTF-8"):
        clean_svg(f"<svg {HEAD} viewBox='0 0 1 1'/>".encode("utf-16"), FILE)
