"""The report of a map of many walks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.values import FloorMap
from elfslam.scoring import figures
from elfslam.scoring.page import Page, Panel, rows_table, save_page
from elfslam.scoring.quality_figures import error_tiles, sigma_tiles, walks_tiles, weight_tiles
from elfslam.stages.quality import MapQuality

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
