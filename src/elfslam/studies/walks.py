"""Many walks at once: errors of a folder of runs against a folder of recordings with truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Truth
from elfslam.data.runs import read_run
from elfslam.score.bootstrap import interval
from elfslam.score.errors import Alignment, end_error_share, path_length_m, position_errors
from elfslam.score.tables import methods
from elfslam.score.truth import read_truth

Row = dict[str, object]
FEWEST_WAYPOINTS = 3
"""With two waypoints a rigid alignment is nearly free."""


def score_walks(runs: Path, truths: Path) -> list[Row]:
    """A row per method and measure: the median over the walks and its 95 % interval, by resampling.

    A walk counts where its truth has at least three waypoints; the others are counted apart. SLAM
    has a row only where some walk closed a loop.
    """
    folders = sorted(item.parent for item in runs.glob("*/run.json"))
    if not folders:
        raise InputError(f"{runs}: holds no run; map the recordings first")
    collected: dict[str, list[dict[str, float]]] = {}
    for folder in folders:
        truth = read_truth(truths / folder.name)
        if len(truth.t_s) < FEWEST_WAYPOINTS:
            continue
        run = read_run(folder)
        known = methods(run)
        if run.trajectory.status != "OK":
            known.pop("SLAM")
        for method, (t_s, poses) in known.items():
            collected.setdefault(method, []).append(_measure(t_s, poses, truth))
    return [
        _row(method, measure, [each[measure] for each in measures], len(folders))
        for method, measures in collected.items()
        for measure in measures[0]
    ]


def _measure(t_s: np.ndarray, poses: np.ndarray, truth: Truth) -> dict[str, float]:
    aligned = position_errors(t_s, poses, truth, Alignment.ALIGNED)
    scaled = position_errors(t_s, poses, truth, Alignment.ALIGNED_WITH_SCALE)
    return {
        "end_error_percent": 100 * end_error_share(t_s, poses, truth),
        "aligned_rmse_m": float(np.sqrt(np.mean(aligned**2))),
        "scaled_rmse_m": float(np.sqrt(np.mean(scaled**2))),
        "length_ratio": path_length_m(poses[:, :2]) / path_length_m(truth.world_from_body[:, :2]),
    }


def _row(method: str, measure: str, values: list[float], walks: int) -> Row:
    """The median of one measure over the walks, with its 95 % interval."""
    each = [np.array([value]) for value in values]
    low, high = interval(each, lambda some: float(np.median(some)), np.random.default_rng(0))
    return {
        "method": method,
        "measure": measure,
        "median": float(np.median(values)),
        "low_95": low,
        "high_95": high,
        "scored": len(values),
        "walks": walks,
    }
