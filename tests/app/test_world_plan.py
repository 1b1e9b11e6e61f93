"""Worlds as their page draws them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.app.show import world_plan
from elfslam.scoring.world_page import write_world_page
from elfslam.world.world_file import load_world, world_names


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
