"""The truth of a walk is written here, and read by scoring alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.values import Truth
from elfslam.data.atomic_files import new_file
from elfslam.data.tables import write_timed_table
from elfslam.data.tum import write_tum

POSES = "truth.tum"
WAYPOINTS = "waypoints.csv"
TRUTH_FILES = (POSES, WAYPOINTS)


def write_truth(truth: Truth, folder: Path) -> None:
    """truth.tum where every heading is known, else waypoints.csv; nothing for an empty truth."""
    if len(truth.t_s) == 0:
        return
    poses = truth.world_from_body
    is_whole = np.isfinite(poses).all()
    with new_file(folder / (POSES if is_whole else WAYPOINTS)) as partial:
        if is_whole:
            write_tum(partial, truth.t_s, poses)
        else:
            write_timed_table(partial, ["x_m", "y_m"], truth.t_s, poses[:, :2])
