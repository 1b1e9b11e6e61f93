"""Pages share one drawing script in a folder, or hold it."""

from __future__ import annotations

from pathlib import Path

import plotly.graph_objects as go

from elfslam.scoring.page import (
    SCRIPT,
    Page,
    Panel,
    save_page,
    script_file,
    share_script,
)

PAGE = Page("Walk", "by echoes", [Panel("Line", go.Figure(go.Scatter(x=[0, 1], y=[0, 1])))])
MOST_BYTES = 500_000


def test_a_page_links_the_script_that_lies_beside_it(tmp_path: Path) -> None:
    share_script(tmp_path)
    save_page(tmp_path / "report.html", PAGE)
    text = (tmp_path / "report.html").read_text()
    assert f'src="{SCRIPT}"' in text
    assert len(text.encode()) < MOST_BYTES
    assert {file.name for file in tmp_path.iterdir()} == {"report.html", SCRIPT}
    assert (tmp_path / SCRIPT).read_bytes() == script_file().read_bytes()


def test_elsewhere_a_page_is_one_file(tmp_path: Path) -> None:
    save_page(tmp_path / "page.html", PAGE)
    assert [file.name for file in tmp_path.iterdir()] == ["page.html"]
    text = (tmp_path / "page.html").read_text()
    assert "src=" not in text.partition("<script>")[0]
    assert len(text) > script_file().stat().st_size * 0.9
