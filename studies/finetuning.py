"""What fine-tuning on the walk itself is worth: known places, closures and the map's error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from elfslam.app.map import finetuned
from elfslam.base.arrays import F64
from elfslam.base.values import Run, Truth
from elfslam.learn.parameters import FinetuneParameters
from elfslam.line.closure import ClosureParameters
from elfslam.line.feature import Encoder, load_encoder
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import SURVEYOR, Kind
from studies.elf import labelled_pairs
from studies.figures.separation import histograms, separation_row
from studies.finding import Given, Row
from studies.intervals import mean_range
from studies.simulated_walk import SimulatedWalk, simulated

WORLDS = ("studio", "lounge")
"""For development: the worlds of evaluation stay unheard."""
SEEDS = (100, 101, 102, 103, 104, 105)
ROUNDS = 5
ENCODERS = ("pre-trained", "fine-tuned")


@dataclass
class Walks:
    """Histograms, closures and median aligned errors (m) of one encoder, walk by walk."""

    counts: list[F64] = field(default_factory=list)
    closures: list[int] = field(default_factory=list)
    error_m: list[float] = field(default_factory=list)


def measure_finetuning(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    encoder: str = "compact",
    parameters: FinetuneParameters | None = None,
    kind: Kind = SURVEYOR,
) -> list[Row]:
    """A row per world and encoder, before and after."""
    known, pretrained = parameters or FinetuneParameters(), load_encoder(encoder)
    rows: list[Row] = []
    for place, world in enumerate(worlds):
        collected = {name: Walks() for name in ENCODERS}
        for k, seed in enumerate(seeds):
            given.announce(f"{world}, walk {seed}", (place + k / len(seeds)) / len(worlds))
            _measure_walk(
                SimulatedWalk(world, seed, rounds, kind.name), pretrained, known, collected
            )
        rows += [_row(world, name, walks) for name, walks in collected.items()]
    return rows


def _measure_walk(
    walk: SimulatedWalk,
    encoder: Encoder,
    parameters: FinetuneParameters,
    collected: dict[str, Walks],
) -> None:
    recording, truth = simulated(walk)
    before = map_by_echoes(recording, encoder, Parameters())
    assert before.echoes is not None
    learnt = finetuned(
        encoder, before.echoes, parameters, walk.seed, lambda what, share: None
    ).encoder
    after = map_by_echoes(recording, encoder, Parameters(), adapt=lambda *_: learnt)
    for name, run in zip(ENCODERS, (before, after), strict=True):
        _collect(collected[name], run, truth, walk.rounds)


def _collect(walks: Walks, run: Run, truth: Truth, rounds: int) -> None:
    same, elsewhere = labelled_pairs(run.odometry, truth, rounds)
    scores, poses = run.similarity.scores, run.trajectory.world_from_body
    errors_m = position_errors(run.trajectory.t_s, poses, truth, Alignment.ALIGNED)
    walks.counts.append(histograms(scores[same], scores[elsewhere]))
    walks.closures.append(len(run.closures.i))
    walks.error_m.append(float(np.median(errors_m)))


def _row(world: str, name: str, walks: Walks) -> Row:
    low, high = mean_range(walks.error_m)
    return {
        "world": world,
        "encoder": name,
        **separation_row(walks.counts, ClosureParameters().threshold),
        "closures": round(float(np.mean(walks.closures)), 1),
        "median error, aligned (m)": round(float(np.mean(walks.error_m)), 3),
        "error, 95 %": f"{low:.3f} to {high:.3f}",
    }
