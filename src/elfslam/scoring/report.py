"""Reports to look at: of a mapping run, of fixes in a map, of a map; and the plans in them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose, interpolate_poses, inverse, path_length_m
from elfslam.base.values import Fixes, FixStatus, FloorMap, Run, Truth
from elfslam.scoring import charts, figures
from elfslam.scoring.errors import (
    Alignment,
    ScoreRow,
    SimilarityTransform,
    closure_scores,
    fix_scores,
    is_sparse,
    match,
    methods,
    place,
    placement,
    run_scores,
    score_closures,
    summarise,
    walk_errors,
)
from elfslam.scoring.figures import FloorPlan
from elfslam.scoring.page import Page, Panel, facts_table, rows_table, save_page


def walk_plot(
    run: Run, truth: Truth | None = None, floor_plan: FloorPlan | None = None
) -> go.Figure:
    """A run from above: dead reckoning, trajectory (a colour a floor), closures, uncertainty.

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
    if run.visited is None:
        traces += figures.walk_traces(poses[:, :2], "SLAM", figures.SLAM)
    else:
        level = run.visited.levels.at(run.trajectory.t_s)
        traces += figures.level_traces(poses[:, :2], level)
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


PARAMETERS = "parameters"
"""The fact that is shown folded: a mapping of stage to parameters."""
MISSING = "missing"
"""The fact that lists stretches without sound or motion: what, from_s, until_s."""


def write_report(
    path: Path,
    run: Run,
    *,
    facts: Mapping[str, object],
    floor_plan: FloorPlan | None = None,
    truth: Truth | None = None,
) -> None:
    """Write the report of a run; with `truth`, its errors too.

    `facts` are shown as they come, except "parameters" (stage -> name -> value), which is folded
    and whose closure.threshold is drawn into the histogram. The floor plan lies in the map's
    frame, or in the truth's where truth is given: then both walks are aligned onto it.
    """
    parameters = facts.get(PARAMETERS)
    parameters = parameters if isinstance(parameters, Mapping) else {}
    judged = [] if truth is None else _error_panels(run, truth)
    page = Page(
        title=run.name,
        subtitle=f"mapped by {run.similarity.kind}",
        tiles=_tiles(run, truth),
        panels=[
            _walk_panel(run, floor_plan, truth),
            *judged,
            _rounds_panel(run),
            *_evidence_panels(run, parameters),
            Panel("Facts", facts_table(_facts(run, facts))),
        ],
        details={"Parameters": _parameter_tables(parameters)} if parameters else {},
    )
    save_page(path, page)


def write_fix_report(
    path: Path,
    floor_map: FloorMap,
    fixes: Fixes,
    truth: Truth | None = None,
    *,
    world_from_map: F64 | None = None,
) -> None:
    """Write the fixes over the map they were found in; with truth, each error as a line.

    All is drawn in the map's frame; `world_from_map` (3) brings the truth there (default: the
    map already lies in the world's frame; see `alignment.alignment_of`).
    """
    move = np.zeros(3) if world_from_map is None else world_from_map
    tables: list[Panel] = []
    if truth is not None:
        rows = [_short(row) for row in fix_scores(fixes, truth, move)]
        tables = [Panel("Errors (m)", rows_table(rows), wide=True)]
    drawn = fix_plot(fixes, floor_map, truth, world_from_map=move)
    counts = {_word(kind.name): str(int((fixes.status == kind).sum())) for kind in FixStatus}
    panel = Panel("Fixes from above", drawn, FIX_NOTE, wide=True)
    page = Page("Fixes", _sources(floor_map), [panel, *tables], tiles=counts)
    save_page(path, page)


def write_map_page(path: Path, floor_map: FloorMap) -> None:
    """Write a floor map: its spots by walk, their uncertainty, and what it knows at each."""
    payloads: list[Mapping[str, object]] = [
        {"kind": item.kind, "encoder": item.encoder, "numbers per spot": item.vectors.shape[1]}
        for item in floor_map.payloads
    ]
    tiles = {
        "spots": str(floor_map.order.size),
        "walks": str(np.unique(floor_map.walk).size),
        "parameters": floor_map.parameters_digest,
    }
    panels = [
        Panel("The map from above", map_plot(floor_map), wide=True),
        Panel("What it knows at each spot", rows_table(payloads), wide=True),
    ]
    save_page(path, Page("Floor map", _sources(floor_map), panels, tiles=tiles))


WALK_NOTE = "Circle: start. Square: end. Ellipses: 1-sigma. A thin line joins the two visits."
ROUNDS_NOTE = "From the side, raised by time. A thin line joins two visits that sound alike."
FIX_NOTE = "In the frame of the map. Fixes without a position are counted above, not drawn."


def _walk_panel(run: Run, floor_plan: FloorPlan | None, truth: Truth | None) -> Panel:
    note = WALK_NOTE if truth is None else WALK_NOTE + " Both walks are aligned onto the truth."
    return Panel("The walk from above", walk_plot(run, truth, floor_plan), note, wide=True)


def _rounds_panel(run: Run) -> Panel:
    """What closes where: from above the two visits of a closure lie on one another."""
    walk = run.trajectory
    raised = figures.lifted(walk.world_from_body[:, :2], walk.t_s)
    traces = figures.closure_traces(raised, run.closures, walk.closure_weights)
    traces += figures.walk_traces(raised, "SLAM", figures.SLAM)
    return Panel("The walk through time", figures.lifted_plan(traces), ROUNDS_NOTE, wide=True)


def _error_panels(run: Run, truth: Truth) -> list[Panel]:
    curves = {
        (name, alignment.value): walk_errors(t_s, poses, truth, alignment)
        for name, (t_s, poses) in methods(run).items()
        for alignment in (Alignment.ANCHORED, Alignment.ALIGNED)
    }
    rows = [_short(row) for row in run_scores(run, truth)]
    closures = rows_table([_short(row) for row in closure_scores(run, truth)])
    return [
        Panel("Errors (m)", rows_table(rows), ERROR_NOTE, wide=True),
        Panel("Closures against the truth (m)", closures, CLOSURE_NOTE, wide=True),
        Panel("Error along the walk", charts.error_figure(curves)),
        Panel("Share of the walk below an error", charts.error_share_figure(curves)),
    ]


ERROR_NOTE = (
    "Anchored: only the first pose is given. Aligned: the best rigid fit. With scale: the length "
    "of a step is forgiven too."
)
CLOSURE_NOTE = (
    "A closure is right when its two ends truly lie within the radius. "
    "Found: what the similarity gave. Kept: what the graph believes."
)


def _evidence_panels(run: Run, parameters: Mapping[str, object]) -> list[Panel]:
    closure = parameters.get("closure")
    found = closure.get("threshold") if isinstance(closure, Mapping) else None
    threshold = float(found) if isinstance(found, int | float) else None
    matrix = charts.similarity_figure(run.similarity, run.closures)
    panels = [
        Panel(
            "Similarity of footsteps",
            matrix,
            "The stronger the colour, the more similar; dots are closures.",
        ),
        Panel("Spread of the similarity", charts.histogram_figure(run.similarity, threshold)),
        Panel("Steps", charts.steps_figure(run.odometry, run.echoes)),
        Panel("Heading", charts.heading_figure(run.odometry, run.trajectory)),
    ]
    if run.seconds:
        panels.append(Panel("Seconds per stage", charts.seconds_figure(run.seconds)))
    return panels


def _tiles(run: Run, truth: Truth | None) -> dict[str, str]:
    tiles = {
        "walked": f"{path_length_m(run.trajectory.world_from_body[:, :2]):.0f} m",
        "duration": f"{run.trajectory.t_s[-1] - run.trajectory.t_s[0]:.0f} s",
        "footsteps": str(run.trajectory.t_s.size),
        "closures": str(run.closures.i.size),
        "status": run.trajectory.status,
    }
    if truth is not None:
        walk = (run.trajectory.t_s, run.trajectory.world_from_body)
        errors = summarise(walk_errors(*walk, truth, Alignment.ALIGNED)[1])
        tiles["median error, aligned"] = f"{errors.median_m:.2f} m"
    return tiles


def _facts(run: Run, facts: Mapping[str, object]) -> dict[str, object]:
    known: dict[str, object] = {"recording": run.name}
    if run.features is not None:
        known["encoder"] = run.features.encoder
    known |= {"footsteps": run.trajectory.t_s.size, "closures": run.closures.i.size}
    if run.echoes is not None:
        losses_s = run.echoes.losses_s[:, 1]
        known["echoes"] = run.echoes.t_s.size
        known["losses of stream"] = f"{losses_s.size} ({losses_s.sum():.1f} s)"
    known["status"] = run.trajectory.status
    if missing := facts.get(MISSING):
        known["missing"] = _stretches(missing)
    return known | {
        name: value for name, value in facts.items() if name not in (PARAMETERS, MISSING)
    }


def _stretches(missing: object) -> str:
    """What a recording lacked, in words; as it comes where it is not what run.json says."""
    try:
        return "; ".join(
            f"{each['what']} from {each['from_s']:.1f} to {each['until_s']:.1f} s"
            for each in missing  # type: ignore[attr-defined]
        )
    except (TypeError, KeyError, ValueError):
        return str(missing)


def _parameter_tables(parameters: Mapping[str, object]) -> str:
    flat = {
        f"{stage}.{name}": value
        for stage, group in parameters.items()
        if isinstance(group, Mapping)
        for name, value in group.items()
    }
    return facts_table(flat)


def _short(row: ScoreRow) -> dict[str, object]:
    """Column titles without the unit, which the panel's title states; shares in per cent."""
    row = dict(row)
    for name in [name for name in row if name.endswith("_share")]:
        share = row.pop(name)
        row[f"{name.removesuffix('_share')} (% of path)"] = _percent(share)
    return {_word(name.removesuffix("_m")): value for name, value in row.items()}


def _percent(share: object) -> float | None:
    return 100 * share if isinstance(share, float) else None


def _word(name: str) -> str:
    return name.replace("_", " ").lower()


def _sources(floor_map: FloorMap) -> str:
    return "from " + ", ".join(floor_map.sources) if floor_map.sources else "of unknown origin"
