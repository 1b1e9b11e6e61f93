"""A world of the simulator as the plain values that its page draws."""

from __future__ import annotations

import numpy as np

from elfslam.scoring.world_page import DrawnBlock, WorldPlan
from elfslam.world.doors import blocks_of
from elfslam.world.room import Block, Room
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
