"""Training by several processes of this machine, each a rank; one that dies is started again."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from elfslam.app.workers.together import Seat, Work, together
from elfslam.base.errors import ParameterError, WorkerError
from elfslam.base.values import EchoPairs
from elfslam.learn import floor_level as floor
from elfslam.learn.floor_level import EchoesOf, FloorLevel, FloorStart, SpotEchoes
from elfslam.learn.parameters import FloorLevelParameters, PretrainParameters
from elfslam.learn.pretrain import (
    PairsOf,
    Pretrained,
    Progress,
    arithmetic_of,
    pretrain,
    so_far,
    training_device,
)
from elfslam.learn.ranks import Ranks, joined
from elfslam.learn.resumable import Stream, prefetched
from elfslam.line.feature import OnnxEncoder

Rows = TypeVar("Rows", EchoPairs, SpotEchoes)


def pretrain_by_several(
    pairs_of: PairsOf,
    parameters: PretrainParameters,
    *,
    trainers: int,
    seed: int,
    checkpoint: Path,
    report: Callable[[Progress], None],
    stream: Stream = prefetched,
) -> Pretrained:
    """What `pretrain` gives, by `trainers` processes that share each batch and its loss.

    But for rounding it is the same training. `stream` makes the batches in this process. A trainer
    that dies costs what was done since the last checkpoint, and changes no bit of the result.
    Raises ParameterError where a batch cannot be shared out evenly, WorkerError where trainers
    die again and again, StoreError for a checkpoint of another run.
    """
    check_trainers(parameters, trainers)
    device, ranks = training_device(has_gpu=torch.cuda.is_available()), Ranks(0, trainers)
    so_far(parameters, seed, checkpoint, device, ranks)  # fails now, not in each of them
    do = partial(
        _pretrain, parameters=parameters, seed=seed, checkpoint=checkpoint,
        torch_version=torch.__version__,
    )  # fmt: skip
    work = Work(do, partial(_batches, stream, pairs_of, parameters.steps), part_of)
    together(work, trainers, hear=report)
    network, _, losses = so_far(parameters, seed, checkpoint, device, ranks)
    return Pretrained(network.cpu().eval(), np.array(losses), arithmetic_of(device, ranks))


def learn_floor_by_several(
    encoder: OnnxEncoder,
    spots_m: Any,
    echoes_of: EchoesOf,
    parameters: FloorLevelParameters,
    *,
    trainers: int,
    seed: int,
    checkpoint: Path,
    report: Callable[[Progress], None] = lambda progress: None,
    stream: Stream = prefetched,
) -> FloorLevel:
    """What `learn_floor` gives, by `trainers` processes that share each batch, as above."""
    floor.check_part(parameters)
    spots = floor.first_spots(
        encoder, spots_m, echoes_of, parameters, seed, known=checkpoint.exists()
    )
    run = f"{floor.run_of(encoder, spots_m, parameters, seed)}, {trainers} trainers"
    start = FloorStart(encoder.content, spots_m, spots, run)
    heard = 0

    def part(batch: SpotEchoes, number: int, count: int) -> SpotEchoes:
        nonlocal heard
        heard = len(batch.samples)
        return part_of(batch, number, count)

    do = partial(
        _learn_floor, start=start, parameters=parameters, checkpoint=checkpoint,
        torch_version=torch.__version__,
    )  # fmt: skip
    work = Work(do, partial(_batches, stream, echoes_of, parameters.steps), part)
    together(work, trainers, hear=report)
    network, _, losses = floor.so_far(start, parameters, checkpoint)
    return floor.floor_level(encoder, network, losses, heard, parameters, seed)


def check_trainers(parameters: PretrainParameters, trainers: int) -> None:
    """Raise ParameterError where so many cannot share a batch evenly, with two pairs for each."""
    if trainers < 1 or parameters.pairs % trainers or parameters.pairs < 2 * trainers:
        raise ParameterError(
            f"trainers: got {trainers}, wanted a number that pretrain.pairs "
            f"({parameters.pairs}) is a multiple of, two times or more; change one"
        )


def part_of(batch: Rows, number: int, count: int) -> Rows:
    """The rows of a batch that are one trainer's; all have as many.

    Raises ParameterError where that cannot be.
    """
    rows = len(batch.xy_m)
    if rows % count:
        raise ParameterError(f"trainers: got {count} for batches of {rows}, wanted even shares")
    own = slice(number * rows // count, (number + 1) * rows // count)
    return replace(batch, **{each.name: getattr(batch, each.name)[own] for each in fields(batch)})


def _batches(
    stream: Stream, batch_of: Callable[[int], Any], last: int, first: int
) -> Generator[Any]:
    for _, batch in stream(batch_of, first, last):
        yield batch


def _pretrain(
    seat: Seat, *, parameters: PretrainParameters, seed: int, checkpoint: Path, torch_version: str
) -> None:
    """What each trainer does of a pre-training."""
    check_torch(torch_version)
    ranks = Ranks(seat.number, seat.count)
    with joined(ranks, seat.meeting):
        pretrain(
            seat.part_of, parameters, seed=seed, checkpoint=checkpoint, report=_told_by(seat),
            ranks=ranks, kept=seat.keep,
        )  # fmt: skip


def _learn_floor(
    seat: Seat,
    *,
    start: FloorStart,
    parameters: FloorLevelParameters,
    checkpoint: Path,
    torch_version: str,
) -> None:
    """What each trainer does of a floor's training."""
    check_torch(torch_version)
    torch.set_num_threads(parameters.threads)
    ranks = Ranks(seat.number, seat.count)
    with joined(ranks, seat.meeting):
        floor.train_floor(
            start, seat.part_of, parameters, checkpoint=checkpoint, report=_told_by(seat),
            ranks=ranks, kept=seat.keep,
        )  # fmt: skip


def _told_by(seat: Seat) -> Callable[[Progress], None]:
    """All trainers know the same loss: the first tells it."""
    return seat.tell if seat.number == 0 else lambda progress: None


def check_torch(wanted: str) -> None:
    """Raise WorkerError where PyTorch is of another version than where the work came from."""
    if torch.__version__ != wanted:
        raise WorkerError(
            f"trainer: got PyTorch {torch.__version__}, wanted {wanted}; "
            "install the same version there"
        )
