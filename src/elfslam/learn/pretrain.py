"""Contrastive pre-training: a stream of echo pairs in, a trained encoder out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from elfslam.base.arrays import F64
from elfslam.base.values import EchoPairs
from elfslam.learn.distributed import (
    ALONE,
    Ranks,
    norms_of_all,
    rows_of_all,
    shares,
    start_together,
    sum_gradients,
)
from elfslam.learn.loss import margin_loss, nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.resnet import ResNetEncoder
from elfslam.learn.resumable import Stream, prefetched, resumed, save, warm_cosine

NETWORKS = ("compact", "resnet18")
PairsOf = Callable[[int], EchoPairs]
"""The batch of a step: the same step always gives the same batch, so that a run can resume."""
ARITHMETIC = {"cpu": "float32", "cuda": "bfloat16 on a GPU"}
"""Of the network, by where it is trained."""


@dataclass(frozen=True)
class TrainingProgress:
    """Where the training stands after a step."""

    step: int
    loss: float


@dataclass(frozen=True, eq=False)
class Pretrained:
    """The encoder, the loss of every step (steps), and the arithmetic of the network."""

    network: nn.Module
    losses: F64
    arithmetic: str


def pretrain(
    pairs_of: PairsOf,
    parameters: PretrainParameters,
    *,
    seed: int,
    checkpoint: Path,
    report: Callable[[TrainingProgress], None],
    stream: Stream = prefetched,
    ranks: Ranks = ALONE,
) -> Pretrained:
    """An encoder trained on the batches `pairs_of(0)`, `pairs_of(1)`, ... made by `stream`.

    Starts from `checkpoint` if there is one (and removes nothing), so that a killed run goes on
    where it was. The same seed gives the same encoder on the same machine: `parameters.threads`
    fixes the number of threads, on which rounding depends. On a GPU, where there is one, the
    network computes in bfloat16, and no seed gives the bytes of a processor. Where this is one of
    several `ranks`, they share each batch and its loss, and the first of them writes the
    checkpoint. Raises StoreError for a checkpoint of another run.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(parameters.threads)
    device = training_device(has_gpu=torch.cuda.is_available())
    network, optimizer, losses = so_far(parameters, seed, checkpoint, device, ranks)
    start_together(len(losses), ranks)
    norms_of_all(network, ranks)
    network.train()
    for step, batch in shares(stream, pairs_of, len(losses), parameters.steps, ranks):
        for group in optimizer.param_groups:
            group["lr"] = parameters.learning_rate * warm_cosine(
                step, parameters.warmup_steps, parameters.steps
            )
        loss = pair_loss(network, batch, parameters, ranks)
        optimizer.zero_grad()
        (loss / ranks.count).backward()  # type: ignore[no-untyped-call]
        sum_gradients(network, ranks)
        optimizer.step()
        losses.append(float(loss.item()))
        report(TrainingProgress(step + 1, losses[-1]))
        if ranks.number == 0 and (step + 1) % parameters.checkpoint_steps == 0:
            run = run_of(parameters, seed, device, ranks)
            save(checkpoint, run, losses, network, optimizer)
    return Pretrained(network.cpu().eval(), np.array(losses), arithmetic_of(device, ranks))


def so_far(
    parameters: PretrainParameters, seed: int, checkpoint: Path, device: torch.device, ranks: Ranks
) -> tuple[nn.Module, torch.optim.Optimizer, list[float]]:
    """Network, optimizer and losses as the checkpoint has them, or as they are in the beginning."""
    network = build_network(parameters).to(device)
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=parameters.learning_rate, weight_decay=parameters.weight_decay
    )
    run = run_of(parameters, seed, device, ranks)
    return network, optimizer, resumed(checkpoint, run, network, optimizer)


def run_of(parameters: PretrainParameters, seed: int, device: torch.device, ranks: Ranks) -> str:
    """What a checkpoint is of."""
    return f"seed {seed}, {arithmetic_of(device, ranks)}, {parameters}"


def arithmetic_of(device: torch.device, ranks: Ranks) -> str:
    """What the bits of the result depend on besides seed and parameters."""
    alone = ARITHMETIC[device.type]
    return alone if ranks.count == 1 else f"{alone}, {ranks.count} processes"


def build_network(parameters: PretrainParameters) -> nn.Module:
    """The network that the parameters name, with random weights."""
    if parameters.network == "resnet18":
        return ResNetEncoder()
    return CompactEncoder(parameters.width)


def training_device(*, has_gpu: bool) -> torch.device:
    """Where to train: on the GPU if there is one."""
    return torch.device("cuda" if has_gpu else "cpu")


def embedded(network: nn.Module, batch: EchoPairs) -> Tensor:
    """ELFs of the first and then of the second echoes of a batch, where the network's weights lie.

    On a GPU it computes in bfloat16; what comes out is float32 all the same.
    """
    device = next(network.parameters()).device
    both = torch.from_numpy(np.concatenate([batch.first, batch.second])).to(device)
    with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
        rows: Tensor = network(both)
    return rows.float()


def pair_loss(
    network: nn.Module, batch: EchoPairs, parameters: PretrainParameters, ranks: Ranks = ALONE
) -> Tensor:
    """Contrastive loss of a batch: weighted NT-Xent, and what lies on the wrong side of margins.

    Places of one room that are too near are left out of the negatives; the others of the room
    count `room_weight` times, for other rooms are easily told apart. Of several `ranks`, each has
    its share of the batch, and all the loss of the whole.
    """
    rows = rows_of_all(embedded(network, batch), ranks)
    first, second = (half.flatten(0, 1) for half in rows.chunk(2, dim=1))
    room, xy_m = _places_of_all(batch, ranks)
    distance_m = np.linalg.norm(xy_m[:, None] - xy_m[None], axis=2)
    same_room = room[:, None] == room[None]
    near = torch.from_numpy(same_room & (distance_m < parameters.too_near_m)).to(rows.device)
    harder = torch.from_numpy(same_room & ~np.eye(len(same_room), dtype=bool)).to(rows.device)
    contrast = nt_xent(
        first, second, near, parameters.temperature, math.log(parameters.room_weight) * harder
    )
    margin = margin_loss(
        first, second, near, low=parameters.margin_low, high=parameters.margin_high,
        hardest=parameters.hardest,
    )  # fmt: skip
    return contrast + parameters.margin_weight * margin


def _places_of_all(batch: EchoPairs, ranks: Ranks) -> tuple[F64, F64]:
    """Rooms (n) and positions (n, 2) of the pairs of all ranks."""
    own = torch.from_numpy(np.column_stack([batch.room, batch.xy_m]))
    places = rows_of_all(own, ranks).flatten(0, 1).numpy()
    return places[:, 0], places[:, 1:]
