"""Toy trainings, also as programs: `planted_training.py WHAT FILE`."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from elfslam.base.arrays import F64
from elfslam.base.values import ECHO_SAMPLES, EchoPairs
from elfslam.learn.distributed import (
    ALONE,
    Ranks,
    joined,
    norms_of_all,
    rows_of_all,
    shares,
    sum_gradients,
)
from elfslam.learn.loss import nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import TrainingProgress, pretrain
from elfslam.learn.resumable import prefetched

TINY = PretrainParameters(
    steps=6, pairs=8, width=4, warmup_steps=2, learning_rate=3e-3, checkpoint_steps=2
)
STEP = 3
"""Of the batch whose gradients are compared."""


def toy_pairs(step: int, *, count: int = 8, noise: float = 0.3) -> EchoPairs:
    """Every place has a decaying noise of its own, and both echoes are that plus a little more."""
    generator = np.random.default_rng([9, step])
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 600)
    place, one, other = generator.standard_normal((3, count, ECHO_SAMPLES)) * decay
    return EchoPairs(
        first=place + noise * one,
        second=place + noise * other,
        room=np.arange(count) % 2,
        xy_m=generator.uniform(0, 20, (count, 2)),
    )


def traces(count: int, seed: int = 0) -> Tensor:
    """Decaying noise, about as loud as echoes are."""
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 500)
    noise = np.random.default_rng(seed).standard_normal((count, ECHO_SAMPLES))
    return torch.from_numpy((0.01 * noise * decay).astype(np.float32))


def stepped(batch: EchoPairs, ranks: Ranks = ALONE) -> dict[str, F64]:
    """Loss, gradients and statistics of a batch by name, in double precision."""
    torch.set_num_threads(1)
    torch.manual_seed(4)
    network = CompactEncoder(4).double().train()
    norms_of_all(network, ranks)
    loss = exact_loss(network, batch, ranks)
    (loss / ranks.count).backward()  # type: ignore[no-untyped-call]
    sum_gradients(network, ranks)
    found = {name: value.grad for name, value in network.named_parameters()}
    found |= {name: value for name, value in network.named_buffers() if "running" in name}
    return {"loss": loss.detach().numpy()} | {
        name: value.numpy() for name, value in found.items() if value is not None
    }


def exact_loss(network: nn.Module, batch: EchoPairs, ranks: Ranks) -> Tensor:
    """NT-Xent alone, in double precision."""
    both = torch.from_numpy(np.concatenate([batch.first, batch.second]).astype(np.float64))
    rows = rows_of_all(network(both), ranks)
    first, second = (half.flatten(0, 1) for half in rows.chunk(2, dim=1))
    return nt_xent(first, second, torch.zeros(len(first), len(first), dtype=torch.bool), 0.07)


def write_step(file: Path) -> None:
    """What one of several finds with its share of a batch; each writes a file of its own."""
    with joined() as ranks:
        ((_, share),) = shares(prefetched, toy_pairs, STEP, STEP + 1, ranks)
        np.savez(file.with_suffix(f".{ranks.number}.npz"), **stepped(share, ranks))


def die_in_training(checkpoint: Path) -> None:
    """A training that is killed after its fifth step; the last checkpoint was after the fourth."""

    def report(progress: TrainingProgress) -> None:
        if progress.step == 5:
            os.kill(os.getpid(), signal.SIGKILL)

    pretrain(toy_pairs, TINY, seed=0, checkpoint=checkpoint, report=report)


if __name__ == "__main__":
    {"step": write_step, "die": die_in_training}[sys.argv[1]](Path(sys.argv[2]))
