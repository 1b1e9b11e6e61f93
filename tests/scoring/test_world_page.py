"""The page of a world: everything is drawn where it stands, and nothing else."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.scoring.world_page import DrawnBlock, WorldPlan, write_world_page

ROOM = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]])
TABLE = DrawnBlock("table <1>", "glass", np.array([[2.0, 1], [3, 1], [3, 2], [2, 2]]), 0.0, 0.75)
PILLAR = DrawnBlock("pillar", "concrete", np.array([[4.0, 1], [5, 1], [5, 2], [4, 2]]), 0.0, 2.5)
MOVED = DrawnBlock("table <1>", "glass", TABLE.corners_m + np.array([0.0, 1.5]), 0.0, 0.75)
GONE = DrawnBlock("pillar", "concrete", PILLAR.corners_m, 0.0, 0.0)
FULL = WorldPlan(
    "room <1>",
    2.5,
    ("glass", "brick", "glass", "brick"),
    "carpet",
    "plaster",
    ROOM,
    (TABLE, PILLAR),
    route_m=np.array([[1.0, 0.5], [5.5, 0.5], [5.5, 3.5], [1.0, 3.5]]),
    spots_m=np.array([[1.0, 1.0], [1.0, 2.0]]),
    people_m=(np.array([[0.5, 0.5], [0.5, 3.5]]),),
    access_points={"router": np.array([1.0, 1.0, 2.0]), "neighbour": np.array([-3.0, 1.0, 2.0])},
    power_lines={"sockets": np.array([[0.0, 0.0, 0.3], [6.0, 0.0, 0.3]])},
    states={"moved": (MOVED, GONE)},
)
BARE = WorldPlan("bare", 2.5, ("glass",) * 4, "carpet", "plaster", ROOM)


def text_of(path: Path) -> str:
    """What is read, without scripts and styles."""
    shown = re.sub(r"<(script|style).*?</\1>", "", path.read_text(), flags=re.S)
    return re.sub(r"<[^>]*>", " ", shown)


def figures_of(path: Path) -> list[list[dict[str, Any]]]:
    """The traces of each figure on the page."""
    found = re.findall(r'Plotly\.newPlot\(\s*"figure-\d+",\s*', path.read_text())
    rest, figures = path.read_text(), []
    for call in found:
        rest = rest[rest.index(call) + len(call) :]
        figures.append(json.JSONDecoder().raw_decode(rest)[0])
    return figures


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("world") / "world.html"
    write_world_page(path, FULL)
    return path


def test_the_page_says_what_the_world_has(page: Path) -> None:
    text = text_of(page)
    assert "room &lt;1&gt;" in text
    for fact in ("24 m²", "2.5 m", "15 m", "carpet", "brick", "concrete"):
        assert fact in text, fact
    assert re.search(r"2\s+marked spots", text)
    assert re.search(r"2\s+access points", text)


def test_everything_is_drawn_in_plan(page: Path) -> None:
    plan = {trace.get("name"): trace for trace in figures_of(page)[0]}
    for name in ("glass", "concrete", "wall: glass", "wall: brick", "state: moved", "route",
                 "spots", "other people", "power lines", "access points (1 outside)"):  # fmt: skip
        assert name in plan, name
    assert "rgba(111,177,214,0.25)" in plan["glass"]["fillcolor"], "low pieces are light"
    assert "0.9)" in plan["concrete"]["fillcolor"], "pieces up to the ceiling are strong"
    hovers = [trace["text"] for trace in figures_of(page)[0] if "text" in trace]
    assert any("table <1><br>glass<br>0 to 0.75 m high" in texts for texts in hovers)


def test_arrows_point_along_the_route(page: Path) -> None:
    """East, north, west and south are 90, 0, -90 and 180 degrees clockwise from up."""
    arrows = [t for t in figures_of(page)[0] if t.get("marker", {}).get("symbol") == "arrow"]
    angles = np.array(decoded(arrows[0]["marker"]["angle"]))
    assert (angles % 360).tolist() == [90, 0, 270, 180]


def decoded(values: Any) -> Any:
    """Plotly writes arrays as lists or as base64."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), dtype=values["dtype"])
    return values


def test_boxes_stand_in_space_from_base_to_top(page: Path) -> None:
    meshes = {t["name"]: t for t in figures_of(page)[1] if t["type"] == "mesh3d"}
    assert set(meshes) == {"glass", "concrete"}
    heights = np.array(decoded(meshes["glass"]["z"]), dtype=float)
    assert sorted(set(heights.tolist())) == [0.0, 0.75]
    assert len(decoded(meshes["concrete"]["i"])) == 12
    corners = np.column_stack([decoded(meshes["concrete"][axis]) for axis in "xyz"])
    triangles = corners[np.column_stack([decoded(meshes["concrete"][k]) for k in "ijk"])]
    edges = triangles[:, 1:] - triangles[:, :1]
    area_m2 = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
    assert area_m2 == pytest.approx(2 * 1 + 4 * 2.5), "a closed box of 1 x 1 x 2.5 m"


def test_a_bare_room_can_be_drawn(tmp_path: Path) -> None:
    write_world_page(tmp_path / "bare.html", BARE)
    names = {trace.get("name") for trace in figures_of(tmp_path / "bare.html")[0]}
    assert "wall: glass" in names
    assert not names & {"route", "spots", "other people", "power lines", "access points"}
    assert "marked spots" not in text_of(tmp_path / "bare.html")


def test_equal_worlds_give_equal_pages(tmp_path: Path, page: Path) -> None:
    write_world_page(tmp_path / "again.html", FULL)
    assert (tmp_path / "again.html").read_bytes() == page.read_bytes()
