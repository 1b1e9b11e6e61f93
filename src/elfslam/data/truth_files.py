"""The truth of a walk is written here, and read by scoring alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.values import Truth
from elfslam.data.tables import write_timed_table
from elfslam.data.tum import write_tum

POSES = "truth.tum"
WAYPOINTS = "waypoints.csv"
TRUTH_FILES = (POSES, WAYPOINTS)


def write_truth(truth: Truth, folder: Path) -> None:
    """truth.tum where every heading is known, else waypoints.csv; nothing for an empty truth."""
    if len(truth.t_s) == 0:
        return
    if np.isfinite(truth.world_from_body).all():
        write_tum(folder / POSES, truth.t_s, truth.world_from_body)
    else:
        xy_m = truth.world_from_body[:, :2]
        write_timed_table(folder / WAYPOINTS, ["x_m", "y_m"], truth.t_s, xy_m)
