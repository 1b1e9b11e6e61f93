"""What an index of nearest spots finds, and how the vote for a map ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.scoring.figures import styled
from studies.figures.clouds import COLORS

ENDS = {"right": COLORS[0], "wrong": "#c0392b", "ambiguous": "#c9a227", "unknown": "#9aa3ad"}

DASHES = ("solid", "solid", "dot", "dash")
"""Ways that find the same lie on each other."""


class Recall(NamedTuple):
    """Share found (n) by effort (n), and the interval it lies in."""

    effort: F64
    share: F64
    low: F64
    high: F64


def recall_figure(ways: Mapping[str, Recall]) -> go.Figure:
    """Recall at 1 over the effort of a search, on a logarithmic axis; bars are intervals."""
    figure = go.Figure(
        [
            go.Scatter(
                x=each.effort, y=each.share, name=name, mode="lines+markers",
                line=_look(k),
                marker={"size": 7},
                error_y={
                    "array": (each.high - each.share).round(4), "symmetric": False,
                    "arrayminus": (each.share - each.low).round(4), "thickness": 1, "width": 0,
                },
            )
            for k, (name, each) in enumerate(ways.items())
        ]
    )  # fmt: skip
    styled(figure, height_px=340)
    ticks = sorted({float(x) for each in ways.values() for x in each.effort})
    figure.update_xaxes(
        type="log", title_text="cells or open ends looked at", tickvals=ticks,
        ticktext=[f"{tick:g}" for tick in ticks],
    )  # fmt: skip
    figure.update_yaxes(title_text="recall at 1", range=[0, 1.03])
    return figure


def _look(k: int) -> dict[str, object]:
    return {"color": COLORS[k % len(COLORS)], "width": 2.5, "dash": DASHES[k % len(DASHES)]}


def endings_figure(
    shares: Mapping[str, Mapping[str, Sequence[float]]], at: Sequence[int]
) -> go.Figure:
    """How votes end for each visitor, as stacked bars, one for each number of footsteps in `at`."""
    figure = go.Figure()
    for ending, color in ENDS.items():
        x = [[who for who in shares for _ in at], [f"{n}" for _ in shares for n in at]]
        y = np.concatenate([shares[who][ending] for who in shares]).round(4)
        figure.add_bar(x=x, y=y, name=ending, marker={"color": color})
    styled(figure, height_px=380)
    figure.update_layout(barmode="stack", bargap=0.25)
    figure.update_xaxes(title_text="footsteps")
    figure.update_yaxes(title_text="share of walks", range=[0, 1])
    return figure
