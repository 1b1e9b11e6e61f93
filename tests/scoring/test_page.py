"""Pages share one drawing script in a folder, or hold it."""

from __future__ import annotations

from pathlib import Path

import plotly.graph_objects as go

from elfslam.scoring.page import (
    SCRIPT,
    SCRIPT_TAG,
    Page,
    Panel,
    embed_script,
    save_page,
    script_file,
    share_script,
)

PAGE = Page("Walk", "by echoes", [Panel("Line", go.Figure(go.Scatter(x=[0, 1], y=[0, 1])))])
MOST_BYTES = 500_000


def test_a_page_is_small_and_finds_its_script_beside_it(tmp_path: Path) -> None:
    save_page(tmp_path / "report.html", PAGE)
    text = (tmp_path / "report.html").read_text()
    assert SCRIPT_TAG in text
    assert len(text.encode()) < MOST_BYTES
    assert {file.name for file in tmp_path.iterdir()} == {"report.html", SCRIPT}
    assert (tmp_path / SCRIPT).read_bytes() == script_file().read_bytes()


def test_pages_of_a_folder_share_one_script(tmp_path: Path) -> None:
    save_page(tmp_path / "one.html", PAGE)
    (tmp_path / SCRIPT).write_text("as it was")
    save_page(tmp_path / "two.html", PAGE)
    assert (tmp_path / SCRIPT).read_text() == "as it was"


def test_what_a_kill_left_of_the_script_is_finished(tmp_path: Path) -> None:
    (tmp_path / f".{SCRIPT}.partial").write_text("half of it")
    share_script(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [SCRIPT]
    assert (tmp_path / SCRIPT).read_bytes() == script_file().read_bytes()


def test_a_page_of_one_file_needs_nothing_beside_it(tmp_path: Path) -> None:
    save_page(tmp_path / "report.html", PAGE)
    small = (tmp_path / "report.html").stat().st_size
    embed_script(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert SCRIPT_TAG not in text
    assert len(text) > small + script_file().stat().st_size * 0.9
