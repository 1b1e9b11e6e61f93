"""What `elfslam show` draws, as one file: a run, a map, a world or a page that was saved."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from elfslam.data.atomic_files import new_file, settled
from elfslam.data.map_files import FACTS, MAP, read_facts, read_map
from elfslam.data.runs import read_run
from elfslam.scoring.page import script_file, self_contained
from elfslam.scoring.report import write_map_page, write_report
from elfslam.scoring.world_page import DrawnBlock, WorldPlan, write_world_page
from elfslam.world.doors import blocks_of
from elfslam.world.room import Block, Room
from elfslam.world.simulate import load_world
from elfslam.world.world_file import World


def world_plan(world: World) -> WorldPlan:
    """Everything of a world that can be drawn; its doors stand open."""
    room, around = world.room, world.surroundings
    points = around.access_points if around else ()
    lines = around.power_lines if around else ()
    leaves = [block for door in world.doors for block in blocks_of(door, room, is_open=True)]
    return WorldPlan(
        world.name,
        room.height_m,
        tuple(wall.name for wall in room.walls),
        room.floor.name,
        room.ceiling.name,
        room.outline_m,
        tuple(map(_drawn, (*room.blocks, *leaves))),
        world.route_m,
        world.spots_m,
        world.people.routes_m,
        {point.bssid: point.position_m for point in points},
        {line.name: np.stack([line.from_m, line.to_m]) for line in lines},
        {name: _changed(room, state) for name, state in world.states.items()},
    )


def _drawn(block: Block) -> DrawnBlock:
    return DrawnBlock(block.name, block.surface.name, block.corners_m, block.base_m, block.top_m)


def _changed(room: Room, state: Room) -> tuple[DrawnBlock, ...]:
    """Pieces that stand elsewhere; those that are gone have no height."""
    after = {block.name: block for block in state.blocks}
    changed = [block for block in state.blocks if not any(block is one for one in room.blocks)]
    gone = [block for block in room.blocks if block.name not in after]
    flat = [DrawnBlock(b.name, b.surface.name, b.corners_m, b.base_m, b.base_m) for b in gone]
    return (*map(_drawn, changed), *flat)


__all__ = ["script_file", "show_into"]


def show_into(out: Path, what: str, *, overwrite: bool = False) -> None:
    """Write the page of `what` as one file; an older one is only replaced with `overwrite`.

    Raises InputError where `what` is nothing to be drawn, StoreError.
    """
    with new_file(out, overwrite=overwrite, reads=[what]) as file, TemporaryDirectory() as folder:
        page = Path(what)
        if page.suffix != ".html" or not page.is_file():
            page = Path(folder) / "page.html"
            _page_writer(what)(page)
        file.write_text(self_contained(page), encoding="utf-8")


def _page_writer(what: str) -> Callable[[Path], None]:
    path = settled(Path(what))
    if (path / FACTS).exists():
        return partial(write_report, run=read_run(path), facts=read_facts(path))
    if path.suffix == ".npz" or (path / MAP).exists():
        return partial(write_map_page, floor_map=read_map(path))
    return partial(write_world_page, world=world_plan(load_world(what)))
