"""Plans of a run, of fixes and of a floor map: what reports and notebooks draw."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose, interpolate_poses, inverse
from elfslam.base.values import Fixes, FloorMap, Run, Truth
from elfslam.scoring import figures
from elfslam.scoring.alignment import (
    Alignment,
    SimilarityTransform,
    is_sparse,
    match,
    place,
    placement,
)
from elfslam.scoring.closure_score import score_closures
from elfslam.scoring.figures import FloorPlan
from elfslam.scoring.tables import methods


def walk_plot(
    run: Run, truth: Truth | None = None, floor_plan: FloorPlan | None = None
) -> go.Figure:
    """A run from above: dead reckoning, trajectory, closures, uncertainty.

    With a truth both walks are aligned onto it, and closures coloured by whether they are right.
    """
    placed = {name: _placed(t_s, poses, truth) for name, (t_s, poses) in methods(run).items()}
    where, poses = placed["SLAM"]
    traces = figures.floor_traces(floor_plan)
    if truth is not None:
        score = score_closures(run.closures, run.trajectory.t_s, truth)
        known = np.isfinite(score.distance_m)
        kept = run.trajectory.closure_weights > 0.5
        links = (poses[:, :2], run.closures, score.right, known, kept)
        traces += figures.judged_closure_traces(*links)
        true_xy = truth.world_from_body[:, :2]
        traces += figures.walk_traces(true_xy, "truth", figures.TRUTH, dash="dash")
    dead_reckoned = placed["dead reckoning"][1][:, :2]
    name, color = "dead reckoning", figures.DEAD_RECKONING
    traces += figures.walk_traces(dead_reckoned, name, color, width=1.5, opacity=0.7)
    covariance = _turned(run.trajectory.covariance[:, :2, :2], where)
    traces.append(figures.ellipse_trace(poses[:, :2], covariance, figures.SLAM))
    traces += figures.walk_traces(poses[:, :2], "SLAM", figures.SLAM)
    if truth is None:
        weights = run.trajectory.closure_weights
        traces += figures.closure_traces(poses[:, :2], run.closures, weights)
    return figures.plan(traces)


def fix_plot(
    fixes: Fixes,
    floor_map: FloorMap | None = None,
    truth: Truth | None = None,
    *,
    world_from_map: F64 | None = None,
) -> go.Figure:
    """Fixes over the map they were found in, in its frame; with a truth, each error as a line.

    `world_from_map` (3) brings the truth there (default: the map lies in the world's frame).
    """
    move = np.zeros(3) if world_from_map is None else world_from_map
    traces = [] if floor_map is None else figures.map_traces(floor_map, faint=True)
    if truth is not None:
        traces += _truth_traces(fixes, truth, inverse(move))
    return figures.plan([*traces, *figures.fix_traces(fixes)])


def map_plot(floor_map: FloorMap) -> go.Figure:
    """The spots of a floor map by walk, with their uncertainty."""
    ellipses = figures.ellipse_trace(floor_map.xy_m, floor_map.covariance_m2, figures.TRUTH)
    return figures.plan([ellipses, *figures.map_traces(floor_map)])


def _truth_traces(fixes: Fixes, truth: Truth, map_from_world: F64) -> list[go.Scatter]:
    """The true walk in the map, and each fix joined to where it should be (dense truth only)."""
    there = compose(map_from_world, np.nan_to_num(truth.world_from_body))
    traces = figures.walk_traces(there[:, :2], "truth", figures.TRUTH, dash="dash")
    if is_sparse(truth):
        return traces
    inside = (fixes.t_s >= truth.t_s[0]) & (fixes.t_s <= truth.t_s[-1])
    at_fixes = interpolate_poses(truth.t_s, there, fixes.t_s[inside])[:, :2]
    return [*traces, figures.error_trace(fixes.xy_m[inside], at_fixes, figures.WRONG)]


def _placed(t_s: F64, poses: F64, truth: Truth | None) -> tuple[SimilarityTransform, F64]:
    if truth is None:
        return SimilarityTransform(np.zeros(3)), poses
    where = placement(match(t_s, poses, truth), Alignment.ALIGNED)
    return where, place(poses, where)


def _turned(covariance_m2: F64, where: SimilarityTransform) -> F64:
    cos, sin = np.cos(where.world_from_map[2]), np.sin(where.world_from_map[2])
    turn = np.array([[cos, -sin], [sin, cos]])
    return np.asarray(turn @ covariance_m2 @ turn.T)
