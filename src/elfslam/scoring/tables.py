"""Scores as plain rows, ready for JSON or for a table; rendering is the command's business."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Closures, Fixes, Run, Truth
from elfslam.scoring.closure_score import score_closures
from elfslam.scoring.errors import (
    Alignment,
    end_error_share,
    fix_errors,
    position_errors,
    summarise,
)

ScoreRow = dict[str, object]


def methods(run: Run) -> dict[str, tuple[F64, F64]]:
    """Times and poses of what a run can be judged by, by name."""
    return {
        "dead reckoning": (run.odometry.t_s, run.odometry.world_from_body),
        "SLAM": (run.trajectory.t_s, run.trajectory.world_from_body),
    }


def run_scores(run: Run, truth: Truth) -> list[ScoreRow]:
    """A row per method and alignment: the fields of `ErrorSummary`, and the end error's share.

    The share of the path (not per cent) belongs to the anchored rows; it is None in the others.
    """
    rows: list[ScoreRow] = []
    for method, (t_s, poses) in methods(run).items():
        for alignment in Alignment:
            errors = position_errors(t_s, poses, truth, alignment)
            anchored = alignment is Alignment.ANCHORED
            end = end_error_share(t_s, poses, truth) if anchored else None
            row = {"method": method, "alignment": alignment.value, **asdict(summarise(errors))}
            rows.append(_plain({**row, "end_error_share": end}))
    return rows


def closure_scores(run: Run, truth: Truth, *, radius_m: float = 1.0) -> list[ScoreRow]:
    """Precision, recall, count and median true distance of the closures, found and kept."""
    kept = run.trajectory.closure_weights > 0.5
    stages = {"found": np.ones_like(kept), "kept": kept}
    return [
        _closure_row(name, run.closures.chosen(rows), run, truth, radius_m)
        for name, rows in stages.items()
    ]


def _closure_row(
    name: str, closures: Closures, run: Run, truth: Truth, radius_m: float
) -> ScoreRow:
    score = score_closures(closures, run.trajectory.t_s, truth, radius_m=radius_m)
    return _plain(
        {
            "closures": name,
            "radius_m": radius_m,
            "precision": score.precision,
            "recall": score.recall,
            "count": score.count,
            "median_distance_m": score.median_distance_m,
        }
    )


def fix_scores(fixes: Fixes, truth: Truth, world_from_map: F64) -> list[ScoreRow]:
    """A row for the OK fixes and one for the ambiguous, each beside the counts by status."""
    summary = fix_errors(fixes, truth, world_from_map)
    shared = {"coverage": summary.coverage, "by_status": dict(summary.by_status)}
    parts = {"OK": summary.ok, "AMBIGUOUS": summary.ambiguous}
    return [_plain({"status": name, **asdict(part), **shared}) for name, part in parts.items()]


def _plain(row: ScoreRow) -> ScoreRow:
    """NaN is no JSON: what does not exist is None."""
    return {
        name: None if isinstance(value, float) and math.isnan(value) else value
        for name, value in row.items()
    }
