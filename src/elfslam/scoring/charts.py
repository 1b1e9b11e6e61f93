"""Charts of a run: similarity, steps, heading, time spent, and errors where truth is known."""

import html
from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import AnySimilarity, Closures, Echoes, Odometry, Trajectory
from elfslam.scoring.figures import CLOSURE, DEAD_RECKONING, GRID, METHODS, SLAM, TRUTH, styled

MATRIX_AT_MOST = 800
"""Larger similarity matrices are shown in blocks, so that the page stays under 10 MB."""

HISTOGRAM_BINS = 80
HISTOGRAM_ROWS = 2000
GAP = "rgba(209,52,75,0.2)"
CURVE_POINTS = 400
SIMILARITY_SCALE = [[0.0, "rgba(15,139,141,0)"], [1.0, "rgba(15,139,141,1)"]]
DASHES = {"anchored": "dot", "aligned": "solid", "aligned with scale": "dash"}
Curves = Mapping[tuple[str, str], tuple[F64, F64]]
"""Times (n) and errors (n) by (method, alignment)."""


def similarity_figure(similarity: AnySimilarity, closures: Closures) -> go.Figure:
    """The matrix over footsteps, with the closures found marked on both sides."""
    scores, footstep = reduced(similarity)
    off_diagonal = scores[~np.eye(len(scores), dtype=bool)]
    low, high = np.quantile(off_diagonal, [0.05, 0.999]) if off_diagonal.size else (0.0, 1.0)
    heat = go.Heatmap(
        z=scores,
        x=footstep,
        y=footstep,
        zmin=float(low),
        zmax=float(max(high, low + 1e-6)),
        colorscale=SIMILARITY_SCALE,
        colorbar={"thickness": 10, "outlinewidth": 0, "len": 0.9},
        hovertemplate="footsteps %{x} and %{y}: %{z:.2f}<extra></extra>",
    )
    marker = {"color": DEAD_RECKONING, "size": 3}
    marks = go.Scatter(
        x=np.concatenate([closures.i, closures.j]),
        y=np.concatenate([closures.j, closures.i]),
        mode="markers",
        marker=marker,
        name="closures found",
        hoverinfo="skip",
    )
    figure = styled(go.Figure([heat, marks]), height_px=460)
    figure.update_layout(showlegend=True)
    ends = [-0.5, similarity.count - 0.5]
    figure.update_xaxes(title_text="footstep", range=ends, constrain="domain", showgrid=False)
    figure.update_yaxes(title_text="footstep", range=ends[::-1], constrain="domain", showgrid=False)
    figure.update_yaxes(scaleanchor="x")
    return figure


def reduced(similarity: AnySimilarity) -> tuple[F32, I64]:
    """The matrix with at most MATRIX_AT_MOST rows, and the first footstep of each row.

    A block shows its greatest score: a mean would wash out the thin diagonals that matter.
    """
    block = max(-(-similarity.count // MATRIX_AT_MOST), 1)
    firsts = range(0, similarity.count, block)
    greatest = [similarity.rows(first, first + block).max(axis=0) for first in firsts]
    starts = np.asarray(firsts, dtype=np.int64)
    scores = np.array(greatest, dtype=np.float32).reshape(len(starts), similarity.count)
    if block > 1:
        scores = np.maximum.reduceat(scores, starts, axis=1)
    return np.round(scores, 3).astype(np.float32), starts


def histogram_figure(similarity: AnySimilarity, threshold: float | None) -> go.Figure:
    """How the scores of all pairs are spread, and where the threshold cuts.

    Of a long walk, the pairs of HISTOGRAM_ROWS footsteps spread over it.
    """
    rows = np.unique(np.linspace(0, similarity.count - 1, HISTOGRAM_ROWS).astype(int))
    pairs = [similarity.rows(k, k + 1)[0, k + 1 :] for k in rows if 0 <= k < similarity.count]
    counts, edges = np.histogram(np.concatenate([np.empty(0), *pairs]), bins=HISTOGRAM_BINS)
    middles = (edges[:-1] + edges[1:]) / 2
    bars = go.Bar(x=middles, y=counts, marker={"color": SLAM, "line": {"width": 0}}, opacity=0.7)
    figure = styled(go.Figure(bars), height_px=460)
    figure.update_layout(bargap=0, showlegend=False)
    figure.update_xaxes(title_text="similarity of two footsteps")
    figure.update_yaxes(title_text="pairs", type="log", dtick=1)
    if threshold is not None:
        line = {"color": CLOSURE, "width": 2, "dash": "dash"}
        text = f" threshold {threshold:g}"
        figure.add_vline(
            x=threshold, line=line, annotation_text=text, annotation_position="top right"
        )
    return figure


def steps_figure(odometry: Odometry, echoes: Echoes | None) -> go.Figure:
    """Step lengths and cadence along the walk; interruptions of the stream shaded."""
    moves = np.diff(odometry.world_from_body[:, :2], axis=0)
    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.08)
    rows = [
        (np.linalg.norm(moves, axis=1), "step length (m)", DEAD_RECKONING),
        (60 / np.diff(odometry.t_s), "steps per minute", TRUTH),
    ]
    for row, (values, title, color) in enumerate(rows, start=1):
        marker = {"color": color, "size": 4}
        dots = go.Scatter(x=odometry.t_s[1:], y=values, mode="markers", marker=marker, name=title)
        figure.add_trace(dots, row=row, col=1)
        figure.update_yaxes(title_text=title, rangemode="tozero", row=row, col=1)
    styled(figure)
    figure.update_layout(showlegend=False)
    figure.update_xaxes(title_text="time (s)", row=2, col=1)
    figure.update_layout(shapes=[] if echoes is None else _gaps(echoes.losses_s))
    return figure


def _gaps(losses_s: F64) -> list[dict[str, object]]:
    """A shape for each loss (n, 2), over the full height.

    They are handed over as one list: plotly's add_vrect copies those already there each time.
    """
    look = {"type": "rect", "yref": "paper", "y0": 0, "y1": 1, "fillcolor": GAP}
    spans = np.column_stack([losses_s[:, 0], losses_s.sum(axis=1)]).tolist()
    return [{**look, "x0": start_s, "x1": end_s, "line": {"width": 0}} for start_s, end_s in spans]


def heading_figure(odometry: Odometry, trajectory: Trajectory) -> go.Figure:
    """Heading along the walk, unwrapped, so that each round adds a full turn."""
    walks = {
        "dead reckoning": (odometry.t_s, odometry.world_from_body),
        "SLAM": (trajectory.t_s, trajectory.world_from_body),
    }
    lines = [
        go.Scatter(
            x=t_s,
            y=np.degrees(np.unwrap(poses[:, 2])),
            name=name,
            line={"color": METHODS[name], "width": 2},
        )
        for name, (t_s, poses) in walks.items()
    ]
    figure = styled(go.Figure(lines))
    figure.update_xaxes(title_text="time (s)")
    figure.update_yaxes(title_text="heading (degrees)")
    return figure


def seconds_figure(seconds: Mapping[str, float]) -> go.Figure:
    """Seconds per stage, first stage on top."""
    names = [html.escape(name) for name in seconds]
    bars = go.Bar(
        y=names,
        x=list(seconds.values()),
        orientation="h",
        marker={"color": SLAM},
        texttemplate="%{x:.2f} s",
        textposition="outside",
        cliponaxis=False,
        hoverinfo="skip",
    )
    figure = styled(go.Figure(bars), height_px=80 + 32 * max(len(names), 1))
    longest = max(seconds.values(), default=1.0)
    figure.update_xaxes(title_text="seconds", range=[0, 1.15 * longest or 1.0])
    figure.update_yaxes(autorange="reversed", showgrid=False, ticksuffix=" ")
    figure.update_layout(bargap=0.35)
    return figure


def error_figure(curves: Curves) -> go.Figure:
    """Error along the walk; each method keeps its colour, each alignment its dash."""
    figure = styled(go.Figure([_curve(key, t_s, e) for key, (t_s, e) in curves.items()]))
    figure.update_xaxes(title_text="time (s)")
    figure.update_yaxes(title_text="error (m)", rangemode="tozero")
    return figure


def error_share_figure(curves: Curves) -> go.Figure:
    """Share of the walk with an error below x."""
    share = np.linspace(0, 1, CURVE_POINTS)
    lines = [_curve(key, np.quantile(e, share), share) for key, (_, e) in curves.items()]
    figure = styled(go.Figure(lines))
    figure.update_xaxes(title_text="error (m)", rangemode="tozero")
    figure.update_yaxes(title_text="share of the walk", tickformat=".0%", range=[0, 1.02])
    return figure


def _curve(key: tuple[str, str], x: F64, y: F64) -> go.Scatter:
    method, alignment = key
    line = {"color": METHODS[method], "width": 2, "dash": DASHES[alignment]}
    return go.Scatter(
        x=np.round(x, 3), y=np.round(y, 3), name=f"{method}, {alignment}", mode="lines", line=line
    )


def loss_figure(losses: F64, block_step: I64, block_mean: F64) -> go.Figure:
    """The loss (steps) of a training, and its means over blocks that end at `block_step`."""
    each = go.Scatter(
        x=np.arange(1, len(losses) + 1),
        y=np.round(losses, 4),
        mode="lines",
        name="each step",
        line={"color": GRID, "width": 1},
        hoverinfo="skip",
    )
    mean = go.Scatter(
        x=block_step,
        y=np.round(block_mean, 4),
        mode="lines",
        name="mean of a block",
        line={"color": SLAM, "width": 2},
        hovertemplate="to step %{x}: %{y:.3f}<extra></extra>",
    )
    figure = styled(go.Figure([each, mean]), height_px=460)
    figure.update_xaxes(title_text="step", rangemode="tozero")
    figure.update_yaxes(title_text="loss", rangemode="tozero")
    return figure
