"""What is drawn comes as one file, and a refusal makes nothing."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.app.show import script_file, show_into, world_plan
from elfslam.base.errors import ElfslamError
from elfslam.base.values import FloorMap
from elfslam.data.map_files import write_map
from elfslam.scoring.page import Page, save_page, self_contained
from elfslam.scoring.world_page import write_world_page
from elfslam.world.world_file import load_world, world_names


def test_a_world_is_drawn_where_it_is_wanted(tmp_path: Path) -> None:
    show_into(tmp_path / "studio.html", "studio")
    assert (tmp_path / "studio.html").read_text().startswith("<!doctype html>")
    assert [file.name for file in tmp_path.iterdir()] == ["studio.html"]
    assert (tmp_path / "studio.html").stat().st_size > script_file().stat().st_size


def test_a_saved_page_becomes_one_file(tmp_path: Path) -> None:
    saved, alone = tmp_path / "saved.html", tmp_path / "alone.html"
    save_page(saved, Page("Walk", "by echoes", []))
    show_into(alone, str(saved))
    assert alone.read_text() == self_contained(saved)


@pytest.mark.parametrize("what", ["atlantis", "none.npz", "text.npz"])
def test_what_cannot_be_read_is_refused_at_once(what: str, tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no map")
    with pytest.raises(ElfslamError):
        show_into(tmp_path / "new" / "out.html", str(tmp_path / what))
    assert [file.name for file in tmp_path.iterdir()] == ["text.npz"]


@pytest.mark.parametrize("place", ["lap.npz", "anchored/map.npz"])
def test_a_map_is_drawn_from_its_file_or_its_folder(place: str, tmp_path: Path) -> None:
    corners = np.array([[0, 0], [6, 0], [6, 4], [0, 4.0]])
    spread = np.tile(0.01 * np.eye(2), (4, 1, 1))
    lap = FloorMap(corners, np.zeros(4), np.zeros(4), np.arange(4), spread, (), "", ("lap",))
    (tmp_path / place).parent.mkdir(exist_ok=True)
    write_map(lap, tmp_path / place)
    drawn = tmp_path / place if place.startswith("lap") else tmp_path / "anchored"
    show_into(tmp_path / "out.html", str(drawn))
    assert "lap" in (tmp_path / "out.html").read_text()


@pytest.mark.parametrize("name", world_names())
def test_every_built_in_world_becomes_a_page(name: str, tmp_path: Path) -> None:
    world = load_world(name)
    plan = world_plan(world)
    drawn = [block.name for block in plan.blocks]
    assert drawn[: len(world.room.blocks)] == [block.name for block in world.room.blocks]
    leaves = sum(door.leaves for door in world.doors)
    assert sum(" leaf " in name for name in drawn) == leaves
    assert len(plan.walls) == len(plan.outline_m)
    assert plan.spots_m.shape == world.spots_m.shape
    write_world_page(tmp_path / "world.html", plan)
    assert 10_000 < (tmp_path / "world.html").stat().st_size < 500_000


def test_states_hold_what_they_change_and_nothing_else() -> None:
    plan = world_plan(load_world("mall"))
    assert {block.name for block in plan.states["moved"]} == {
        "coffee kiosk", "phone kiosk", "ice cream kiosk", "planter 1", "information desk",
    }  # fmt: skip
    here = {block.name: block for block in plan.blocks}
    kiosk = next(block for block in plan.states["moved"] if block.name == "coffee kiosk")
    np.testing.assert_allclose(kiosk.corners_m - here["coffee kiosk"].corners_m, [[3.5, 0.0]] * 4)
    gone = {block.name for block in plan.states["sale"] if block.top_m == block.base_m}
    assert gone == {"photo booth", "east bench"}
