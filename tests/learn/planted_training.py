"""Toy trainings that processes elsewhere find by name."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from elfslam.app.workers.together import Seat
from elfslam.base.arrays import F64
from elfslam.base.values import ECHO_SAMPLES, EchoPairs
from elfslam.learn.loss import nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import pair_loss
from elfslam.learn.ranks import ALONE, Ranks, joined, rows_of_all, shared
from elfslam.learn.resnet import ResNetEncoder
from elfslam.line.feature import BINS

TINY = PretrainParameters(
    steps=6, pairs=8, width=4, warmup_steps=2, learning_rate=3e-3, checkpoint_steps=2
)
Found = tuple[float, dict[str, F64]]
"""A loss, and by name the gradients and statistics."""


def toy_pairs(step: int, *, count: int = 8) -> EchoPairs:
    """Every place has a decaying noise of its own, and both echoes are that plus a little more."""
    generator = np.random.default_rng([9, step])
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 600)
    place, one, other = generator.standard_normal((3, count, ECHO_SAMPLES)) * decay
    return EchoPairs(
        first=place + 0.3 * one,
        second=place + 0.3 * other,
        room=np.arange(count) % 2,
        xy_m=generator.uniform(0, 20, (count, 2)),
    )


def toy_network(kind: str) -> nn.Module:
    torch.manual_seed(4)
    network = ResNetEncoder() if kind == "resnet18" else CompactEncoder(4)
    return network.train()


def one_step(seat: Seat, *, kind: str, precision: str) -> None:
    """Tells the loss, gradients and statistics of this rank's part of one batch."""
    torch.set_num_threads(1)
    ranks = Ranks(seat.number, seat.count)
    with joined(ranks, seat.meeting):
        seat.tell(stepped(seat.part_of(0), kind, precision, ranks))


def stepped(batch: EchoPairs, kind: str, precision: str, ranks: Ranks = ALONE) -> Found:
    exact = precision == "double"
    network = toy_network(kind).double() if exact else toy_network(kind)
    learning = shared(network, ranks)  # as long as it is held, gradients are those of all
    loss = exact_loss(learning, batch, ranks) if exact else pair_loss(learning, batch, TINY, ranks)
    loss.backward()
    found = {name: value.grad for name, value in network.named_parameters()}
    found |= {name: value for name, value in network.named_buffers() if "running" in name}
    return float(loss.detach()), {
        name: value.double().numpy() for name, value in found.items() if value is not None
    }


def exact_loss(network: nn.Module, batch: EchoPairs, ranks: Ranks) -> Tensor:
    """NT-Xent alone, in double precision."""
    both = torch.from_numpy(np.concatenate([batch.first, batch.second]).astype(np.float64))
    rows = rows_of_all(network(both, torch.zeros(BINS, dtype=torch.float64)), ranks)
    first, second = (half.flatten(0, 1) for half in rows.chunk(2, dim=1))
    return nt_xent(first, second, torch.zeros(len(first), len(first), dtype=torch.bool), 0.07)


def die_in_training(
    seat: Seat, *, do: Callable[[Seat], None], folder: Path, number: int, step: int, times: int
) -> None:
    """`do`, but one trainer kills itself when it asks for a step, so many times."""
    asked = seat.part_of

    def part_of(wanted: int) -> object:
        deaths = len(list(folder.glob("death-*")))
        if wanted == step and seat.number == number and deaths < times:
            (folder / f"death-{deaths}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return asked(wanted)

    seat.part_of = part_of  # type: ignore[method-assign]
    do(seat)
