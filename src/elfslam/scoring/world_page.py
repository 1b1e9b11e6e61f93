"""The page of a world: drawn from above and in space, with its surfaces and furniture in tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.geometry import path_length_m
from elfslam.scoring.page import Page, Panel, rows_table, save_page
from elfslam.scoring.world_figures import WorldPlan, by_material, closed, plan_figure, space_figure


def write_world_page(path: Path, world: WorldPlan) -> None:
    """Write the page of a world whole or not at all."""
    panels = [
        Panel("From above", plan_figure(world), PLAN_NOTE, wide=True),
        Panel("In space", space_figure(world), SPACE_NOTE, wide=True),
        Panel("Walls, floor and ceiling", rows_table(_surface_rows(world))),
        Panel("Furniture and partitions", rows_table(_block_rows(world))),
    ]
    save_page(path, Page(world.name, "a world to walk in", panels, tiles=_tiles(world)))


PLAN_NOTE = (
    "To scale. Colour: material; light: lower than 1 m; strong: up to the ceiling. Arrows: the way "
    "of the route from the circle on. Tap a name above to hide or show it: dotted outlines are "
    "where a state of the furniture moves its pieces, or crosses them out."
)
SPACE_NOTE = "Colours as above; drag to turn, scroll to come nearer. The ceiling is left out."


def _tiles(world: WorldPlan) -> dict[str, str]:
    outline = world.outline_m
    following = np.roll(outline, -1, axis=0)
    area_m2 = 0.5 * float(
        np.abs((outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]).sum())
    )
    tiles = {
        "floor": f"{area_m2:.0f} m²",
        "to the ceiling": f"{world.height_m:g} m",
        "pieces": str(len(world.blocks)),
    }
    if len(world.route_m):
        tiles["route"] = f"{path_length_m(closed(world.route_m)):.0f} m"
    counts = {
        "marked spots": len(world.spots_m),
        "access points": len(world.access_points),
        "states of the furniture": len(world.states),
    }
    return {**tiles, **{name: str(count) for name, count in counts.items() if count}}


def _surface_rows(world: WorldPlan) -> list[dict[str, object]]:
    ends = np.roll(world.outline_m, -1, axis=0)
    lengths = np.linalg.norm(ends - world.outline_m, axis=1).tolist()
    walls: dict[str, float] = {}
    for name, length in zip(world.walls, lengths, strict=True):
        walls[name] = walls.get(name, 0.0) + length
    rows: list[dict[str, object]] = [
        {"surface": "walls", "material": name, "length (m)": length}
        for name, length in walls.items()
    ]
    for surface, name in (("floor", world.floor), ("ceiling", world.ceiling)):
        rows.append({"surface": surface, "material": name, "length (m)": None})
    return rows


def _block_rows(world: WorldPlan) -> list[dict[str, object]]:
    """Pieces by material; the names of the first few."""
    return [
        {
            "material": name,
            "pieces": len(blocks),
            "tallest (m)": max(block.top_m for block in blocks),
            "such as": blocks[0].name,
        }
        for name, blocks in by_material(world.blocks).items()
    ]
