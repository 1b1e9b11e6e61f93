"""How often something came out right, wrong or not at all, as bars."""

from __future__ import annotations

from collections.abc import Mapping

import plotly.graph_objects as go

from elfslam.scoring.figures import RIGHT, TRUTH, WRONG, styled

ROW_PX = 46
COLORS = {"right": RIGHT, "refused": TRUTH, "wrong": WRONG}


def outcomes_figure(counts: Mapping[str, Mapping[str, int]], x_title: str) -> go.Figure:
    """A bar per label, from what came out right over what was refused to what is wrong."""
    labels = list(counts)
    bars = [
        go.Bar(
            y=labels, x=[counts[label].get(name, 0) for label in labels], name=name,
            orientation="h", marker={"color": color, "line": {"width": 0}}, opacity=0.85,
            hovertemplate="%{y}: %{x} " + name + "<extra></extra>",
        )
        for name, color in COLORS.items()
    ]  # fmt: skip
    figure = styled(go.Figure(bars), height_px=110 + ROW_PX * len(labels))
    figure.update_layout(barmode="stack", bargap=0.35, legend={"traceorder": "normal"})
    figure.update_xaxes(title_text=x_title)
    figure.update_yaxes(autorange="reversed", showgrid=False, ticksuffix=" ")
    return figure
