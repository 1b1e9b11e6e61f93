"""Acoustic odometry: is a walk of better scale when the echoes say how long the steps are?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Features
from elfslam.line.acoustic_odometry import (
    AcousticOdometryParameters,
    ScaleEstimate,
    measure_scale,
    rescaled,
    with_prior,
)
from elfslam.line.closure import find_closures
from elfslam.line.feature import extract_features, load_encoder
from elfslam.line.graph import build_graph, optimise
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.scoring.bootstrap import interval
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.parameters import Parameters
from elfslam.world.kinds import PEOPLE, Kind
from studies.figures.scale_figures import Estimates, estimates_figure
from studies.finding import Finding, Given, Row
from studies.heard_walk import Heard, hear_walk, true_scale
from studies.repeats import Numbers, by_world, finished
from studies.simulated_walk import SimulatedWalk
from studies.walls_in_focus import focus_panel, walks_panels

SEEDS = {
    "studio": range(110, 120),
    "lounge": range(110, 120),
    "concourse": range(110, 120),
    "living_room": range(10),
    "office": range(10),
    "mall": range(10),
}
"""The first three worlds are those of development, but these walks in them were not looked at."""
ROUNDS = 4
PEOPLE_SIGMA = 0.06
"""How far true and claimed steps of people are apart without sound."""
ESTIMATES_NOTE = (
    "Dots are walks with two standard errors. The dashed line is what is believed without sound."
)
MAPS_NOTE = (
    "Median aligned error, median over walks. From steps as claimed, as measured and as they truly "
    "were; the intervals are 95 %, by resampling walks."
)
SCALE_COLUMNS = (
    "walks",
    "refused",
    "scale error as claimed (%, rms)",
    "as measured (%, rms)",
    "normalised error squared",
    "improved",
    "improved, from",
    "improved, to",
)
MAP_COLUMNS = (
    "maps",
    "map error as claimed (m)",
    "by measured steps (m)",
    "by true steps (m)",
    "measured over claimed",
    "ratio, from",
    "ratio, to",
)

WALKS = tuple(
    SimulatedWalk(world, seed, ROUNDS) for world, seeds in SEEDS.items() for seed in seeds
)


def measure_acoustic_odometry(
    given: Given, *, walks: Sequence[SimulatedWalk] = WALKS, kind: Kind = PEOPLE
) -> Finding:
    """A row per world: error of scale and of the map, with steps as claimed and as measured."""
    walks = [replace(walk, kind=kind.name) for walk in walks]
    numbers = finished(measure_walk, walks, given)
    worlds = by_world(walks, numbers)
    rows = [_row(world, found) for world, found in worlds.items()]
    rows.append(_row("all", numbers))
    given.announce("pictures", None)
    return Finding(rows, _page(rows, worlds, walks))


def measure_walk(walk: SimulatedWalk) -> Numbers:
    """True and measured scale, and the map error with steps as claimed, as measured and as true."""
    heard = hear_walk(walk)
    true = true_scale(heard.nodes, heard.truth)
    found = measure_scale(heard.echoes, heard.nodes, heard.chirp, AcousticOdometryParameters())
    used = with_prior(found, PEOPLE_SIGMA)
    numbers = {"true": true, "scale": found.scale, "sigma": found.sigma, "used": used.scale}
    features = extract_features(heard.echoes, load_encoder("compact"))
    tried = {"claimed": 1.0, "measured": used.scale, "true": true}
    errors_m = {
        f"map error, {name}": _map_error_m(heard, features, ScaleEstimate(scale, 0.0))
        for name, scale in tried.items()
    }
    return numbers | errors_m


def _map_error_m(heard: Heard, features: Features, estimate: ScaleEstimate) -> float:
    """Median aligned error of the map from steps of this scale."""
    nodes, parameters = rescaled(heard.nodes, estimate), Parameters()
    closures = find_closures(echo_sequence_similarity(features, nodes), nodes, parameters.closure)
    made = optimise(build_graph(nodes, closures), nodes.t_s, parameters.graph)
    errors = position_errors(made.t_s, made.world_from_body, heard.truth, Alignment.ALIGNED)
    return float(np.median(errors))


def _row(world: str, found: Sequence[Numbers]) -> Row:
    scales = dict(zip(SCALE_COLUMNS, _of_scales(found), strict=True))
    maps = dict(zip(MAP_COLUMNS, _of_maps(found), strict=True))
    return {"world": world, **scales, **maps}


def _of_scales(found: Sequence[Numbers]) -> list[object]:
    true, scale, sigma, used = (_column(found, name) for name in ("true", "scale", "sigma", "used"))
    known = np.isfinite(sigma)
    before, after = 1.0 / true - 1.0, used / true - 1.0
    better = (np.abs(after) < np.abs(before)).astype(float)
    normalised = ((scale - true) / sigma)[known] ** 2
    return [
        len(found), int((~known).sum()), 100 * _rms(before), 100 * _rms(after),
        float(normalised.mean()) if known.any() else None,
        float(better.mean()), *_interval(better, np.mean),
    ]  # fmt: skip


def _of_maps(found: Sequence[Numbers]) -> list[object]:
    errors_m = [_column(found, f"map error, {name}") for name in ("claimed", "measured", "true")]
    ratio = errors_m[1] / errors_m[0]
    medians = [float(np.median(values)) for values in (*errors_m, ratio)]
    return [len(found), *medians, *_interval(ratio, np.median)]


def _column(found: Sequence[Numbers], name: str) -> F64:
    return np.array([numbers[name] for numbers in found])


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _interval(values: F64, statistic: Callable[[F64], Any]) -> tuple[float, float]:
    each = [values[k : k + 1] for k in range(len(values))]
    return interval(each, lambda some: float(statistic(some)), np.random.default_rng(0))


def _page(
    rows: list[Row], worlds: dict[str, list[Numbers]], walks: Sequence[SimulatedWalk]
) -> Page:
    sharpness, changes = walks_panels(walks)
    estimates = estimates_figure(_estimates(worlds))
    panels = [
        focus_panel(walks[0]),
        sharpness,
        Panel("Measured against true", estimates, ESTIMATES_NOTE),
        changes,
        Panel("Scale of the walks", rows_table(_part(rows, SCALE_COLUMNS)), wide=True),
        Panel("Maps", rows_table(_part(rows, MAP_COLUMNS)), MAPS_NOTE, wide=True),
    ]
    subtitle = f"{len(walks)} simulated walks of {walks[0].rounds} rounds, {walks[0].kind}"
    return Page("How long the steps are, told by echoes", subtitle, panels)


def _part(rows: Sequence[Row], columns: Sequence[str]) -> list[Row]:
    return [{name: row[name] for name in ("world", *columns)} for row in rows]


def _estimates(worlds: dict[str, list[Numbers]]) -> dict[str, Estimates]:
    """Those that were not refused."""
    known = {
        world: [numbers for numbers in found if np.isfinite(numbers["sigma"])]
        for world, found in worlds.items()
    }
    return {
        world: Estimates(*(_column(found, name) for name in ("true", "scale", "sigma")))
        for world, found in known.items()
    }
