"""Many walks at once: errors of a folder of runs against a folder of recordings with truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from elfslam.base.errors import ElfslamError, InputError
from elfslam.base.geometry import path_length_m
from elfslam.base.values import Truth
from elfslam.data.level_files import read_levels
from elfslam.data.runs import read_run
from elfslam.data.truth_files import TRUE_LEVELS
from elfslam.scoring.errors import Alignment, end_error_share, interval, methods, position_errors
from elfslam.scoring.truth import read_truth

Row = dict[str, object]


def truth_of(path: Path) -> Truth:
    """The truth of a walk with its levels, where those lie beside it. Raises InputError."""
    truth = read_truth(path)
    levels = (path if path.is_dir() else path.parent) / TRUE_LEVELS
    return replace(truth, levels=read_levels(levels)) if levels.is_file() else truth


FEWEST_WAYPOINTS = 3
"""With two waypoints a rigid alignment is nearly free."""


def score_walks(runs: Path, truths: Path) -> tuple[list[Row], dict[str, str]]:
    """Errors of all walks, and by name why a walk was left out.

    A row per method and measure: the median over the walks and its 95 % interval, by resampling.
    A walk counts where run and truth can be read and the truth has at least three waypoints. SLAM
    has a row only where some walk closed a loop. Raises InputError where no walk counts.
    """
    folders = sorted(item.parent for item in runs.glob("[!.]*/run.json"))
    if not folders:
        raise InputError(f"{runs}: holds no run; map the recordings first")
    collected: dict[str, list[dict[str, float]]] = {}
    left_out: dict[str, str] = {}
    for folder in folders:
        try:
            measured = _measured(folder, truths / folder.name)
        except ElfslamError as error:
            left_out[folder.name] = str(error)
            continue
        for method, measures in measured.items():
            collected.setdefault(method, []).append(measures)
    if not collected:
        name, reason = next(iter(left_out.items()))
        raise InputError(f"{runs}: none of {len(folders)} runs can be scored; {name}: {reason}")
    rows = [
        _row(method, measure, [each[measure] for each in measures], len(folders))
        for method, measures in collected.items()
        for measure in measures[0]
    ]
    return rows, left_out


def _measured(folder: Path, truth_path: Path) -> dict[str, dict[str, float]]:
    truth = read_truth(truth_path)
    if len(truth.t_s) < FEWEST_WAYPOINTS:
        raise InputError(
            f"{truth_path}: its truth has {len(truth.t_s)} positions, wanted {FEWEST_WAYPOINTS}"
        )
    run = read_run(folder)
    known = methods(run)
    if run.trajectory.status != "OK":
        known.pop("SLAM")
    return {method: _measure(t_s, poses, truth) for method, (t_s, poses) in known.items()}


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
