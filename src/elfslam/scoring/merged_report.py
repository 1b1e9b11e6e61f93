"""The report of a map of many walks, with a tile per square metre for how far it can be trusted."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.base.values import FloorMap
from elfslam.scoring import figures
from elfslam.scoring.figures import WRONG, styled
from elfslam.scoring.page import Page, Panel, rows_table, save_page
from elfslam.stages.floormap import MapQuality

GOOD_MANY = [[0.0, "#e9f4f3"], [0.5, "#5fb4b2"], [1.0, "#0b5f61"]]
GOOD_FEW = [[0.0, "#e9f4f3"], [0.5, "#e9b872"], [1.0, "#b3261e"]]
TILE_GAP_PX = 1
HEIGHT_PX = 400


def walks_tiles(quality: MapQuality) -> go.Figure:
    """How many walks know each square."""
    walks = quality.walks.astype(np.float64)
    return _tiles(quality, walks, "walks", GOOD_MANY, least=1, digits=".0f")


def sigma_tiles(quality: MapQuality) -> go.Figure:
    """How uncertain the positions of the spots in each square are, one sigma per axis."""
    return _tiles(quality, quality.sigma_m, "m", GOOD_FEW, least=0.5)


def error_tiles(quality: MapQuality) -> go.Figure:
    """How far off the other walks find the spots of each square; empty where no other was."""
    return _tiles(quality, np.minimum(quality.error_m, 2.0), "m", GOOD_FEW, least=0.5)


def weight_tiles(quality: MapQuality) -> go.Figure:
    """How much what is known of each square still counts; a cross where it has changed."""
    figure = _tiles(quality, quality.weight, "weight", GOOD_MANY, least=1)
    changed = quality.xy_m[quality.changed]
    marker = {"symbol": "x-thin", "size": 11, "line": {"width": 2.5, "color": WRONG}}
    crosses = go.Scatter(
        x=changed[:, 0], y=changed[:, 1], mode="markers", marker=marker, name="changed",
        hovertemplate="changed: %{x:.1f}, %{y:.1f}<extra></extra>",
    )  # fmt: skip
    figure.add_trace(crosses)
    return figure.update_layout(showlegend=bool(len(changed)))


def _tiles(
    quality: MapQuality,
    values: F64,
    unit: str,
    scale: list[list[object]],
    *,
    least: float,
    digits: str = ".2f",
) -> go.Figure:
    """Values (c) of the squares, the others left open; the scale goes to `least` or further."""
    columns, x = np.unique(quality.xy_m[:, 0], return_inverse=True)
    rows, y = np.unique(quality.xy_m[:, 1], return_inverse=True)
    grid = np.full((len(rows), len(columns)), np.nan)
    grid[y, x] = values
    most = float(np.nan_to_num(values).max(initial=least))
    look = {"thickness": 10, "outlinewidth": 0, "title": {"text": unit}}
    hover = f"%{{x:.1f}}, %{{y:.1f}}: %{{z:{digits}}} {unit}<extra></extra>"
    heat = go.Heatmap(
        x=columns, y=rows, z=grid.round(3), colorscale=scale, xgap=TILE_GAP_PX, ygap=TILE_GAP_PX,
        zmin=0, zmax=most, colorbar=look, hoverongaps=False, hovertemplate=hover,
    )  # fmt: skip
    figure = styled(go.Figure(heat), height_px=HEIGHT_PX)
    figure.update_xaxes(title_text="x (m)", showgrid=False, constrain="domain")
    figure.update_yaxes(
        title_text="y (m)", showgrid=False, constrain="domain", scaleanchor="x", scaleratio=1
    )
    return figure


PAIRS_NOTE = (
    "Places: ground that both cover in the same direction. Resemblance: there, relative to that of "
    "a walk to itself. Lead: over the best other placement, in standard errors."
)
ERROR_NOTE = (
    "How far off a spot's best match in the other walks lies, median of each square. "
    "What is more than 2 m is drawn as 2 m."
)
SIGMA_NOTE = "One sigma per axis, relative to the start of the first walk."
WEIGHT_NOTE = (
    "What newer walks pass fades. A cross: newer walks come by and do not know the place again."
)


def write_merged_report(
    path: Path,
    floor_map: FloorMap,
    quality: MapQuality,
    pairs: Sequence[Mapping[str, object]],
    refused: Mapping[str, str],
) -> None:
    """Write the page of a merged map: its walks, its quality by square metre, how they met."""
    known = quality.error_m[np.isfinite(quality.error_m)]
    tiles = {
        "walks": str(len(np.unique(floor_map.walk))),
        "spots": str(len(floor_map.xy_m)),
        "squares": str(len(quality.xy_m)),
        "changed": str(int(quality.changed.sum())),
        "typical error": f"{np.median(known):.2f} m" if len(known) else "-",
    }
    drawn = figures.plan(figures.map_traces(floor_map), height_px=520)
    panels = [
        Panel("The map from above", drawn, wide=True),
        Panel("Walks per square", walks_tiles(quality)),
        Panel("Expected error", error_tiles(quality), ERROR_NOTE),
        Panel("Uncertainty of the positions", sigma_tiles(quality), SIGMA_NOTE),
        Panel("Age and change", weight_tiles(quality), WEIGHT_NOTE),
    ]
    if pairs:
        panels.append(Panel("How they met", rows_table(pairs), PAIRS_NOTE, wide=True))
    if refused:
        rows = [{"walk": name, "why it stayed out": why} for name, why in refused.items()]
        panels.append(Panel("Stayed out", rows_table(rows), wide=True))
    save_page(path, Page("Floor map", "of " + ", ".join(floor_map.sources), panels, tiles=tiles))
