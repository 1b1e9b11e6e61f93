"""Acoustic odometry: is a walk of better scale when the echoes say how long the steps are?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Chirp, Echoes, Features, Odometry, Truth
from elfslam.line.acoustic_odometry import (
    AcousticOdometryParameters,
    ScaleEstimate,
    measure_scale,
    rescaled,
    scale_evidence,
    with_prior,
)
from elfslam.line.chirp import make_chirp
from elfslam.line.closure import find_closures
from elfslam.line.feature import extract_features, load_encoder
from elfslam.line.graph import build_graph, optimise
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.score.alignment import match
from elfslam.score.bootstrap import interval
from elfslam.score.errors import Alignment, path_length_m, position_errors
from elfslam.score.page import Page, Panel, rows_table
from elfslam.score.scale_figures import (
    Estimates,
    Picture,
    bundles_figure,
    estimates_figure,
    pictures_figure,
)
from elfslam.slam import Parameters, hear, walk_nodes
from elfslam.studies.finding import Announce, Finding, Row
from elfslam.studies.repeats import Numbers, finished
from elfslam.studies.walls_in_focus import RATIOS, picture, range_changes
from elfslam.world.simulate import load_world, simulate

SEEDS = {
    "studio": range(110, 120),
    "lounge": range(110, 120),
    "concourse": range(110, 120),
    "living_room": range(10),
    "office": range(10),
    "mall": range(10),
}
"""The first three worlds are those of development, but these walks in them were not looked at."""
LARGE = ("concourse", "mall")
LARGE_MAPPED = 3
ROUNDS = 5
PEOPLE_SIGMA = 0.06
"""How far true and claimed steps of people are apart without sound."""
BUNDLED_ROUNDS = 3
BUNDLED_SEEDS = 4


@dataclass(frozen=True)
class Walk:
    """A simulated walk, and whether it is mapped too (closing loops takes long in large worlds)."""

    world: str
    seed: int
    rounds: int = ROUNDS
    mapped: bool = True


@dataclass(frozen=True, eq=False)
class Heard:
    """What the line has of a walk, and the truth."""

    nodes: Odometry
    echoes: Echoes
    chirp: Chirp
    truth: Truth


WALKS = tuple(
    Walk(world, seed, mapped=world not in LARGE or seed - seeds[0] < LARGE_MAPPED)
    for world, seeds in SEEDS.items()
    for seed in seeds
)


def measure_acoustic_odometry(
    data: Path | None,
    announce: Announce,
    kept: Path | None = None,
    *,
    walks: Sequence[Walk] = WALKS,
) -> Finding:
    """A row per world: error of scale and of the map, with steps as claimed and as measured.

    `data` is not needed.
    """
    numbers = finished(measure_walk, walks, announce, kept=kept, workers=1)
    worlds = list(dict.fromkeys(walk.world for walk in walks))
    by_world = {
        world: [found for walk, found in zip(walks, numbers, strict=True) if walk.world == world]
        for world in worlds
    }
    rows = [_row(world, found) for world, found in by_world.items()]
    rows.append(_row("all", numbers))
    announce("pictures", None)
    return Finding(rows, _page(rows, by_world, walks))


def hear_walk(walk: Walk) -> Heard:
    """A walk as the line hears it."""
    recording, truth = simulate(load_world(walk.world), walk.seed, rounds=walk.rounds)
    assert recording.audio is not None
    parameters = Parameters()
    chirp = make_chirp(parameters.chirp, recording.audio.rate_hz)
    nodes = walk_nodes(recording, parameters)
    return Heard(nodes, hear(recording, parameters), chirp, truth)


def measure_walk(walk: Walk) -> Numbers:
    """True and measured scale, and the map error with steps as claimed, as measured and as true."""
    heard = hear_walk(walk)
    true = true_scale(heard.nodes, heard.truth)
    found = measure_scale(heard.echoes, heard.nodes, heard.chirp, AcousticOdometryParameters())
    used = with_prior(found, PEOPLE_SIGMA)
    numbers = {"true": true, "scale": found.scale, "sigma": found.sigma, "used": used.scale}
    if not walk.mapped:
        return numbers
    features = extract_features(heard.echoes, load_encoder("compact"))
    tried = {"claimed": 1.0, "measured": used.scale, "true": true}
    errors_m = {
        f"map error, {name}": _map_error_m(heard, features, ScaleEstimate(scale, 0.0))
        for name, scale in tried.items()
    }
    return numbers | errors_m


def true_scale(nodes: Odometry, truth: Truth) -> float:
    """True over claimed length of a walk, both from footstep to footstep."""
    matched = match(nodes.t_s, nodes.world_from_body, truth)
    return path_length_m(matched.truth[:, :2]) / path_length_m(matched.estimate[:, :2])


def _map_error_m(heard: Heard, features: Features, estimate: ScaleEstimate) -> float:
    """Median aligned error of the map from steps of this scale."""
    nodes, parameters = rescaled(heard.nodes, estimate), Parameters()
    closures = find_closures(echo_sequence_similarity(features, nodes), nodes, parameters.closure)
    made = optimise(build_graph(nodes, closures), nodes.t_s, parameters.graph)
    errors = position_errors(made.t_s, made.world_from_body, heard.truth, Alignment.ALIGNED)
    return float(np.median(errors))


def _row(world: str, found: Sequence[Numbers]) -> Row:
    true, scale, sigma, used = (_column(found, name) for name in ("true", "scale", "sigma", "used"))
    known = np.isfinite(sigma)
    before, after = 1.0 / true - 1.0, used / true - 1.0
    better = (np.abs(after) < np.abs(before)).astype(float)
    claimed, measured, ideal = (
        _column(found, f"map error, {name}") for name in ("claimed", "measured", "true")
    )
    ratio = measured / claimed
    low, high = _interval(better, np.mean)
    ratio_low, ratio_high = _interval(ratio, np.median)
    return {
        "world": world,
        "walks": len(found),
        "refused": int((~known).sum()),
        "scale error as claimed (%, rms)": 100 * _rms(before),
        "measured (%, rms)": 100 * _rms(after),
        "normalised error squared": _mean_or_none(((scale - true) / sigma)[known] ** 2),
        "improved": float(better.mean()),
        "improved, from": low,
        "improved, to": high,
        "map error as claimed (m)": float(np.median(claimed)),
        "map error as measured (m)": float(np.median(measured)),
        "map error, true scale (m)": float(np.median(ideal)),
        "ratio of map errors": float(np.median(ratio)),
        "ratio, from": ratio_low,
        "ratio, to": ratio_high,
    }


def _column(found: Sequence[Numbers], name: str) -> F64:
    return np.array([numbers[name] for numbers in found])


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mean_or_none(values: F64) -> float | None:
    return float(values.mean()) if len(values) else None


def _interval(values: F64, statistic: Callable[[F64], Any]) -> tuple[float, float]:
    each = [values[k : k + 1] for k in range(len(values))]
    return interval(each, lambda some: float(statistic(some)), np.random.default_rng(0))


def _page(rows: list[Row], by_world: dict[str, list[Numbers]], walks: Sequence[Walk]) -> Page:
    bundled = [Walk(w, s, BUNDLED_ROUNDS) for w, s in _first_of_each(walks)]
    sharpness: dict[str, list[tuple[F64, F64]]] = {}
    changes: dict[str, list[tuple[F64, F64]]] = {}
    for walk in bundled:
        heard = hear_walk(walk)
        true = true_scale(heard.nodes, heard.truth)
        sharpness.setdefault(walk.world, []).append(_sharpness(heard, true))
        alike = range_changes(heard.echoes, heard.nodes, heard.chirp, true)
        changes.setdefault(walk.world, []).append((RATIOS, alike))
    focus = _in_focus(hear_walk(bundled[0]))
    return Page(
        "How long the steps are, told by echoes",
        f"{len(walks)} simulated walks of {walks[0].rounds} rounds",
        [
            Panel("Walls in and out of focus", pictures_figure(focus), FOCUS_NOTE, wide=True),
            Panel(
                "Sharpness of the walls at every scale",
                bundles_figure(sharpness, "trial scale over the true one", "sharpness", [1.0]),
                "Each line is a walk, its best is 1. All are sharpest where the scale is true.",
            ),
            Panel("Measured against true", estimates_figure(_estimates(by_world)), ESTIMATES_NOTE),
            Panel(
                "What two frames alone tell",
                bundles_figure(changes, "change of range over the true move", "likeness", [-1, 1]),
                CHANGES_NOTE,
                wide=True,
            ),
            Panel("Figures", rows_table(rows), wide=True),
        ],
    )


FOCUS_NOTE = (
    "Six seconds of one walk. The frames are added up along the delays that a wall at each "
    "direction and distance would give: walls are spots, sharp where the steps have the true "
    "length and smeared where they are 15 % too long."
)
ESTIMATES_NOTE = (
    "Dots are walks with two standard errors. The dashed line is what is believed without sound."
)
CHANGES_NOTE = (
    "How alike frames 0.3 s apart are when one is put back: no path can change by more than the "
    "move, there and back, so likeness ends at the dotted lines. How steeply depends on the room, "
    "which is why the edge alone does not measure steps."
)


def _first_of_each(walks: Sequence[Walk]) -> list[tuple[str, int]]:
    """World and seed of the first few walks in each world."""
    seeds: dict[str, list[int]] = {}
    for walk in walks:
        seeds.setdefault(walk.world, []).append(walk.seed)
    return [(world, seed) for world, some in seeds.items() for seed in some[:BUNDLED_SEEDS]]


def _sharpness(heard: Heard, true: float) -> tuple[F64, F64]:
    parameters = AcousticOdometryParameters()
    found = scale_evidence(heard.echoes, heard.nodes, heard.chirp, parameters)
    overall = found.sharpness.mean(axis=0)
    return found.scales / true, np.exp(overall - overall.max())


def _in_focus(heard: Heard) -> dict[str, Picture]:
    true = true_scale(heard.nodes, heard.truth)
    named = {"steps 15 % too short": 0.85, "true steps": 1.0, "steps 15 % too long": 1.15}
    return {
        name: picture(heard.echoes, heard.nodes, heard.chirp, factor * true, which=2)
        for name, factor in named.items()
    }


def _estimates(by_world: dict[str, list[Numbers]]) -> dict[str, Estimates]:
    known = {
        world: [numbers for numbers in found if np.isfinite(numbers["sigma"])]
        for world, found in by_world.items()
    }
    return {
        world: Estimates(*(_column(found, name) for name in ("true", "scale", "sigma")))
        for world, found in known.items()
        if found
    }
