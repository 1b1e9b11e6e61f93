"""What a place tapped on the floor plan is worth: a map's errors by how many were tapped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Checkpoints, Trajectory, Truth
from elfslam.line.checkpoints import lies_on_plan
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from studies.figures.curves import curves_figure
from studies.finding import Finding, Given, Row
from studies.intervals import curve_of, mean_row
from studies.localization import SEEDS, WORLDS, shipped
from studies.located import MAPPING_ROUNDS, at_its_start
from studies.mapping import CALIBRATED, walkers
from studies.repeats import Numbers, by_world, finished
from studies.simulated_walk import SimulatedWalk, simulated

TAPS = (0, 2, 4, 8)
"""Without any the walker declares where the walk begins."""
GOLDEN = 0.5 * (5**0.5 - 1)
"""Times at multiples of this share of a walk are at different places of its rounds."""
TAP_SIGMA_M = 0.3
IN_FRAME, ALIGNED, ON_PLAN = "in its frame (m)", "aligned (m)", "on the plan"


def measure_taps(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = MAPPING_ROUNDS,
    kind: Kind = PEOPLE,
) -> Finding:
    """Median errors of maps by taps: in the frame that they claim, and after a rigid fit."""
    tasks = [SimulatedWalk(world, seed, rounds, kind.name) for world in worlds for seed in seeds]
    found = by_world(tasks, finished(_measured, tasks, given))
    rows = [
        {"world": world, **mean_row("taps", taps, measure, _each(walks, taps, measure), "walks")}
        for world, walks in found.items()
        for measure in (IN_FRAME, ALIGNED, ON_PLAN)
        for taps in TAPS
    ]
    return Finding(rows, _page(rows))


def tapped(truth: Truth, taps: int, seed: int) -> Checkpoints:
    """Places tapped on the way, each a little beside where the walker is."""
    generator = np.random.default_rng([seed, 77])
    share = np.sort((0.5 + GOLDEN * np.arange(taps)) % 1.0)
    t_s = truth.t_s[0] + share * (truth.t_s[-1] - truth.t_s[0])
    xy_m = interpolate_poses(truth.t_s, truth.world_from_body, t_s)[:, :2]
    names = tuple(f"place {k}" for k in range(taps))
    return Checkpoints(t_s, names, xy_m + generator.normal(0, TAP_SIGMA_M, xy_m.shape))


def _measured(walk: SimulatedWalk) -> Numbers:
    kind = kind_named(walk.kind)
    recording, truth = simulated(walk)
    settings, numbers = walkers(walk.seed, kind)[CALIBRATED], Numbers()
    for taps in TAPS:
        told = tapped(truth, taps, walk.seed) if taps else None
        begun = at_its_start(recording, truth) if told is None else recording
        run = map_by_echoes(replace(begun, checkpoints=told), shipped(), settings)
        on_plan = told is None or lies_on_plan(told, run.trajectory, settings.checkpoint)
        aligned = _aligned_m(run.trajectory, truth)
        in_frame = _in_frame_m(run.trajectory, truth) if on_plan else float("nan")
        found = {IN_FRAME: in_frame, ALIGNED: aligned, ON_PLAN: float(on_plan)}
        numbers |= {f"{taps}|{name}": value for name, value in found.items()}
    return numbers


def _in_frame_m(mapped: Trajectory, truth: Truth) -> float:
    """The median error as the map lies."""
    true = interpolate_poses(truth.t_s, truth.world_from_body, mapped.t_s)
    return float(np.median(np.linalg.norm((mapped.world_from_body - true)[:, :2], axis=1)))


def _aligned_m(mapped: Trajectory, truth: Truth) -> float:
    errors_m = position_errors(mapped.t_s, mapped.world_from_body, truth, Alignment.ALIGNED)
    return float(np.median(errors_m))


def _each(walks: Sequence[Mapping[str, float]], taps: int, measure: str) -> list[float]:
    values = [walk[f"{taps}|{measure}"] for walk in walks]
    return [value for value in values if np.isfinite(value)]


def _page(rows: Sequence[Row]) -> Page:
    """Errors against taps in each world, and the table."""
    panels = []
    for world in dict.fromkeys(str(row["world"]) for row in rows):
        here = [row for row in rows if row["world"] == world]
        curves = {
            measure: curve_of([row for row in here if row["measure"] == measure])
            for measure in (IN_FRAME, ALIGNED)
        }
        panels.append(Panel(world, curves_figure(curves, "places tapped", "median error (m)")))
    panels.append(Panel("All of it", rows_table(rows), wide=True))
    return Page("Places tapped on a plan", "0: where the walk begins was declared", panels)
