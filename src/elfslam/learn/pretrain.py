"""Contrastive pre-training: a stream of echo pairs in, a trained encoder out."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from elfslam.base.arrays import F64
from elfslam.base.values import EchoPairs
from elfslam.learn.loss import margin_loss, nt_xent
from elfslam.learn.network import CompactEncoder, ResNetEncoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.resumable import Stream, TrainingStep, prefetched, resumed, save, warm_cosine

NETWORKS = ("compact", "resnet18")
PairsOf = Callable[[int], EchoPairs]
"""The batch of a step: the same step always gives the same batch, so that a run can resume."""
ARITHMETIC = {"cpu": "float32", "cuda": "bfloat16 on a GPU"}
"""Of the network, by where it is trained."""


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
    report: Callable[[TrainingStep], None],
    stream: Stream = prefetched,
) -> Pretrained:
    """An encoder trained on the batches `pairs_of(0)`, `pairs_of(1)`, ... made by `stream`.

    Starts from `checkpoint` if there is one (and removes nothing), so that a killed run goes on
    where it was. The same seed gives the same encoder on the same machine: `parameters.threads`
    fixes the number of threads, on which rounding depends. On a GPU, where there is one, the
    network computes in bfloat16, and no seed gives the bytes of a processor. Raises StoreError
    for a checkpoint of another run.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(parameters.threads)
    device = training_device(has_gpu=torch.cuda.is_available())
    network = build_network(parameters).to(device)
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=parameters.learning_rate, weight_decay=parameters.weight_decay
    )
    arithmetic = ARITHMETIC[device.type]
    run = f"seed {seed}, {arithmetic}, {parameters}"
    losses = resumed(checkpoint, run, network, optimizer)
    network.train()
    for step, batch in stream(pairs_of, len(losses), parameters.steps):
        for group in optimizer.param_groups:
            group["lr"] = parameters.learning_rate * warm_cosine(
                step, parameters.warmup_steps, parameters.steps
            )
        loss = pair_loss(network, batch, parameters)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        losses.append(float(loss.item()))
        report(TrainingStep(step + 1, losses[-1]))
        if (step + 1) % parameters.checkpoint_steps == 0:
            save(checkpoint, run, losses, network, optimizer)
    return Pretrained(network.cpu().eval(), np.array(losses), arithmetic)


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


def pair_loss(network: nn.Module, batch: EchoPairs, parameters: PretrainParameters) -> Tensor:
    """Contrastive loss of a batch: weighted NT-Xent, and what lies on the wrong side of margins.

    Places of one room that are too near are left out of the negatives; the others of the room
    count `room_weight` times, for other rooms are easily told apart.
    """
    rows = embedded(network, batch)
    first, second = rows.chunk(2)
    distance_m = np.linalg.norm(batch.xy_m[:, None] - batch.xy_m[None], axis=2)
    same_room = batch.room[:, None] == batch.room[None]
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
