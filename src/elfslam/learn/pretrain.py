"""Contrastive pre-training: a stream of echo pairs in, a trained encoder out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import ECHO_SAMPLES, EchoPairs
from elfslam.learn.distributed import (
    ALONE,
    Ranks,
    norms_of_all,
    rows_of_all,
    shares,
    start_together,
    sum_gradients,
)
from elfslam.learn.loss import margin_loss, spot_contrast
from elfslam.learn.network import CompactEncoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.resnet import ResNetEncoder
from elfslam.learn.resumable import Stream, prefetched, resumed, save, warm_cosine
from elfslam.line.feature import BINS

NETWORKS = ("compact", "resnet18")
PairsOf = Callable[[int], EchoPairs]
"""The batch of a step: the same step always gives the same batch, so that a run can resume."""
OPENING_BATCHES = 8
"""From which the principal components are had, before the first step."""
LEAST_LOGIT = -1e4
ARITHMETIC = {"cpu": "float32", "cuda": "bfloat16 on a GPU"}
"""Of the network, by where it is trained."""


@dataclass(frozen=True)
class Progress:
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
    report: Callable[[Progress], None],
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
    if not losses:
        opening = range(min(OPENING_BATCHES, parameters.steps))
        fit_components(network, [pairs_of(step) for step in opening])
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
        report(Progress(step + 1, losses[-1]))
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
    return CompactEncoder(parameters.width, parameters.components)


def fit_components(network: nn.Module, batches: Sequence[EchoPairs]) -> None:
    """Fit the principal components of a network that has some to the echoes of these batches."""
    if isinstance(network, CompactEncoder) and network.plain is not None:
        device = next(network.parameters()).device
        samples = np.concatenate([side for each in batches for side in (each.first, each.second)])
        rows = torch.from_numpy(samples.reshape(-1, ECHO_SAMPLES)).to(device)
        network.plain.fit(network.spectrogram(rows))


def training_device(*, has_gpu: bool) -> torch.device:
    """Where to train: on the GPU if there is one."""
    return torch.device("cuda" if has_gpu else "cpu")


def embedded(network: nn.Module, batch: EchoPairs) -> Tensor:
    """ELFs (n, 2, 128) of the first and second footsteps of a batch, where the weights lie.

    A footstep's is the mean over its echoes, as on the line. On a GPU the network computes in
    bfloat16; what comes out is float32 all the same.
    """
    device = next(network.parameters()).device
    both = torch.from_numpy(np.stack([batch.first, batch.second], axis=1)).to(device)
    with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
        rows: Tensor = network(both.flatten(0, 2), torch.zeros(BINS, device=device))
    means = rows.float().reshape(*both.shape[:3], -1).mean(dim=2)
    return functional.normalize(means, dim=2)


def pair_loss(
    network: nn.Module, batch: EchoPairs, parameters: PretrainParameters, ranks: Ranks = ALONE
) -> Tensor:
    """Contrastive loss of a batch: a kernel of distance, and what is on the wrong side of margins.

    Each footstep is to sound like those of the other visit in shares that fall with distance. What
    is near and heard in another direction is neither alike nor elsewhere; elsewhere in the same
    room counts `room_weight` times, for other rooms are easily told apart. Of several `ranks`,
    each has its share of the batch, and all the loss of the whole.
    """
    first, second = rows_of_all(embedded(network, batch), ranks).flatten(0, 1).unbind(dim=1)
    square_m2, elsewhere, aside = (
        torch.from_numpy(each).to(first.device) for each in _relations(batch, parameters, ranks)
    )
    similarity = first @ second.T
    logits = similarity / parameters.temperature + math.log(parameters.room_weight) * elsewhere
    logits = logits.masked_fill(aside, LEAST_LOGIT)
    wanted = parameters.margin_high * torch.exp(
        -square_m2.diagonal() / (2 * parameters.margin_m**2)
    )
    total = torch.zeros((), device=first.device)
    for likeness, logit, square, other in (
        (similarity, logits, square_m2, elsewhere),
        (similarity.T, logits.T, square_m2.T, elsewhere.T),
    ):
        contrast = spot_contrast(logit, square, parameters.near_m)
        margin = margin_loss(
            likeness, wanted, other, low=parameters.margin_low, hardest=parameters.hardest
        )
        total = total + (contrast + parameters.margin_weight * margin) / 2
    return total


def _relations(
    batch: EchoPairs, parameters: PretrainParameters, ranks: Ranks
) -> tuple[F32, Bool, Bool]:
    """How the first footsteps lie to the second ones, each (n, n).

    Squared distances, infinite where they are no likely pair; whether they are far apart in one
    room; and whether they are near each other and heard in another direction.
    """
    columns = [batch.room[:, None], batch.first_pose, batch.second_pose]
    own = torch.from_numpy(np.column_stack(columns))
    room, first, second = np.split(rows_of_all(own, ranks).flatten(0, 1).numpy(), [1, 4], axis=1)
    same_room = room == room.T
    distance_m = np.linalg.norm(first[:, None, :2] - second[None, :, :2], axis=2)
    turn_rad = np.abs(wrap_angle(first[:, None, 2] - second[None, :, 2]))
    near = same_room & (distance_m < parameters.elsewhere_m)
    alike = (near & (turn_rad < parameters.turned_rad)) | np.eye(len(room), dtype=bool)
    square_m2 = np.where(alike, distance_m**2, np.inf).astype(np.float32)
    return square_m2, same_room & ~near & ~alike, near & ~alike
