"""What calibration to the phone is worth: one phone maps a place, another is heard there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.geometry import interpolate_poses, wrap_angle
from elfslam.base.progress import Announce
from elfslam.base.values import Echoes
from elfslam.line.feature import (
    Encoder,
    calibrated,
    extract_features,
    load_encoder,
    mean_log_spectrum,
)
from elfslam.line.similarity import footstep_means
from elfslam.scoring.bootstrap import interval
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.front_end import hear, walk_nodes
from elfslam.slam.parameters import Parameters
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import load_world, simulate
from studies.elf import ELSEWHERE_M, SAME_M, SAME_RAD
from studies.figures.intervals import shares_figure
from studies.figures.separation import histograms, recall_at
from studies.finding import Finding, Row

WORLDS = ("studio", "lounge")
"""For development: the worlds of evaluation stay unheard."""
SEEDS = tuple(range(110, 130))
STRANGER = 500
"""Added to the seed of a map for the person who is heard in it."""
ROUNDS = 2
MAPPED_BY = "simulated phone"
PHONES = ("simulated phone", "rippled", "cheap", "tablet", "bottom-fired")
PLAIN, SHORT, WHOLE = KINDS = ("plain", "by 0.6 s", "calibrated")
SHORT_ECHOES = 6
"""As many as one fix has."""
FALSE_SHARE = 0.01
NOTE = "Recall at 1 % false positives, with its 95 % interval over walks."


@dataclass(frozen=True, eq=False)
class Walk:
    """What a phone heard on a walk, and where: a pose for each of its footsteps with an echo."""

    echoes: Echoes
    footsteps_t_s: F64
    heard: Bool
    poses: F64


Counts = dict[str, list[F64]]
"""Histograms (2, 4000) of each pair of walks, by kind."""


def measure_calibration(
    data: Path | None,
    announce: Announce,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    phones: Sequence[str] = PHONES,
    rounds: int = ROUNDS,
    encoders: Mapping[str, Encoder] | None = None,
) -> Finding:
    """A row per world, encoder and phone: single footsteps known again, without and with it.

    Each kind's figure is the recall at 1 % false positives, and `gain` what calibration adds to it.
    `encoders` are measured by name, by default the shipped one; `data` is not needed.
    """
    measured = encoders or {"ELF, shipped": load_encoder("compact")}
    rows: list[Row] = []
    for place, world in enumerate(worlds):
        counts: dict[tuple[str, str], Counts] = {}
        for k, seed in enumerate(seeds):
            announce(f"{world}, walk {seed}", (place + k / len(seeds)) / len(worlds))
            _measure_seed(world, seed, rounds, phones, measured, counts)
        rows += [
            {"world": world, "encoder": name, "phone": phone, **_row(counts[name, phone])}
            for name in measured
            for phone in phones
        ]
    return Finding(rows, _page(rows))


def _measure_seed(
    world: str,
    seed: int,
    rounds: int,
    phones: Sequence[str],
    encoders: Mapping[str, Encoder],
    counts: dict[tuple[str, str], Counts],
) -> None:
    """Append the histograms of one map and of each phone heard in it."""
    mapped = _walk(world, seed, rounds, MAPPED_BY)
    known = {name: _means(mapped, encoder) for name, encoder in encoders.items()}
    for phone in phones:
        query = _walk(world, seed + STRANGER, rounds, phone)
        same, elsewhere = pairs_of(mapped.poses, query.poses)
        for name, encoder in encoders.items():
            for kind in KINDS:
                scores = known[name] @ _means(query, _for(kind, encoder, mapped, query)).T
                made = histograms(scores[same], scores[elsewhere])
                counts.setdefault((name, phone), {}).setdefault(kind, []).append(made)


def pairs_of(mapped: F64, query: F64) -> tuple[Bool, Bool]:
    """Which poses (n, 3) and (m, 3) of two walks are of one place, and which elsewhere (n, m)."""
    distance_m = np.linalg.norm(mapped[:, None, :2] - query[None, :, :2], axis=2)
    turn_rad = np.abs(wrap_angle(mapped[:, None, 2] - query[None, :, 2]))
    return (distance_m < SAME_M) & (turn_rad < SAME_RAD), distance_m > ELSEWHERE_M


def _walk(world: str, seed: int, rounds: int, phone: str) -> Walk:
    """A simulated walk with this phone."""
    today = Circumstances(device=phone)
    recording, truth = simulate(load_world(world), seed, rounds=rounds, circumstances=today)
    nodes = walk_nodes(recording, Parameters())
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    poses = interpolate_poses(truth.t_s, truth.world_from_body, middle_s)
    echoes = hear(recording, Parameters())
    heard = np.histogram(echoes.t_s, nodes.t_s)[0] > 0
    return Walk(echoes, nodes.t_s, heard, poses[heard])


def _means(walk: Walk, encoder: Encoder) -> F32:
    """The mean ELF of every footstep that has an echo."""
    return footstep_means(extract_features(walk.echoes, encoder), walk.footsteps_t_s)[walk.heard]


def _for(kind: str, encoder: Encoder, mapped: Walk, query: Walk) -> Encoder:
    """The encoder of the query: as it is, or calibrated by six of its echoes or by all."""
    if kind == PLAIN:
        return encoder
    echoes = query.echoes if kind == WHOLE else _some_of(query.echoes)
    return calibrated(encoder, echoes, mean_log_spectrum(mapped.echoes.samples))


def _some_of(echoes: Echoes) -> Echoes:
    """Six echoes from the middle of a walk."""
    rows = slice(len(echoes.t_s) // 2, len(echoes.t_s) // 2 + SHORT_ECHOES)
    kept = {name: getattr(echoes, name)[rows] for name in ("t_s", "samples", "snr_db")}
    return replace(echoes, **kept)


def _row(counts: Counts) -> Row:
    row: Row = {"walks": len(counts[PLAIN])}
    for kind in KINDS:
        each = [made[None] for made in counts[kind]]
        row |= _measured(kind, each, _recall)
    each = [np.stack(pair)[None] for pair in zip(counts[PLAIN], counts[WHOLE], strict=True)]
    return row | _measured("gain", each, lambda some: _recall(some[:, 1]) - _recall(some[:, 0]))


def _recall(walks: F64) -> float:
    """Of the pooled histograms (walks, 2, 4000)."""
    return recall_at(walks.sum(axis=0), FALSE_SHARE)


def _measured(name: str, walks: Sequence[F64], measure: Callable[[F64], float]) -> Row:
    """The measure of all walks, with its interval."""
    low, high = interval(walks, measure, np.random.default_rng(0))
    value = round(measure(np.concatenate(walks)), 3)
    return {name: value, f"{name}, 95 %": f"{low:.3f} to {high:.3f}"}


def _page(rows: Sequence[Row]) -> Page:
    """A panel for each world and encoder, and the table."""
    cases: dict[str, list[Row]] = {}
    for row in rows:
        cases.setdefault(f"{row['world']}: {row['encoder']}", []).append(row)
    panels = []
    for title, some in cases.items():
        figure = shares_figure([str(row["phone"]) for row in some], _series(some), "recall")
        panels.append(Panel(title, figure, NOTE))
    panels.append(Panel("In figures", rows_table(rows), wide=True))
    subtitle = f"Footsteps of two people: a map by the {MAPPED_BY}, and each phone heard in it"
    return Page("Calibration to the phone", subtitle, panels)


def _series(rows: Sequence[Row]) -> dict[str, F64]:
    """Value, low and high (rows, 3) by kind."""
    return {
        kind: np.array(
            [[row[kind], *str(row[f"{kind}, 95 %"]).split(" to ")] for row in rows], np.float64
        )
        for kind in KINDS
    }
