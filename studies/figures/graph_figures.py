"""Pose graphs as small multiples: the walk before, after, and what was believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.base.arrays import F64, I64
from elfslam.scoring.figures import CLOSURE, DEAD_RECKONING, SLAM, TRUTH, WRONG, styled

ROW_PX = 250
LINKS_AT_MOST = 1500


@dataclass(frozen=True, eq=False)
class Drawn:
    """One small picture: walks (n, 2) by name, and links (k, 2) by name between poses of `ends`."""

    title: str
    walks: dict[str, F64]
    links: dict[str, I64]
    ends: F64


COLORS = {
    "odometry": DEAD_RECKONING,
    "truth": TRUTH,
    "solved": SLAM,
    "closures believed": CLOSURE,
    "false closures believed": WRONG,
    "false closures": WRONG,
}


def graphs_figure(pictures: Sequence[Drawn], columns: int) -> go.Figure:
    """Pictures in rows of `columns`, each to its own scale; each name once in the legend."""
    rows = -(-len(pictures) // columns)
    titles = [picture.title for picture in pictures]
    figure = make_subplots(
        rows, columns, subplot_titles=titles, horizontal_spacing=0.02, vertical_spacing=0.12 / rows
    )
    named: set[str] = set()
    for k, picture in enumerate(pictures):
        for trace in _traces(picture):
            trace.update(showlegend=trace.name not in named, legendgroup=trace.name)
            named.add(trace.name)
            figure.add_trace(trace, row=k // columns + 1, col=k % columns + 1)
    figure = styled(figure, height_px=ROW_PX * rows + 60)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    for k in range(len(pictures)):
        figure.update_yaxes(
            scaleanchor=f"x{k + 1 if k else ''}", row=k // columns + 1, col=k % columns + 1
        )
    figure.update_annotations(font={"size": 13, "color": TRUTH})
    return figure.update_layout(
        legend={"y": 1.0 + 34 / (ROW_PX * rows)}, margin={"l": 4, "r": 4, "t": 64, "b": 8}
    )


def _traces(picture: Drawn) -> list[go.Scatter]:
    traces = []
    for name, links in picture.links.items():
        if len(links):
            chosen = links[:: -(-len(links) // LINKS_AT_MOST)]
            gap = np.full((len(chosen), 1, 2), np.nan)
            lines = np.concatenate([picture.ends[chosen], gap], axis=1).reshape(-1, 2)
            traces.append(_line(lines, name, 0.7, 0.45))
    for name, xy_m in picture.walks.items():
        traces.append(_line(xy_m, name, 1.1, 0.55 if name != "solved" else 1.0))
    return traces


def _line(xy_m: F64, name: str, width: float, opacity: float) -> go.Scatter:
    x, y = np.round(xy_m, 2).astype(np.float32).T
    line = {"color": COLORS[name], "width": width}
    return go.Scatter(
        x=x, y=y, name=name, mode="lines", line=line, opacity=opacity, hoverinfo="skip"
    )
