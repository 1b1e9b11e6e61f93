"""Dots with intervals, a row for each name and a panel for each place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.scoring.figures import DEAD_RECKONING, SLAM, TRUTH, styled
from studies.finding import Row

ROW_PX = 30


class Dot(NamedTuple):
    """A value and where it lies with 95 %; `reference` is what others found, where they did."""

    name: str
    value: float
    low: float
    high: float
    reference: float | None = None


def dots_by(
    panel: Callable[[Row], str], name: Callable[[Row], str], rows: Sequence[Row], *columns: str
) -> dict[str, list[Dot]]:
    """The rows that have a value as dots, by panel.

    The columns are those of the value, from, to, and perhaps of what others found; of a cell of
    several figures, "median / mean / Q3", the first counts.
    """
    found: dict[str, list[Dot]] = {}
    for row in rows:
        cells = [row[column] for column in columns]
        if cells[0] is not None:
            numbers = [None if cell is None else float(str(cell).split(" / ")[0]) for cell in cells]
            dot = Dot(name(row), *numbers)  # type: ignore[arg-type]
            found.setdefault(panel(row), []).append(dot)
    return found


def dots_figure(panels: Mapping[str, Sequence[Dot]], x_title: str, reference: str) -> go.Figure:
    """A panel per entry, side by side; what is called an ELF has a colour of its own.

    `reference` names the hollow diamonds.
    """
    figure = make_subplots(cols=len(panels), subplot_titles=list(panels), shared_yaxes=True)
    for column, dots in enumerate(panels.values(), 1):
        for part in _drawn(list(dots), reference, in_legend=column == 1):
            figure.add_trace(part, row=1, col=column)
    most = max(len(dots) for dots in panels.values())
    styled(figure, height_px=155 + ROW_PX * most)
    figure.update_xaxes(title_text=x_title, rangemode="tozero")
    figure.update_yaxes(autorange="reversed")
    figure.update_layout(margin_t=36)
    figure.update_layout(legend={"x": 1, "xanchor": "right", "y": -0.35, "yanchor": "top"})
    return figure


def _drawn(dots: list[Dot], reference: str, *, in_legend: bool) -> list[go.Scatter]:
    names = [dot.name for dot in dots]
    spread = {
        "type": "data", "symmetric": False, "thickness": 1.5, "color": TRUTH,
        "array": [dot.high - dot.value for dot in dots],
        "arrayminus": [dot.value - dot.low for dot in dots],
    }  # fmt: skip
    colors = [SLAM if name.startswith("ELF") else TRUTH for name in names]
    ours = go.Scatter(
        x=[round(dot.value, 4) for dot in dots], y=names, mode="markers", error_x=spread,
        marker={"size": 10, "color": colors}, name="here", showlegend=False,
    )  # fmt: skip
    known = [dot for dot in dots if dot.reference is not None]
    theirs = go.Scatter(
        x=[dot.reference for dot in known], y=[dot.name for dot in known], mode="markers",
        marker={"size": 9, "symbol": "diamond-open", "color": DEAD_RECKONING, "line": {"width": 2}},
        name=reference, showlegend=in_legend,
    )  # fmt: skip
    return [ours, theirs]
