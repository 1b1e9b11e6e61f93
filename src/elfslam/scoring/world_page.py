"""The page of a world, drawn to scale from above and in space, with tables of what stands in it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64, Value, array
from elfslam.base.geometry import path_length_m
from elfslam.base.grid import signed_area
from elfslam.scoring.figures import CLOSURE, DEAD_RECKONING, RIGHT, SLAM, TRUTH, WRONG, plan, styled
from elfslam.scoring.page import Page, Panel, rows_table, save_page

PHONE_LOW_M = 1.0
"""What is lower than this is drawn light: a held phone looks over it."""
MARGIN = 0.03
PAGE_WIDTH_PX = 1080
HEIGHTS_PX = (420, 980)
SOFT, HARD, CLEAR = "#b0749a", "#8c9097", "#6fb1d6"
COLORS = {
    "wood": "#b98a54", "parquet": "#b98a54", "book": "#9a6b3f", "door": "#a2703f",
    "glass": CLEAR, "metal": "#64748b", "concrete": HARD, "plaster": "#a9a59c", "brick": "#b4654a",
    "gypsum": "#c3bda9", "painted": "#b5b2a6", "tile": "#a8b3b8", "vinyl": "#a8b3b8",
    "sofa": SOFT, "office chair": SOFT, "fabric": "#7f8fc4", "acoustic": "#7f8fc4",
    "curtain": "#c07f92", "carpet": "#c07f92", "leaves": "#5f9b62", "person": WRONG,
}  # fmt: skip
"""Colour by the first word of a material that is found here."""


@dataclass(frozen=True, eq=False)
class DrawnBlock(Value):
    """A piece of furniture or a partition: its corners in plan, from `base_m` to `top_m`."""

    name: str
    material: str
    corners_m: F64 = array(4, 2)
    base_m: float = 0.0
    top_m: float = 1.0


@dataclass(frozen=True, eq=False)
class WorldPlan(Value):
    """All of a world that is drawn, in metres. `walls` has a material per side of the outline.

    Of `states` only the pieces that stand elsewhere than in `blocks` are meant.
    """

    name: str
    height_m: float
    walls: tuple[str, ...]
    floor: str
    ceiling: str
    outline_m: F64 = array("w", 2)
    blocks: tuple[DrawnBlock, ...] = ()
    route_m: F64 = field(default_factory=lambda: np.zeros((0, 2)))
    spots_m: F64 = field(default_factory=lambda: np.zeros((0, 2)))
    people_m: tuple[F64, ...] = ()
    access_points: Mapping[str, F64] = field(default_factory=dict)
    power_lines: Mapping[str, F64] = field(default_factory=dict)
    states: Mapping[str, tuple[DrawnBlock, ...]] = field(default_factory=dict)


def plan_figure(world: WorldPlan) -> go.Figure:
    """The world from above: what stands in it, and who walks where."""
    extent = np.ptp(world.outline_m, axis=0)
    low = world.outline_m.min(axis=0) - MARGIN * extent.max()
    high = world.outline_m.max(axis=0) + MARGIN * extent.max()
    ratio = float((high - low)[1] / (high - low)[0])
    height_px = int(np.clip(ratio * PAGE_WIDTH_PX + 110, *HEIGHTS_PX))
    traces = [
        _ring(world.outline_m, "rgba(127,127,127,0.06)", "rgba(0,0,0,0)", 0),
        *_block_traces(world),
        *_wall_traces(world),
        *_state_traces(world),
        *_installed_traces(world),
        *_walking_traces(world),
    ]
    figure = plan(traces, height_px=height_px)
    figure.update_xaxes(range=[low[0], high[0]], constrain="domain")
    figure.update_yaxes(range=[low[1], high[1]], constrain="domain")
    return figure.update_layout(legend={"itemsizing": "constant"})


def _block_traces(world: WorldPlan) -> list[go.Scatter]:
    """A filled trace per material and class of height, and a dot to hover over per piece."""
    traces: list[go.Scatter] = []
    for name, blocks in by_material(world.blocks).items():
        classes: dict[float, list[DrawnBlock]] = {}
        for block in blocks:
            classes.setdefault(_strength(block, world.height_m), []).append(block)
        for strength, some in sorted(classes.items()):
            color = _color(name)
            rings = _rings([block.corners_m for block in some])
            trace = _ring(rings, _faded(color, strength), color, 1, name=name, legendgroup=name)
            traces.append(trace.update(showlegend=strength == max(classes)))
    middles = np.array([block.corners_m.mean(axis=0) for block in world.blocks]).reshape(-1, 2)
    texts = [
        f"{block.name}<br>{block.material}<br>{block.base_m:g} to {block.top_m:g} m high"
        for block in world.blocks
    ]
    marker = {"size": 14, "opacity": 0}
    dots = _line(middles, mode="markers", marker=marker, text=texts, showlegend=False)
    return [*traces, dots.update(hovertemplate="%{text}<extra></extra>", hoverinfo=None)]


def _strength(block: DrawnBlock, height_m: float) -> float:
    if block.top_m < PHONE_LOW_M:
        return 0.25
    return 0.9 if block.top_m >= height_m - 0.01 else 0.55


def _wall_traces(world: WorldPlan) -> list[go.Scatter]:
    ends = np.roll(world.outline_m, -1, axis=0)
    traces = []
    for name in dict.fromkeys(world.walls):
        sides = [
            np.stack([a, b])
            for a, b, wall in zip(world.outline_m, ends, world.walls, strict=True)
            if wall == name
        ]
        line = {"color": _color(name), "width": 5}
        traces.append(_line(_gapped(sides), name=f"wall: {name}", mode="lines", line=line))
    return traces


def _state_traces(world: WorldPlan) -> list[go.Scatter]:
    """Pieces where a state puts them; a cross where it takes one away."""
    here = {block.name: block for block in world.blocks}
    traces = []
    for k, (state, blocks) in enumerate(world.states.items()):
        rings = [block.corners_m for block in blocks if block.top_m > block.base_m]
        gone = [here[b.name].corners_m[[0, 2]] for b in blocks if b.top_m <= b.base_m]
        gone += [here[b.name].corners_m[[1, 3]] for b in blocks if b.top_m <= b.base_m]
        loops = [closed(ring) for ring in rings]
        line = {"color": (WRONG, CLOSURE)[k % 2], "width": 1.8, "dash": "dot"}
        trace = _line(_gapped([*loops, *gone]), name=f"state: {state}", mode="lines", line=line)
        traces.append(trace.update(visible=True if k == 0 else "legendonly"))
    return traces


def _installed_traces(world: WorldPlan) -> list[go.Scatter]:
    """Power lines and access points; those beyond the picture are counted."""
    traces = []
    if world.power_lines:
        line = {"color": "#c9a227", "width": 1.5, "dash": "longdashdot"}
        ways = [ends[:, :2] for ends in world.power_lines.values()]
        traces.append(_line(_gapped(ways), name="power lines", mode="lines", line=line))
    if world.access_points:
        xy_m = np.array([place[:2] for place in world.access_points.values()])
        low, high = world.outline_m.min(axis=0), world.outline_m.max(axis=0)
        beyond = int(((xy_m < low) | (xy_m > high)).any(axis=1).sum())
        name = "access points" + (f" ({beyond} outside)" if beyond else "")
        marker = {"color": RIGHT, "size": 11, "symbol": "triangle-up", "line": {"width": 1}}
        trace = _line(xy_m, name=name, mode="markers", marker=marker)
        traces.append(
            trace.update(
                text=list(world.access_points),
                hovertemplate="%{text}<extra></extra>",
                hoverinfo=None,
            )
        )
    return traces


def _walking_traces(world: WorldPlan) -> list[go.Scatter]:
    """Spots, ways of other people, and the route with its direction."""
    traces = []
    if len(world.spots_m):
        marker = {"color": DEAD_RECKONING, "size": 6 if len(world.spots_m) < 500 else 2}
        traces.append(_line(world.spots_m, name="spots", mode="markers", marker=marker))
    if world.people_m:
        line = {"color": TRUTH, "width": 1.5, "dash": "dash"}
        traces.append(_line(_gapped(world.people_m), name="other people", mode="lines", line=line))
    if len(world.route_m):
        traces += _route_traces(world.route_m)
    return traces


def _route_traces(route_m: F64) -> list[go.Scatter]:
    loop = closed(route_m)
    legs = np.diff(loop, axis=0)
    line = {"color": SLAM, "width": 2.5}
    path = _line(loop, name="route", mode="lines", line=line, legendgroup="route")
    start = {"color": SLAM, "size": 12, "symbol": "circle-open", "line": {"width": 3}}
    first = _line(loop[:1], mode="markers", marker=start, legendgroup="route", showlegend=False)
    clockwise_deg = np.degrees(np.arctan2(legs[:, 0], legs[:, 1]))
    arrow = {"color": SLAM, "size": 13, "symbol": "arrow", "angle": clockwise_deg.round(1)}
    middles = loop[:-1] + 0.5 * legs
    arrows = _line(middles, mode="markers", marker=arrow, legendgroup="route", showlegend=False)
    return [path, first, arrows]


def space_figure(world: WorldPlan) -> go.Figure:
    """Boxes in space, one mesh per material, within the edges of the room."""
    meshes = [_mesh(name, blocks) for name, blocks in by_material(world.blocks).items()]
    loop = closed(world.outline_m)
    floor, top = (np.column_stack([loop, np.full(len(loop), z)]) for z in (0.0, world.height_m))
    posts = [np.stack([a, b]) for a, b in zip(floor[:-1], top[:-1], strict=True)]
    edges = [_path(_gapped([floor, top, *posts]), TRUTH, 2, name="room")]
    if len(world.route_m):
        route = closed(world.route_m)
        raised = np.column_stack([route, np.full(len(route), 1.2)])
        edges.append(_path(raised, SLAM, 5, name="route, at the height of the phone"))
    figure = styled(go.Figure([*meshes, *edges]), height_px=620)
    bare = {"visible": False}
    camera = {"eye": {"x": -0.82, "y": -1.4, "z": 1.4}, "projection": {"type": "orthographic"}}
    scene = {"xaxis": bare, "yaxis": bare, "zaxis": bare, "aspectmode": "data", "camera": camera}
    margin = {"l": 0, "r": 0, "t": 0, "b": 0}
    return figure.update_layout(scene=scene, margin=margin, showlegend=False)


_SIDES = ((0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7))
_TRIANGLES = np.array([(4, 5, 6), (4, 6, 7), (0, 2, 1), (0, 3, 2), *_SIDES])
"""Corners 0 to 3 of a box lie below, 4 to 7 above them."""


def _mesh(name: str, blocks: Sequence[DrawnBlock]) -> go.Mesh3d:
    corners = [
        np.column_stack([np.tile(b.corners_m, (2, 1)), np.repeat([b.base_m, b.top_m], 4)])
        for b in blocks
    ]
    x, y, z = np.vstack(corners).round(3).astype(np.float32).T
    triangles = np.vstack([_TRIANGLES + 8 * k for k in range(len(blocks))])
    i, j, k = triangles.astype(np.int32).T
    look = {"flatshading": True, "lighting": {"ambient": 0.65, "diffuse": 0.7}}
    clear = 0.45 if name.startswith("glass") else 1.0
    return go.Mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k, name=name, color=_color(name), opacity=clear,
        hoverinfo="name", **look,
    )  # fmt: skip


def _path(xyz_m: F64, color: str, width: float, *, name: str) -> go.Scatter3d:
    x, y, z = xyz_m.round(3).astype(np.float32).T
    line = {"color": color, "width": width}
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", line=line, name=name, hoverinfo="skip")


def _color(name: str) -> str:
    """The colour of a material by how its name begins; grey for others."""
    return next((color for word, color in COLORS.items() if name.startswith(word)), HARD)


def _faded(color: str, strength: float) -> str:
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{strength:g})"


def closed(ring: F64) -> F64:
    """A ring (n, 2) with its first point again at the end."""
    return np.vstack([ring, ring[:1]])


def _gapped(lines: Sequence[F64]) -> F64:
    """Lines as one, with a gap after each."""
    if not lines:
        return np.zeros((0, 2))
    gap = np.full((1, lines[0].shape[1]), np.nan)
    return np.vstack([np.vstack([line, gap]) for line in lines])


def _rings(rings: Sequence[F64]) -> F64:
    return _gapped([closed(ring) for ring in rings])


def _ring(xy_m: F64, fill: str, color: str, width: float, **look: object) -> go.Scatter:
    line = {"color": color, "width": width}
    trace = _line(xy_m, mode="lines", line=line, fill="toself", fillcolor=fill, **look)
    return trace if "name" in look else trace.update(showlegend=False)


def _line(xy_m: F64, **look: object) -> go.Scatter:
    x, y = np.asarray(xy_m, float).round(3).astype(np.float32).T
    return go.Scatter(x=x, y=y, hoverinfo="skip", **look)


def by_material(blocks: Sequence[DrawnBlock]) -> dict[str, list[DrawnBlock]]:
    """Blocks of each material, in the order they come."""
    groups: dict[str, list[DrawnBlock]] = {}
    for block in blocks:
        groups.setdefault(block.material, []).append(block)
    return groups


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
    tiles = {
        "floor": f"{abs(signed_area(world.outline_m)):.0f} m²",
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
