"""Plan views: walks, closures, maps, fixes and worlds, drawn from above in metres."""

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64, I64, Bool, Value, array
from elfslam.base.values import Closures, Fixes, FixStatus, FloorMap

SLAM = "#0f8b8d"
DEAD_RECKONING = "#e07a3f"
TRUTH = "#7d8590"
CLOSURE = "#8b6fd6"
RIGHT = "#2f9e5b"
WRONG = "#d1344b"
METHODS = {"dead reckoning": DEAD_RECKONING, "SLAM": SLAM}
STATUSES = {
    FixStatus.OK: (RIGHT, "circle"),
    FixStatus.AMBIGUOUS: (DEAD_RECKONING, "diamond"),
    FixStatus.UNKNOWN_PLACE: (WRONG, "x"),
    FixStatus.NO_ECHO: (TRUTH, "x-thin"),
    FixStatus.SUSPECT: (CLOSURE, "square"),
}
WALKS = [SLAM, DEAD_RECKONING, CLOSURE, RIGHT, "#4a7fd1", "#c2569b", "#a58a2c", TRUTH]

GRID = "rgba(127,127,127,0.18)"
LINES_AT_MOST = 3000
LIFT = 0.9
DEPTH = 0.3, 0.35
SINGLE_M = 8192.0
"""Nearer to the origin than this, single precision holds a millimetre."""
ELLIPSES_AT_MOST = 40
ELLIPSE_CORNERS = 25
REJECTED = "rejected"
"""Closures that the back end did not believe: drawn when their name in the legend is tapped."""
WEIGHT_BINS = ((0.0, 0.25, REJECTED), (0.25, 0.75, "doubted"), (0.75, np.inf, "trusted"))
WEIGHT_STRENGTH = {REJECTED: 0.35, "doubted": 0.6, "trusted": 0.9}


@dataclass(frozen=True, eq=False)
class FloorPlan(Value):
    """A room from above: outline (k, 2), obstacles and further rooms, each (k, 2), in metres."""

    outline: F64 = array("k", 2)
    obstacles: tuple[F64, ...] = ()
    rooms: tuple[F64, ...] = ()


def styled(figure: go.Figure, *, height_px: int = 360) -> go.Figure:
    """The calm look: no boxes, faint grid, legend above; the page's style sheet sets the ink."""
    axes = {
        "gridcolor": GRID,
        "zeroline": False,
        "showline": False,
        "ticks": "",
        "automargin": True,
    }
    figure.update_layout(
        template="none",
        height=height_px,
        margin={"l": 52, "r": 16, "t": 12, "b": 44},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"family": "system-ui, sans-serif", "size": 12, "color": TRUTH},
        legend={"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        hoverlabel={"font": {"size": 12}},
    )
    figure.update_xaxes(**axes)
    figure.update_yaxes(**axes)
    return figure


def plan(traces: Sequence[go.Scatter], *, height_px: int = 620) -> go.Figure:
    """A view from above with equal axes in metres; its aspect is kept for narrow screens."""
    figure = styled(go.Figure(list(traces)), height_px=height_px)
    spans_m = [np.ptp(_known([trace[axis] for trace in figure.data])) for axis in "xy"]
    figure.update_layout(meta={"aspect": round(float(spans_m[1] / max(spans_m[0], 1e-3)), 3)})
    figure.update_xaxes(title_text="x (m)")
    figure.update_yaxes(title_text="y (m)", scaleanchor="x", scaleratio=1)
    return figure


def _known(columns: Sequence[F64]) -> F64:
    """All finite values of some columns; a nought where there is none."""
    values = np.concatenate([np.zeros(1), *columns]) if not columns else np.concatenate(columns)
    finite = values[np.isfinite(values)]
    return finite if len(finite) else np.zeros(1)


def lifted(xy_m: F64, t_s: F64) -> F64:
    """A walk (n, 2) seen from the side, raised by time: its rounds come to lie above each other.

    An oblique view: depth goes up and to the right, the end stands LIFT widths above the start.
    """
    across, depth = xy_m.T
    width = float(np.max(np.ptp(xy_m, axis=0), initial=0.0))
    height = LIFT * width * (t_s - t_s[0]) / (t_s[-1] - t_s[0])
    return np.column_stack([across + DEPTH[0] * depth, DEPTH[1] * depth + height])


def lifted_plan(traces: Sequence[go.Scatter], *, height_px: int = 620) -> go.Figure:
    """A view of lifted walks: no axes and no common scale, since height is time there."""
    figure = styled(go.Figure(list(traces)), height_px=height_px)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    return figure


def floor_traces(floor_plan: FloorPlan | None) -> list[go.Scatter]:
    """The outline and the obstacles, as a quiet ground for what lies on it."""
    if floor_plan is None:
        return []
    obstacles = [_area(ring, "rgba(127,127,127,0.25)", 1) for ring in floor_plan.obstacles]
    rooms = (floor_plan.outline, *floor_plan.rooms)
    return [*(_area(ring, "rgba(127,127,127,0.05)", 2) for ring in rooms), *obstacles]


def walk_traces(
    xy_m: F64, name: str, color: str, *, dash: str = "solid", width: float = 2, opacity: float = 1
) -> list[go.Scatter]:
    """A walk with its start (open circle) and end (square) marked."""
    line = {"color": color, "width": width, "dash": dash}
    path = _scatter(xy_m, name=name, mode="lines", line=line, opacity=opacity, legendgroup=name)
    symbols = ["circle-open", "square"]
    marker = {"color": color, "size": 10, "symbol": symbols, "line": {"width": 2, "color": color}}
    ends = _scatter(
        xy_m[[0, -1]],
        name=name,
        mode="markers",
        marker=marker,
        legendgroup=name,
        showlegend=False,
        text=["start", "end"],
        hovertemplate=f"{name}: %{{text}}<extra></extra>",
    )
    return [path, ends]


def level_traces(xy_m: F64, level: F64) -> list[go.Scatter]:
    """A walk over several floors (n), in a colour for each level and grey between them."""
    between_floors = np.isnan(level)
    colors = {f"level {each:g}": level == each for each in np.unique(level[~between_floors])}
    parts = {"between floors": between_floors, **colors}
    shown = zip(parts.items(), [TRUTH, *WALKS[:-1] * len(parts)], strict=False)
    return [
        _scatter(
            np.where(there[:, None], xy_m, np.nan),
            name=name, mode="lines", line={"color": color, "width": 2}, legendgroup=name,
        )
        for (name, there), color in shown
    ]  # fmt: skip


def ellipse_trace(xy_m: F64, covariance_m2: F64, color: str) -> go.Scatter:
    """1-sigma ellipses (39 % in the plane), every few steps, as one light line.

    Positions are (n, 2); covariances (n, 2, 2) lie in the axes of the positions.
    """
    rows = thinned(xy_m.shape[0], ELLIPSES_AT_MOST)
    angle = np.linspace(0, 2 * np.pi, ELLIPSE_CORNERS)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    values, vectors = np.linalg.eigh(covariance_m2[rows])
    shape = vectors * np.sqrt(np.maximum(values, 0))[:, None, :]
    rings = xy_m[rows, None, :] + np.einsum("nij,jk->nki", shape, circle)
    line = {"color": color, "width": 1}
    name = "1-sigma"
    return _scatter(_broken(rings), name=name, mode="lines", line=line, opacity=0.5, skip=True)


def closure_traces(xy_m: F64, closures: Closures, weights: F64) -> list[go.Scatter]:
    """Closures as thin lines, stronger where the back end trusted them more."""
    known = weights if weights.size == closures.i.size else np.ones(closures.i.size)
    traces = []
    for low, high, word in WEIGHT_BINS:
        chosen = (known >= low) & (known < high)
        if chosen.any():
            name = f"closures, {word} ({int(chosen.sum())})"
            strength = WEIGHT_STRENGTH[word]
            trace = _links(xy_m, closures, chosen, name, CLOSURE, strength)
            traces.append(trace.update(mode="lines+markers", marker={"size": 3, "color": CLOSURE}))
    return traces


def judged_closure_traces(
    xy_m: F64, closures: Closures, right: Bool, known: Bool, kept: Bool
) -> list[go.Scatter]:
    """Closures coloured right or wrong; faint where the back end rejected them.

    Those that the truth cannot judge are left out.
    """
    kinds = [
        (REJECTED, TRUTH, known & ~kept, 0.25),
        ("right", RIGHT, known & kept & right, 0.6),
        ("wrong", WRONG, known & kept & ~right, 0.9),
    ]
    return [
        _links(xy_m, closures, chosen, f"closures, {word} ({int(chosen.sum())})", color, opacity)
        for word, color, chosen, opacity in kinds
        if chosen.any()
    ]


def map_traces(floor_map: FloorMap, *, faint: bool = False) -> list[go.Scatter]:
    """The spots of a map, in the order of each walk."""
    traces = []
    walks = np.unique(floor_map.walk)
    for index, walk in enumerate(walks):
        rows = np.flatnonzero(floor_map.walk == walk)
        xy_m = floor_map.xy_m[rows[np.argsort(floor_map.order[rows], kind="stable")]]
        color = TRUTH if faint else WALKS[index % len(WALKS)]
        names = floor_map.sources if len(walks) > 1 else ("map",)
        name = html.escape(names[index]) if index < len(names) else f"walk {walk + 1}"
        trace = _scatter(xy_m, name=name, mode="lines+markers", opacity=0.5 if faint else 0.9)
        trace.update(marker={"color": color, "size": 5}, line={"color": color, "width": 1})
        traces.append(trace)
    return traces


def fix_traces(fixes: Fixes) -> list[go.Scatter]:
    """Fixes by status; one without a position cannot be drawn and is counted in the table."""
    drawn = np.isfinite(fixes.xy_m).all(axis=1)
    traces = []
    for status, (color, symbol) in STATUSES.items():
        rows = drawn & (fixes.status == status)
        if rows.any():
            marker = {"color": color, "size": 8, "symbol": symbol}
            times = [f"{t:.1f} s" for t in fixes.t_s[rows]]
            name = status.name.replace("_", " ").lower()
            trace = _scatter(fixes.xy_m[rows], name=name, mode="markers", marker=marker)
            trace.update(text=times, hovertemplate="%{text}, %{x:.2f}, %{y:.2f}<extra></extra>")
            traces.append(trace)
    return traces


def error_trace(from_xy_m: F64, to_xy_m: F64, color: str) -> go.Scatter:
    """A line from each position (n, 2) to where it should be (n, 2)."""
    pairs = np.stack([from_xy_m, to_xy_m], axis=1)
    return _scatter(
        _broken(pairs[thinned(len(pairs), LINES_AT_MOST)]),
        name="error",
        mode="lines",
        line={"color": color, "width": 1},
        opacity=0.5,
        skip=True,
    )


def thinned(count: int, at_most: int) -> I64:
    """Evenly spread row numbers, all of them where there are few."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, at_most)).astype(int))


def _links(
    xy_m: F64, closures: Closures, chosen: Bool, name: str, color: str, opacity: float
) -> go.Scatter:
    rows = np.flatnonzero(chosen)
    rows = rows[thinned(rows.size, LINES_AT_MOST)]
    pairs = np.stack([xy_m[closures.i[rows]], xy_m[closures.j[rows]]], axis=1)
    line = {"color": color, "width": 1}
    trace = _scatter(_broken(pairs), name=name, mode="lines", line=line, opacity=opacity, skip=True)
    return trace.update(visible="legendonly" if REJECTED in name else True)


def _area(ring: F64, fill: str, width: int) -> go.Scatter:
    closed = np.vstack([ring, ring[:1]])
    line = {"color": TRUTH, "width": width}
    trace = _scatter(closed, name="floor", mode="lines", line=line, skip=True)
    return trace.update(fill="toself", fillcolor=fill, showlegend=False)


def _broken(lines: F64) -> F64:
    """Lines (n, k, 2) as one polyline; NaN rows lift the pen between them."""
    gap = np.full((lines.shape[0], 1, 2), np.nan)
    return np.concatenate([lines, gap], axis=1).reshape(-1, 2)


def _scatter(xy_m: F64, *, skip: bool = False, **look: object) -> go.Scatter:
    """Coordinates to the millimetre, if they can in single precision: half the bytes of a page."""
    rounded = np.round(np.asarray(xy_m, float), 3)
    near = float(np.nanmax(np.abs(rounded), initial=0.0)) < SINGLE_M
    x, y = rounded.astype(np.float32 if near else np.float64).T
    hover = {"hoverinfo": "skip"} if skip else {}
    return go.Scatter(x=x, y=y, **hover, **look)
