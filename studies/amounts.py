"""How much training takes: echoes to pre-train, minutes to fine-tune, and the loss of both starts.

After the paper's figures on pre-training and fine-tuning data. Walks are in two worlds of
development together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.app.map import finetuned
from elfslam.app.settings import Settings
from elfslam.app.workers import silent_elsewhere
from elfslam.base.values import Announce, Echoes, Recording, Run, Truth, silent
from elfslam.learn.parameters import FinetuneParameters, PretrainParameters, ScratchParameters
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import Encoder, OnnxEncoder, load_encoder
from elfslam.world.kinds import SURVEYOR, Kind
from studies.cached import SCENARIOS, SimulatedWalk, extract_echoes, simulated
from studies.elf import histograms, labelled_pairs, recall_at
from studies.results import Record, averaged
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, finished, median_aligned_m

WORLDS = ("studio", "lounge")
"""For development: those of evaluation stay unseen."""
ECHOES = (20_480, 61_440, 204_800, 614_400, 1_024_000)
MINUTES = (1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
SEEDS = (100, 101, 102)
ROUNDS = 5
LONG_ROUNDS = 30
"""About ten minutes in these worlds."""
RECALL, LOSS = "recall at 1 % false positives", "NT-Xent loss"
PRETRAINED, FINETUNED = "ELF pre-trained", "ELF fine-tuned"
STARTS = ("ELF without pre-training", PRETRAINED)
EVERY = 10
"""Steps of which a loss is the mean."""
PAPER_M = {
    (PRETRAINED, 614_400): 0.15, (PRETRAINED, 1_024_000): 0.15, (FINETUNED, 2.0): 0.56,
    (FINETUNED, 3.0): 0.15, (FINETUNED, 5.0): 0.15, (FINETUNED, 7.0): 0.15,
    (FINETUNED, 10.0): 0.15,
}  # fmt: skip
"""The median error in the living room: from 600,000 simulated echoes on, and by minutes."""


@dataclass(frozen=True)
class TrainedWalk:
    """A simulated walk, and how much the encoder that maps it has learnt from."""

    method: str
    amount: float
    walk: SimulatedWalk


def measure_amounts(
    context: StudyContext,
    *,
    echoes: Sequence[int] = ECHOES,
    minutes: Sequence[float] = MINUTES,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    long_rounds: int = LONG_ROUNDS,
    kind: Kind = SURVEYOR,
    pretraining: PretrainParameters | None = None,
    scratch: ScratchParameters | None = None,
) -> list[Record]:
    """Map error and recall against both amounts, and losses from random and trained weights.

    Encoders of so many echoes are trained by the recipe of the shipped one and kept beside `kept`.
    """
    walks = [SimulatedWalk(w, seed, rounds, kind.name) for w in worlds for seed in seeds]
    long = [SimulatedWalk(w, seeds[0], long_rounds, kind.name) for w in worlds]
    tasks = [TrainedWalk(PRETRAINED, n, walk) for n in echoes for walk in walks]
    tasks += [TrainedWalk(FINETUNED, m, walk) for m in minutes for walk in long]
    folder = None if context.kept is None else context.kept.parent / "encoders"
    trained = partial(
        _trained, folder=folder, parameters=pretraining or PretrainParameters(),
        announce=silent_elsewhere(context.announce),
    )  # fmt: skip
    measure = partial(_measured, trained=trained)
    found = finished(measure, tasks, context)
    context.announce("losses", None)
    records = [
        *averaged([each for task, each in zip(tasks, found, strict=True)
                   if task.method == PRETRAINED], seeds),
        *averaged([each for task, each in zip(tasks, found, strict=True)
                   if task.method == FINETUNED], seeds[:1]),
        *_losses(walks[0], scratch or ScratchParameters()),
    ]  # fmt: skip
    scenario, both = SCENARIOS[kind.name], ", ".join(worlds)
    return [replace(each, scenario=scenario, world=each.world or both) for each in records]


def _measured(task: TrainedWalk, trained: Callable[[int], Encoder]) -> list[Record]:
    recording, truth = simulated(task.walk)
    if task.method == PRETRAINED:
        encoder = trained(int(task.amount))
        condition = f"{task.amount:.0f} echoes"
    else:
        encoder, condition = _learnt(recording, task.amount), f"{task.amount:g} minutes"
    run = map_by_echoes(recording, encoder, Parameters())
    paper_m = PAPER_M.get((task.method, task.amount))
    error = Record(
        task.method, MEDIAN_ALIGNED, median_aligned_m(run.trajectory, truth), paper=paper_m
    )
    recall = Record(task.method, RECALL, _recall(run, truth, task.walk.rounds))
    return [replace(each, condition=condition) for each in (error, recall)]


def _trained(
    echoes: int, folder: Path | None, parameters: PretrainParameters, announce: Announce
) -> Encoder:
    """The encoder of so many echoes, made once where there is a folder to keep it."""
    from elfslam.app.simulated_training import pretrain_on_simulated_echoes

    steps = max(echoes // (2 * parameters.pairs), 1)
    file = (folder or Path("encoders")) / f"{echoes}.onnx"
    if not file.exists():
        pretrain_on_simulated_echoes(
            file, replace(parameters, steps=steps), seed=0, announce=announce
        )
    return OnnxEncoder(file.read_bytes(), str(echoes))


def _learnt(recording: Recording, minutes: float) -> Encoder:
    """The shipped encoder, fine-tuned on the first minutes of the walk."""
    shipped, echoes = load_encoder("compact"), extract_echoes(recording, Settings())
    early = echoes.t_s - echoes.t_s[0] <= 60.0 * minutes
    part = Echoes(echoes.t_s[early], echoes.samples[early], echoes.losses_s)
    return finetuned(shipped, part, FinetuneParameters(), 0, silent).encoder


def _recall(run: Run, truth: Truth, rounds: int) -> float:
    same, elsewhere = labelled_pairs(run.odometry, truth, rounds)
    scores = run.similarity.scores
    return recall_at(histograms(scores[same], scores[elsewhere]), 0.01)


def _losses(walk: SimulatedWalk, parameters: ScratchParameters) -> list[Record]:
    """The loss of the paper's fine-tuning on one walk, from random and from trained weights."""
    from studies.paper_training import learnt_from_walk

    echoes, shipped = extract_echoes(simulated(walk)[0], Settings()), load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    records: list[Record] = []
    for name, start in zip(STARTS, (None, shipped), strict=True):
        losses: list[float] = []
        learnt_from_walk(echoes, parameters, seed=0, start=start, report=losses.append)
        records += [
            Record(name, LOSS, float(np.mean(losses[k : k + EVERY])), world=walk.world,
                   condition=f"{min(k + EVERY, len(losses))} steps", seeds=str(walk.seed))
            for k in range(0, len(losses), EVERY)
        ]  # fmt: skip
    return records


STUDY = Study(
    "How many echoes and minutes does training take?",
    measure_amounts, minutes=60, scenarios=("surveyor",), needs=("torch",), long=True,
    fast={"echoes": (512,), "minutes": (), "worlds": ("studio",), "seeds": (100,), "rounds": 2,
          "pretraining": PretrainParameters(component_batches=1),
          "scratch": ScratchParameters(steps=20, pairs=32, threads=1)},
)  # fmt: skip
