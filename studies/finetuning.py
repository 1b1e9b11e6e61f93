"""What fine-tuning on the walk itself is worth: known places, closures and the map's error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elfslam.app.map import finetuned
from elfslam.base.arrays import F64
from elfslam.base.values import Run, Truth, silent
from elfslam.learn.parameters import FinetuneParameters
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.feature import Encoder, load_encoder
from elfslam.world.kinds import SURVEYOR, Kind
from studies.cached import SCENARIOS, SimulatedWalk, simulated
from studies.elf import histograms, labelled_pairs, separation_records
from studies.results import Record, mean_of, seeds_text
from studies.study import Study, StudyContext

WORLDS = ("studio", "lounge")
"""For development: those of evaluation stay unseen."""
SEEDS = (100, 101, 102, 103, 104, 105)
ROUNDS = 5
BEFORE, AFTER = "ELF pre-trained", "ELF fine-tuned"
ERROR, CLOSURES = "median error, aligned (m)", "closures"


@dataclass
class Walks:
    """Histograms of pairs, numbers of closures and median errors (m) by one encoder."""

    counts: list[F64] = field(default_factory=list)
    closures: list[float] = field(default_factory=list)
    error_m: list[float] = field(default_factory=list)

    def add(self, run: Run, truth: Truth, rounds: int) -> None:
        """The numbers of one more walk."""
        same, elsewhere = labelled_pairs(run.odometry, truth, rounds)
        scores = run.similarity.scores
        self.counts.append(histograms(scores[same], scores[elsewhere]))
        self.closures.append(len(run.closures.i))
        self.error_m.append(median_error_m(run, truth))


def measure_finetuning(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    encoder: str = "compact",
    parameters: FinetuneParameters | None = None,
    kind: Kind = SURVEYOR,
) -> list[Record]:
    """Separation of places, closures and map error by world, before and after."""
    known, pretrained = parameters or FinetuneParameters(), load_encoder(encoder)
    records: list[Record] = []
    for place, world in enumerate(worlds):
        collected = {BEFORE: Walks(), AFTER: Walks()}
        for k, seed in enumerate(seeds):
            context.announce(f"{world}, walk {seed}", (place + k / len(seeds)) / len(worlds))
            walk = SimulatedWalk(world, seed, rounds, kind.name)
            _measure_walk(walk, pretrained, known, collected)
        of = Record("", world=world, scenario=SCENARIOS[kind.name],
                    seeds=seeds_text(seeds))  # fmt: skip
        for name, walks in collected.items():
            records += _records(replace(of, method=name), walks)
    return records


def _measure_walk(
    walk: SimulatedWalk,
    encoder: Encoder,
    parameters: FinetuneParameters,
    collected: Mapping[str, Walks],
) -> None:
    recording, truth = simulated(walk)
    before = map_by_echoes(recording, encoder, Parameters())
    assert before.echoes is not None
    learnt = finetuned(encoder, before.echoes, parameters, walk.seed, silent).encoder
    after = map_by_echoes(recording, encoder, Parameters(), adapt=lambda *_: learnt)
    collected[BEFORE].add(before, truth, walk.rounds)
    collected[AFTER].add(after, truth, walk.rounds)


def median_error_m(run: Run, truth: Truth) -> float:
    """The median error of a map that is laid on the truth as well as it can be."""
    poses = run.trajectory.world_from_body
    return float(np.median(position_errors(run.trajectory.t_s, poses, truth, Alignment.ALIGNED)))


def _records(of: Record, walks: Walks) -> list[Record]:
    return [
        *separation_records(walks.counts, ClosureParameters().threshold, of),
        mean_of(replace(of, metric=CLOSURES), walks.closures),
        mean_of(replace(of, metric=ERROR), walks.error_m),
    ]


STUDY = Study(
    "What is fine-tuning on the walk itself worth?",
    measure_finetuning, minutes=20, scenarios=("surveyor",), needs=("torch",),
    fast={"worlds": ("studio",), "seeds": (100,), "parameters": FinetuneParameters(steps=5)},
)  # fmt: skip
