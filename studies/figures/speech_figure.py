"""How much of each utterance is understood, before and after what was done to it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.scoring.figures import DEAD_RECKONING, SLAM, TRUTH, WALKS, styled

Understood = Mapping[str, F64]
"""STOI of each utterance (n) by what was done; "unrelated ..." is the same by chance."""
COLORS = (SLAM, DEAD_RECKONING, *WALKS[2:])
ROW_PX = 64
SPREAD = 0.5
JITTER = 0.05
CHANCE = "unrelated speech"


def speech_figure(series: Mapping[str, Understood]) -> go.Figure:
    """A row for each thing that was done, in it for each series a dot per utterance and the mean.

    Every series has the same names.
    """
    names = [name for name in next(iter(series.values())) if not name.startswith("unrelated")]
    shifts = np.linspace(-SPREAD / 2, SPREAD / 2, len(series)) if len(series) > 1 else [0.0]
    dots = []
    for (label, numbers), shift, color in zip(series.items(), shifts, COLORS, strict=False):
        for row, name in enumerate(names):
            floor = numbers.get(f"unrelated {name.removesuffix(', enhanced')}")
            if floor is not None:
                dots.append(_dots(floor, row + shift, TRUTH, 0.25, CHANCE))
            dots.append(_dots(numbers[name], row + shift, color, 0.6, label))
            dots.append(_mean(numbers[name], row + shift, color))
    shown: set[object] = set()
    for each in dots:
        each.showlegend = bool(each.name) and each.name not in shown
        shown.add(each.name)
        each.legendrank = 2000 if each.name == CHANCE else 1000
    figure = styled(go.Figure(dots), height_px=110 + ROW_PX * len(names))
    figure.update_xaxes(title_text="STOI (1: every word; grey: by chance)", range=[-0.05, 1])
    figure.update_yaxes(
        tickvals=list(range(len(names))), ticktext=[f"{name} " for name in names],
        range=[len(names) - 0.5, -0.5], showgrid=False,
    )  # fmt: skip
    return figure


def _dots(values: F64, at: float, color: str, opacity: float, name: str) -> go.Scatter:
    scatter = JITTER * np.random.default_rng(0).uniform(-1, 1, len(values))
    return go.Scatter(
        x=np.round(values, 3), y=at + scatter, mode="markers", name=name, legendgroup=name,
        marker={"color": color, "size": 6, "opacity": opacity, "line": {"width": 0}},
        hovertemplate="%{x:.2f}",
    )  # fmt: skip


def _mean(values: F64, at: float, color: str) -> go.Scatter:
    mark = {"symbol": "line-ns-open", "size": 18, "color": color, "line": {"width": 3}}
    return go.Scatter(
        x=[round(float(values.mean()), 3)], y=[at], mode="markers", marker=mark, name="",
        hovertemplate="mean %{x:.2f}",
    )  # fmt: skip
