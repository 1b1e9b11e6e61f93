"""What pages and Python share stands in both; what of the pages needs no browser runs in node."""

import re
from importlib import resources
from pathlib import Path

import pytest

from elfslam.base.values import FixStatus
from elfslam.scoring.figures import STATUSES
from tests.in_node import needs_node, passed_in_node
from tests.serve.pages.constants import FILE, constants

HERE, PAGES = Path(__file__).parent, FILE.parents[1]
SHARED = ("44100", "2352", "485", "17500", "6300")
"""Numbers that mean the same wherever they stand, alone in an expression."""


def test_the_constants_of_the_pages_are_those_of_python() -> None:
    assert FILE.read_text(encoding="utf-8") == constants()


def test_no_number_of_theirs_stands_twice() -> None:
    found = [
        (file.relative_to(PAGES).as_posix(), number)
        for file in PAGES.rglob("*.js")
        if file != FILE and "vendor" not in file.parts
        for number in re.findall(r"\b\d+\b", code_of(file.read_text(encoding="utf-8")))
        if number in SHARED
    ]
    assert found == []


def code_of(text: str) -> str:
    """A module without comments and strings, its numbers without separators."""
    bare = re.sub(
        r"/\*.*?\*/|//[^\n]*|`(?:\\.|[^`\\])*`|\"(?:\\.|[^\"\\\n])*\"", "", text, flags=re.S
    )
    return re.sub(r"(?<=\d)_(?=\d)", "", bare)


VIEWER = resources.files("elfslam").joinpath("serve/pages/desk/viewer")


@pytest.mark.parametrize("status", FixStatus)
def test_a_status_is_known_to_the_pages(status: FixStatus) -> None:
    assert f'  {status.name}: t("' in VIEWER.joinpath("scene.js").read_text(encoding="utf-8")
    assert f'{status.name}: colour("' in VIEWER.joinpath("scene.js").read_text(encoding="utf-8")


def test_figures_draw_every_status_otherwise() -> None:
    assert set(STATUSES) == set(FixStatus)
    assert len(set(STATUSES.values())) == len(FixStatus)


@needs_node
@pytest.mark.parametrize("file", sorted(HERE.glob("*.test.mjs")), ids=lambda file: file.stem)
def test_what_needs_no_page_is_tested_in_node(file: Path) -> None:
    passed_in_node(file)


def test_what_is_vendored_has_its_licence() -> None:
    folders = [folder for folder in (PAGES / "vendor").iterdir() if folder.is_dir()]
    assert {"qrcode-generator", "tus-js-client"} <= {folder.name for folder in folders}
    assert [folder.name for folder in folders if not (folder / "LICENSE").is_file()] == []
