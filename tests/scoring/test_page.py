"""Pages share one drawing script in a folder, or hold it where one file is wanted."""

from __future__ import annotations

import shutil
from pathlib import Path

import plotly.graph_objects as go
import pytest

from elfslam.base.errors import InputError
from elfslam.scoring.figures import plan
from elfslam.scoring.page import SCRIPT, Page, Panel, save_page, script_file, self_contained

PAGE = Page("Walk", "by echoes", [Panel("Line", go.Figure(go.Scatter(x=[0, 1], y=[0, 1])))])
WIDE = [go.Scatter(x=[0, 8], y=[0, 2])]
MOST_BYTES = 500_000


def test_a_page_links_the_script_that_it_puts_beside_it(tmp_path: Path) -> None:
    save_page(tmp_path / "report.html", PAGE)
    text = (tmp_path / "report.html").read_text()
    assert f'src="{SCRIPT}"' in text
    assert len(text.encode()) < MOST_BYTES
    assert {file.name for file in tmp_path.iterdir()} == {"report.html", SCRIPT}
    assert (tmp_path / SCRIPT).read_bytes() == script_file().read_bytes()


def test_a_script_that_lies_there_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / SCRIPT).write_text("mine")
    save_page(tmp_path / "page.html", PAGE)
    assert (tmp_path / SCRIPT).read_text() == "mine"


def test_one_file_holds_the_script_and_is_the_same_page_otherwise(tmp_path: Path) -> None:
    save_page(tmp_path / "page.html", PAGE)
    script = script_file().read_text(encoding="utf-8")
    text, linked = self_contained(tmp_path / "page.html"), (tmp_path / "page.html").read_text()
    assert "src=" not in text.partition("<script>")[0]
    assert text.replace(f"<script>{script}", f'<script src="{SCRIPT}">') == linked


def test_a_page_without_its_script_or_without_a_link_is_refused(tmp_path: Path) -> None:
    save_page(tmp_path / "page.html", PAGE)
    (tmp_path / SCRIPT).unlink()
    with pytest.raises(InputError, match=f"wanted {SCRIPT} beside it"):
        self_contained(tmp_path / "page.html")
    (tmp_path / "other.html").write_text("<html></html>")
    with pytest.raises(InputError, match="links no drawing script"):
        self_contained(tmp_path / "other.html")


@pytest.mark.real
def test_on_a_phone_the_frame_of_a_plan_is_as_high_as_the_plan(tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is missing: apt-get install chromium")
    save_page(tmp_path / "page.html", Page("Walk", "", [Panel("Above", plan(WIDE))]))
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for width_px, wanted_px in ((1280, 620), (390, 212)):
            page = browser.new_page(viewport={"width": width_px, "height": 800})
            page.goto((tmp_path / "page.html").as_uri())
            plot = page.locator(".js-plotly-plot")
            playwright.expect(plot.locator(".main-svg").first).to_be_visible()
            for each in (plot, plot.locator("xpath=..")):
                assert each.bounding_box()["height"] == pytest.approx(wanted_px, abs=2)
        browser.close()
