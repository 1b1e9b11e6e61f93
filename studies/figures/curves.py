"""Curves with the band of their uncertainty, and traces of similarity beneath each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
from plotly.colors import sample_colorscale
from plotly.subplots import make_subplots

from elfslam.base.arrays import F64, I64
from elfslam.scoring.figures import CLOSURE, DEAD_RECKONING, SLAM, TRUTH, styled
from studies.figures.clouds import COLORS

TRACE_PX = 100
BAND_OPACITY = 0.18


class Curve(NamedTuple):
    """Values y (n) at x (n), and between which values (n) each lies, where that is known."""

    x: F64
    y: F64
    low: F64 | None = None
    high: F64 | None = None


def curves_figure(
    curves: Mapping[str, Curve],
    x_title: str,
    y_title: str,
    *,
    anchors: Mapping[str, float] | None = None,
    ticks: Sequence[float] | None = None,
    colors: Sequence[str] = COLORS,
) -> go.Figure:
    """Named curves; `ticks` puts x on a logarithmic axis with a tick at each of them.

    `anchors` are values that do not depend on x: the anchor of a curve is called as the curve is.
    """
    drawn: list[go.Scatter] = []
    for k, (name, curve) in enumerate(curves.items()):
        drawn += _drawn(name, curve, colors[k % len(colors)])
    figure = styled(go.Figure(drawn), height_px=340)
    for k, name in enumerate(curves):
        if anchors and name in anchors:
            line = {"color": colors[k % len(colors)], "width": 1.5, "dash": "dot"}
            figure.add_hline(y=anchors[name], line=line)
    figure.update_xaxes(title_text=x_title)
    figure.update_yaxes(title_text=y_title)
    if ticks is not None:
        texts = [f"{tick:g}" for tick in ticks]
        figure.update_xaxes(type="log", tickvals=list(ticks), ticktext=texts)
    return figure


def shades(count: int) -> list[str]:
    """Colours from dark to light, for curves that have an order."""
    return list(sample_colorscale("Viridis", np.linspace(0.0, 0.88, max(count, 2)).tolist()))


def _drawn(name: str, curve: Curve, color: str) -> list[go.Scatter]:
    """The curve, with dots where it has a band, and the band beneath it."""
    mode = "lines" if curve.low is None else "lines+markers"
    line = go.Scatter(
        x=curve.x, y=curve.y.round(4), name=name, mode=mode, line={"color": color, "width": 2},
        marker={"size": 7},
    )  # fmt: skip
    if curve.low is None or curve.high is None:
        return [line]
    band = go.Scatter(
        x=np.concatenate([curve.x, curve.x[::-1]]),
        y=np.concatenate([curve.high, curve.low[::-1]]).round(4),
        fill="toself", fillcolor=color, opacity=BAND_OPACITY, mode="none", showlegend=False,
        hoverinfo="skip",
    )  # fmt: skip
    return [band, line]


def traces_figure(traces: Mapping[str, F64], footstep: int, returns: I64) -> go.Figure:
    """Similarity of one footstep to all (n), a row for each named trace.

    Dotted lines lead through its returns. What is called an ELF has a colour of its own.
    """
    figure = make_subplots(
        rows=len(traces), shared_xaxes=True, vertical_spacing=0.36 / len(traces),
        subplot_titles=[f"<b>{name}</b>" for name in traces],
    )  # fmt: skip
    figure.update_annotations(x=0, xanchor="left", font={"size": 12})
    for row, (name, values) in enumerate(traces.items(), 1):
        color = SLAM if name.startswith("ELF") else TRUTH
        for part in _trace(values, footstep, returns, color, in_legend=row == 1):
            figure.add_trace(part, row=row, col=1)
    styled(figure, height_px=110 + TRACE_PX * len(traces))
    figure.update_layout(legend={"x": 1, "xanchor": "right", "y": 1.03})
    for at in returns.tolist():
        line = {"color": DEAD_RECKONING, "width": 1, "dash": "dot"}
        figure.add_vline(x=at, line=line, layer="below", opacity=0.7)
    figure.update_xaxes(range=[-2, len(next(iter(traces.values()))) + 1])
    figure.update_yaxes(nticks=4)
    figure.update_xaxes(title_text="footstep", row=len(traces), col=1)
    return figure


def _trace(
    values: F64, footstep: int, returns: I64, color: str, *, in_legend: bool
) -> list[go.Scatter]:
    """The line, the footstep itself (circle) and its returns (dots)."""
    line = go.Scatter(
        x=np.arange(len(values)), y=values.round(4), mode="lines", showlegend=False,
        line={"color": color, "width": 1.5},
    )  # fmt: skip
    itself = go.Scatter(
        x=[footstep], y=values[[footstep]].round(4), mode="markers", showlegend=in_legend,
        name=f"footstep {footstep} itself",
        marker={"color": CLOSURE, "size": 9, "symbol": "circle-open", "line": {"width": 2}},
    )  # fmt: skip
    back = go.Scatter(
        x=returns, y=values[returns].round(4), mode="markers", showlegend=in_legend,
        name="the same marker again", marker={"color": DEAD_RECKONING, "size": 8},
    )  # fmt: skip
    return [line, itself, back]
