"""The desk page asks for nothing from elsewhere; what of it needs no page is tested in node."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).resolve().parent
PAGES = HERE.parents[3] / "src" / "elfslam" / "serve" / "pages"
MODULES = sorted((PAGES / "desk").rglob("*.js"))


@needs_node
@pytest.mark.parametrize("file", sorted(HERE.parent.glob("*.test.mjs")), ids=lambda file: file.stem)
def test_what_needs_no_page_is_tested_in_node(file: Path) -> None:
    passed_in_node(file)


@pytest.mark.parametrize("file", [*MODULES, PAGES / "desk.html", PAGES / "desk.css"])
def test_nothing_is_asked_for_from_elsewhere(file: Path) -> None:
    addresses = set(re.findall(r"https?://[^\s\"'`)]+", file.read_text()))
    assert addresses <= {"http://www.w3.org/2000/svg", "https://…/#token=…", "https://…"}


def test_what_is_vendored_has_its_licence() -> None:
    folders = [folder for folder in (PAGES / "vendor").iterdir() if folder.is_dir()]
    assert {"qrcode-generator", "tus-js-client"} <= {folder.name for folder in folders}
    assert [folder.name for folder in folders if not (folder / "LICENSE").is_file()] == []
