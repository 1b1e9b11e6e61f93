"""Many walks side by side: where they truly went, and where they were reckoned to go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.base.arrays import F64, Value, array
from elfslam.scoring.figures import DEAD_RECKONING, TRUTH, styled

COLUMNS = 4
TILE_PX = 230
MARGIN = 0.08


@dataclass(frozen=True, eq=False)
class DrawnWalk(Value):
    """A walk to draw: what was reckoned (n, 2), and both at the true positions (k, 2), metres."""

    title: str
    path_m: F64 = array("n", 2)
    true_m: F64 = array("k", 2)
    reckoned_m: F64 = array("k", 2)


def walks_figure(walks: Sequence[DrawnWalk]) -> go.Figure:
    """A tile per walk with equal axes; a thin line joins each true position to the reckoned one."""
    rows = max(1, -(-len(walks) // COLUMNS))
    figure = make_subplots(
        rows=rows,
        cols=COLUMNS,
        subplot_titles=[walk.title for walk in walks],
        horizontal_spacing=0.045,
        vertical_spacing=0.28 / rows,
    )
    for k, walk in enumerate(walks):
        row, column = divmod(k, COLUMNS)
        for trace in _traces(walk, named=k == 0):
            figure.add_trace(trace, row=row + 1, col=column + 1)
        low, high = _around(np.vstack([walk.path_m, walk.true_m]))
        anchor = "x" if k == 0 else f"x{k + 1}"
        where = {"row": row + 1, "col": column + 1}
        figure.update_xaxes(range=[low[0], high[0]], **where)
        figure.update_yaxes(range=[low[1], high[1]], scaleanchor=anchor, **where)
    styled(figure, height_px=TILE_PX * rows + 60)
    figure.update_layout(margin={"t": 64}, legend={"y": 1 + 34 / (TILE_PX * rows)})
    figure.update_annotations(font={"size": 12, "color": TRUTH})
    return figure


def _around(xy_m: F64) -> tuple[F64, F64]:
    """Lower left and upper right corner with room about the points."""
    low, high = xy_m.min(axis=0), xy_m.max(axis=0)
    room = MARGIN * max(float((high - low).max()), 1.0)
    return low - room, high + room


def _traces(walk: DrawnWalk, *, named: bool) -> list[go.Scatter]:
    gap = np.full((len(walk.true_m), 2), np.nan)
    links = np.stack([walk.true_m, walk.reckoned_m, gap], axis=1).reshape(-1, 2)
    first = walk.true_m[:1]
    return [
        _scatter(
            links, "error", showlegend=named, line={"color": "rgba(209,52,75,0.6)", "width": 1}
        ),
        _scatter(
            walk.true_m,
            "waypoints",
            showlegend=named,
            line={"color": TRUTH, "width": 1, "dash": "dot"},
            marker={"color": TRUTH, "size": 6},
            mode="lines+markers",
        ),
        _scatter(
            walk.path_m,
            "dead reckoning",
            showlegend=named,
            line={"color": DEAD_RECKONING, "width": 2},
        ),
        _scatter(
            first,
            "start",
            showlegend=named,
            mode="markers",
            marker={"color": DEAD_RECKONING, "size": 9, "symbol": "circle-open"},
        ),
    ]


def _scatter(xy_m: F64, name: str, **look: object) -> go.Scatter:
    options: dict[str, object] = {"mode": "lines", "hoverinfo": "skip", **look}
    x, y = np.round(xy_m.T, 2)
    return go.Scatter(x=x, y=y, name=name, legendgroup=name, **options)
