"""Every module of the desk page is JavaScript, small, and asks for nothing from elsewhere."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
PAGES = HERE.parents[3] / "src" / "elfslam" / "serve" / "pages"
MODULES = sorted((PAGES / "desk").rglob("*.js"))
MOST_LINES = 250
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="node is missing: install nodejs")
def test_modules_can_be_parsed() -> None:
    found = [
        subprocess.run([str(NODE), "--check", file], capture_output=True, text=True, check=False)
        for file in MODULES
    ]
    assert [each.stderr for each in found if each.returncode] == []


@pytest.mark.skipif(NODE is None, reason="node is missing: install nodejs")
@pytest.mark.parametrize("file", sorted(HERE.parent.glob("*.test.mjs")), ids=lambda file: file.stem)
def test_what_needs_no_page_is_tested_in_node(file: Path) -> None:
    ran = subprocess.run(
        [str(NODE), "--test", str(file)], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout


@pytest.mark.parametrize("file", MODULES, ids=lambda file: file.name)
def test_a_module_is_small_and_says_what_it_is(file: Path) -> None:
    text = file.read_text()
    assert len(text.splitlines()) <= MOST_LINES
    assert text.startswith("// ")


@pytest.mark.parametrize("file", [*MODULES, PAGES / "desk.html", PAGES / "desk.css"])
def test_nothing_is_asked_for_from_elsewhere(file: Path) -> None:
    addresses = set(re.findall(r"https?://[^\s\"'`)]+", file.read_text()))
    assert addresses <= {"http://www.w3.org/2000/svg", "https://…/#token=…", "https://…"}


def test_what_is_vendored_has_its_licence() -> None:
    folders = [folder for folder in (PAGES / "vendor").iterdir() if folder.is_dir()]
    assert {"qrcode-generator", "tus-js-client"} <= {folder.name for folder in folders}
    assert [folder.name for folder in folders if not (folder / "LICENSE").is_file()] == []
