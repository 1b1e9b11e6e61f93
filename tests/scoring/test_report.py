"""Reports: self-contained, escaped, without truth unless given, whole or not at all."""

import dataclasses
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import numpy.testing as npt
import plotly.graph_objects as go
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Closures, Fixes, FloorMap, Payload, Run, Trajectory, Truth
from elfslam.scoring import merged_report, page
from elfslam.scoring.figures import FloorPlan, plan
from elfslam.scoring.page import SCRIPT, Page, Panel, save_page, script_file, self_contained
from elfslam.scoring.report import write_fix_report, write_map_page, write_report
from elfslam.stages.floormap import MapQuality

CLOSURE = {"threshold": 0.4321, "why": "a & b"}
FACTS = {"device": "<script>alert(1)</script>", "parameters": {"closure": CLOSURE}}
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


def test_a_report_fetches_what_lies_beside_it_and_escapes_names(tmp_path: Path, run: Run) -> None:
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
    deaf = dataclasses.replace(run, echoes=None, features=None, seconds={})
    bare = dataclasses.replace(deaf, closures=empty, trajectory=alone)
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


QUALITY = MapQuality(
    xy_m=[[0.5, 0.5], [1.5, 0.5], [0.5, 2.5]],
    walks=[1, 2, 3],
    spots=[3, 4, 5],
    weight=[1.0, 0.9, 0.5],
    sigma_m=[0.1, 0.2, 0.9],
    error_m=[np.nan, 0.25, 7.0],
    changed=[False, True, False],
)


def test_squares_lie_where_they_are_and_others_stay_open() -> None:
    heat = merged_report.walks_tiles(QUALITY).data[0]
    npt.assert_array_equal(heat.x, [0.5, 1.5])
    npt.assert_array_equal(heat.y, [0.5, 2.5])
    npt.assert_array_equal(heat.z, [[1, 2], [3, np.nan]])
    assert (heat.zmin, heat.zmax) == (0, 3)


def test_large_errors_are_drawn_as_two_metres() -> None:
    heat = merged_report.error_tiles(QUALITY).data[0]
    npt.assert_array_equal(heat.z, [[np.nan, 0.25], [2.0, np.nan]])
    assert merged_report.sigma_tiles(QUALITY).data[0].zmax == 0.9


def test_what_has_changed_bears_a_cross() -> None:
    crosses = merged_report.weight_tiles(QUALITY).data[1]
    assert (list(crosses.x), list(crosses.y)) == ([1.5], [0.5])


def test_the_page_names_who_stayed_out_and_escapes_it(tmp_path: Path) -> None:
    floor_map = FloorMap(
        xy_m=np.zeros((2, 2)),
        heading_rad=np.zeros(2),
        walk=[0, 1],
        order=[0, 0],
        covariance_m2=np.tile(np.eye(2), (2, 1, 1)),
        payloads=(Payload("elf", "e", np.eye(2)),),
        parameters_digest="",
        sources=("one", "two"),
    )
    pairs = [{"one": "one", "other": "two", "places": 20, "outcome": "merged"}]
    refused = {"<b>three": "with one: nothing sounds alike"}
    merged_report.write_merged_report(tmp_path / "r.html", floor_map, QUALITY, pairs, refused)
    text = (tmp_path / "r.html").read_text()
    assert "&lt;b&gt;three" in text
    assert "<b>three" not in text
    assert "nothing sounds alike" in text


PAGE = Page("Walk", "by echoes", [Panel("Line", go.Figure(go.Scatter(x=[0, 1], y=[0, 1])))])
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
    save_page(
        tmp_path / "page.html",
        Page("Walk", "", [Panel("Above", plan([go.Scatter(x=[0, 8], y=[0, 2])]))]),
    )
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
