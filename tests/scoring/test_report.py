"""Reports: self-contained, escaped, without truth unless given, whole or not at all."""

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import (
    Closures,
    Fixes,
    FloorMap,
    Payload,
    Run,
    Trajectory,
    Truth,
)
from elfslam.scoring import page
from elfslam.scoring.figures import FloorPlan
from elfslam.scoring.report import write_fix_report, write_map_page, write_report

FACTS = {
    "device": "<script>alert(1)</script>",
    "parameters": {"closure": {"threshold": 0.4321, "why": "a & b"}},
}
SIZE_AT_MOST = 10_000_000


class Outline(HTMLParser):
    """Collects the tags, what they refer to, and the text outside scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.references: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] not in ("script", "style"):
            self.text += data


def outline(path: Path) -> Outline:
    parser = Outline()
    parser.feed(path.read_text())
    return parser


def figures_of(path: Path) -> str:
    """The calls that draw, without the plotting script itself."""
    return "".join(re.findall(r"Plotly\.newPlot\(\s*\"figure.*", path.read_text()))


@pytest.fixture
def floor_map(run: Run) -> FloorMap:
    poses, size = run.trajectory.world_from_body, run.trajectory.t_s.size
    return FloorMap(
        xy_m=poses[:, :2],
        heading_rad=poses[:, 2],
        walk=np.arange(size) // 100,
        order=np.arange(size) % 100,
        covariance_m2=run.trajectory.covariance[:, :2, :2],
        payloads=(Payload("elf", "compact-1", np.zeros((size, 4))),),
        parameters_digest="0123abcd",
        sources=("<i>Monday</i>",),
    )


@pytest.fixture
def fixes(truth: Truth) -> Fixes:
    status = np.arange(20) % 4
    xy_m = np.where((status < 2)[:, None], truth.world_from_body[:20, :2], np.nan)
    unknown = np.full(20, np.nan)
    return Fixes(truth.t_s[:20], xy_m, unknown, np.full((20, 2, 2), np.nan), unknown, status)


def test_a_report_fetches_what_lies_beside_it_alone_and_escapes_names(
    tmp_path: Path, run: Run
) -> None:
    write_report(tmp_path / "report.html", run, facts=FACTS)
    seen = outline(tmp_path / "report.html")
    assert seen.references == [page.SCRIPT]
    assert "b" not in seen.tags[: seen.tags.index("div")]
    assert "living room <b>round</b>" in seen.text
    assert "<script>alert(1)</script>" in seen.text
    assert "a & b" in seen.text
    assert "details" in seen.tags
    assert (tmp_path / "report.html").stat().st_size < SIZE_AT_MOST


def test_a_report_has_the_evidence(tmp_path: Path, run: Run) -> None:
    write_report(tmp_path / "report.html", run, facts=FACTS)
    drawn, text = figures_of(tmp_path / "report.html"), outline(tmp_path / "report.html").text
    for part in ("dead reckoning", "SLAM", "1-sigma", "closures, trusted", "threshold 0.4321"):
        assert part in drawn
    for part in ("Similarity of footsteps", "Seconds per stage", "compact-1", "1 (1.2 s)", "OK"):
        assert part in text
    assert "The walk through time" in text
    assert drawn.count('"name":"closures, trusted') == 2


def test_no_truth_no_trace_of_it(tmp_path: Path, run: Run, truth: Truth) -> None:
    path = tmp_path / "report.html"
    write_report(path, run, facts=FACTS)
    drawn = figures_of(path) + outline(path).text
    assert "truth" not in drawn.lower()
    assert "error" not in drawn.lower()
    write_report(path, run, facts=FACTS, truth=truth)
    drawn = figures_of(path) + outline(path).text
    assert '"name":"truth"' in drawn
    assert "closures, right (" in drawn
    assert "closures, rejected (" in drawn
    assert "Errors (m)" in drawn
    assert "aligned with scale" in drawn


def test_a_report_with_waypoints_and_floor_plan(
    tmp_path: Path, run: Run, waypoints: Truth, floor_plan: FloorPlan
) -> None:
    path = tmp_path / "report.html"
    write_report(path, run, facts={}, floor_plan=floor_plan, truth=waypoints)
    assert figures_of(path).count('"name":"floor"') == 3
    assert "NaN" not in figures_of(path)


def test_equal_runs_give_equal_bytes(tmp_path: Path, run: Run) -> None:
    for name in ("a.html", "b.html"):
        write_report(tmp_path / name, run, facts=FACTS)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_a_bare_run_still_gives_a_report(tmp_path: Path, run: Run, truth: Truth) -> None:
    nothing = np.empty(0)
    empty = Closures(nothing, nothing, nothing, np.empty((0, 3)), np.empty((0, 3, 3)))
    walk = run.trajectory
    alone = Trajectory(walk.t_s, walk.world_from_body, walk.covariance, nothing, "NO_CLOSURES")
    bare = dataclasses.replace(
        run, closures=empty, trajectory=alone, echoes=None, features=None, seconds={}
    )
    write_report(tmp_path / "report.html", bare, facts={}, truth=truth)
    seen = outline(tmp_path / "report.html")
    assert "NO_CLOSURES" in seen.text
    assert "details" not in seen.tags


def test_nothing_half_written(tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("the old one")

    def fail(_: page.Page) -> str:
        raise RuntimeError("planted")

    monkeypatch.setattr(page, "rendered", fail)
    with pytest.raises(RuntimeError, match="planted"):
        write_report(path, run, facts=FACTS)
    assert path.read_text() == "the old one"
    assert [item.name for item in tmp_path.iterdir()] == ["report.html"]


def test_fix_report(tmp_path: Path, floor_map: FloorMap, fixes: Fixes, truth: Truth) -> None:
    path = tmp_path / "fixes.html"
    write_fix_report(path, floor_map, fixes)
    assert "truth" not in figures_of(path)
    assert '"name":"ambiguous"' in figures_of(path)
    write_fix_report(path, floor_map, fixes, truth)
    seen = outline(path)
    assert '"name":"truth"' in figures_of(path)
    assert '"name":"error"' in figures_of(path)
    assert "coverage" in seen.text
    assert "UNKNOWN_PLACE 5" in seen.text
    assert seen.references == [page.SCRIPT]


def test_the_page_of_a_map(tmp_path: Path, floor_map: FloorMap) -> None:
    write_map_page(tmp_path / "map.html", floor_map)
    seen = outline(tmp_path / "map.html")
    assert "<i>Monday</i>" in seen.text
    assert "compact-1" in seen.text
    assert '"name":"walk 2"' in figures_of(tmp_path / "map.html")


def test_tables_show_what_is_missing_as_a_dash() -> None:
    table = page.rows_table([{"a": 1.234, "b": None}, {"a": 2, "b": "<"}])
    assert '<td class="number">1.23</td><td class="number">-</td>' in table
    assert "<td>&lt;</td>" in table
    assert page.rows_table([]) == ""
