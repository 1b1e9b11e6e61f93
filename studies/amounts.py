"""How much must be heard: echoes of pre-training, minutes of a walk, and the loss with and without.

After the paper's figures on pre-training and fine-tuning data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.app.map import finetuned
from elfslam.app.workers import silent_elsewhere
from elfslam.base.progress import Announce
from elfslam.base.values import Echoes, Recording, Run, Truth
from elfslam.learn.parameters import FinetuneParameters, PretrainParameters, ScratchParameters
from elfslam.line.feature import Encoder, OnnxEncoder, load_encoder
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.front_end import hear
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import SURVEYOR, Kind
from studies.elf import labelled_pairs
from studies.figures.curves import Curve, curves_figure
from studies.figures.separation import histograms, recall_at
from studies.finding import Finding, Given, Row
from studies.intervals import curve_of, mean_row
from studies.repeats import Numbers, finished
from studies.simulated_walk import SimulatedWalk, simulated

ECHOES = (20_480, 61_440, 204_800, 614_400, 1_024_000)
MINUTES = (1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
WORLDS = ("studio", "lounge")
SEEDS = (100, 101, 102)
ROUNDS = 5
LONG_ROUNDS = 30
"""About ten minutes in the worlds above."""
ERROR, RECALL = "median error, aligned (m)", "recall at 1 %"
PRETRAINED, FINETUNED = "echoes of pre-training", "minutes of fine-tuning"


@dataclass(frozen=True)
class TrainedWalk:
    """A simulated walk and how much the encoder that maps it has heard."""

    varied: str
    amount: float
    walk: SimulatedWalk


def measure_amounts(
    given: Given,
    *,
    echoes: Sequence[int] = ECHOES,
    minutes: Sequence[float] = MINUTES,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    long_rounds: int = LONG_ROUNDS,
    kind: Kind = SURVEYOR,
) -> Finding:
    """Map error and recall against both amounts, and losses from random and trained weights.

    Encoders of so many echoes are trained by the recipe of the shipped one and kept beside `kept`.
    """
    walks = [SimulatedWalk(w, seed, ROUNDS, kind.name) for w in worlds for seed in seeds]
    long = [SimulatedWalk(w, seeds[0], long_rounds, kind.name) for w in worlds]
    tasks = [TrainedWalk(PRETRAINED, n, walk) for n in echoes for walk in walks]
    tasks += [TrainedWalk(FINETUNED, m, walk) for m in minutes for walk in long]
    folder = None if given.kept is None else given.kept.parent / "encoders"
    measure = partial(_measured, folder=folder, announce=silent_elsewhere(given.announce))
    numbers = finished(measure, tasks, given)
    rows = _rows(tasks, numbers)
    given.announce("losses", None)
    return Finding(rows, _page(rows, _losses(walks[0])))


def _measured(task: TrainedWalk, folder: Path | None, announce: Announce) -> Numbers:
    recording, truth = simulated(task.walk)
    if task.varied == PRETRAINED:
        encoder: Encoder = _trained(int(task.amount), folder, announce)
    else:
        encoder = _learnt(recording, task.amount)
    run = map_by_echoes(recording, encoder, Parameters())
    return {ERROR: _median_error_m(run, truth), RECALL: _recall(run, truth, task.walk.rounds)}


def _trained(echoes: int, folder: Path | None, announce: Announce) -> OnnxEncoder:
    """The encoder of so many echoes, made once where there is a folder to keep it."""
    from elfslam.app.simulated_training import pretrain_on_simulated_echoes

    parameters = PretrainParameters()
    steps = max(echoes // (2 * parameters.pairs), 1)
    file = (folder or Path("encoders")) / f"{echoes}.onnx"
    if not file.exists():
        pretrain_on_simulated_echoes(
            file, replace(parameters, steps=steps), seed=0, announce=announce
        )
    return OnnxEncoder(file.read_bytes(), str(echoes))


def _learnt(recording: Recording, minutes: float) -> Encoder:
    """The shipped encoder, fine-tuned on the first minutes of the walk."""
    shipped, echoes = load_encoder("compact"), hear(recording, Parameters())
    heard = echoes.t_s - echoes.t_s[0] <= 60.0 * minutes
    part = Echoes(echoes.t_s[heard], echoes.samples[heard], echoes.losses_s)
    return finetuned(shipped, part, FinetuneParameters(), 0, lambda what, share: None).encoder


def _median_error_m(run: Run, truth: Truth) -> float:
    poses = run.trajectory.world_from_body
    return float(np.median(position_errors(run.trajectory.t_s, poses, truth, Alignment.ALIGNED)))


def _recall(run: Run, truth: Truth, rounds: int) -> float:
    same, elsewhere = labelled_pairs(run.odometry, truth, rounds)
    scores = run.similarity.scores
    return recall_at(histograms(scores[same], scores[elsewhere]), 0.01)


def _rows(tasks: Sequence[TrainedWalk], numbers: Sequence[Numbers]) -> list[Row]:
    points = dict.fromkeys((task.varied, task.amount) for task in tasks)
    return [
        mean_row(varied, amount, measure, values, "walks")
        for varied, amount in points
        for measure in (ERROR, RECALL)
        if (
            values := [
                found[measure]
                for task, found in zip(tasks, numbers, strict=True)
                if (task.varied, task.amount) == (varied, amount)
            ]
        )
    ]


def _losses(walk: SimulatedWalk) -> dict[str, Curve]:
    """The loss of the paper's fine-tuning, step by step, from random and from trained weights."""
    from studies.paper_training import learnt_from_walk

    echoes, curves = hear(simulated(walk)[0], Parameters()), {}
    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    for name, start in {"random weights": None, "pre-trained": shipped}.items():
        losses: list[float] = []
        learnt_from_walk(echoes, ScratchParameters(), seed=0, start=start, report=losses.append)
        curves[name] = Curve(np.arange(1.0, len(losses) + 1), np.array(losses))
    return curves


def _page(rows: Sequence[Row], losses: dict[str, Curve]) -> Page:
    panels = [
        _panel(rows, varied, measure)
        for varied in (PRETRAINED, FINETUNED)
        for measure in (ERROR, RECALL)
        if any(row["varied"] == varied for row in rows)
    ]
    figure = curves_figure(losses, "step", "NT-Xent")
    panels.append(Panel("Loss on one walk", figure, "The paper's fine-tuning of one walk."))
    panels.append(Panel("Figures", rows_table(list(rows)), wide=True))
    return Page("How much must be heard", "Walks in the development worlds", panels)


def _panel(rows: Sequence[Row], varied: str, measure: str) -> Panel:
    chosen = [row for row in rows if (row["varied"], row["measure"]) == (varied, measure)]
    curve = curve_of(chosen)
    figure = curves_figure({measure: curve}, varied, measure, ticks=curve.x.tolist())
    return Panel(f"{measure} against {varied}", figure, "Band: 95 %, by resampling walks.")
