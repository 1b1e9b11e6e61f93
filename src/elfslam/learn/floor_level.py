"""Training for superimposition: an encoder to which a spot sounds alike in any orientation.

Floor-level contrastive learning (paper, section on map superimposition): echoes of one spot are
positives whichever way the phone pointed and whoever walked there, echoes of other spots negatives.
Each echo is held against the floor-level ELF of every spot of the floor, which is learnt with the
encoder: a spot that sounds alike is rarely in the same batch, but always among all spots.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.distance import cdist
from torch import Tensor, nn

from elfslam import __version__
from elfslam.base.arrays import F32, F64
from elfslam.base.card import Card, Finetuning, training_facts
from elfslam.base.errors import ParameterError
from elfslam.base.values import ELF_SIZE
from elfslam.learn.loss import spot_contrast
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.learn.resumable import Stream, TrainingStep, prefetched, resumed, save, warm_cosine
from elfslam.stages.feature import Encoder, OnnxEncoder, walk_vectors
from elfslam.stages.floormap import SpotEchoes, spot_means

PARTS = ("whole", "head")

EchoesOf = Callable[[int], SpotEchoes]
"""The batch of a step: the same step always gives the same batch, so that a run can resume."""


@dataclass(frozen=True, eq=False)
class FloorLevel:
    """The encoder of a floor, and the loss of every step (steps)."""

    encoder: OnnxEncoder
    losses: F64


class FloorNetwork(nn.Module):
    """An encoder, and the floor-level ELF of every spot (m, 128) that is learnt with it."""

    def __init__(self, encoder: CompactEncoder, spots: F32) -> None:
        super().__init__()
        self.encoder = encoder
        self.spots = nn.Parameter(torch.tensor(spots))

    def forward(self, samples: Tensor, part: str) -> Tensor:
        """Cosines (n, m) of echoes (n, 2352) with all spots; no gradients outside `part`."""
        if part == "whole":
            rows = self.encoder(samples)
        else:
            with torch.no_grad():
                inner = self.encoder.inner(samples)
            rows = self.encoder.outer(*inner)
        cosines: Tensor = rows @ nn.functional.normalize(self.spots, dim=1).T
        return cosines


def learn_floor(
    encoder: OnnxEncoder,
    spots_m: F64,
    echoes_of: EchoesOf,
    parameters: FloorLevelParameters,
    *,
    seed: int,
    checkpoint: Path,
    report: Callable[[TrainingStep], None] = lambda progress: None,
    stream: Stream = prefetched,
) -> FloorLevel:
    """`encoder` after the batches `echoes_of(0)`, `echoes_of(1)`, ... of one floor.

    A batch is heard once and dropped, so that there may be any number of echoes; `spots_m` (m, 2)
    are the spots of the floor. The first batches are heard once more, for the first guess of what
    its spots sound like. Goes on from `checkpoint` if there is one (and
    removes nothing). The statistics of the batch norms stay, so that rows keep apart. Same seed,
    batches and threads, same bytes. Raises InputError for an encoder of another kind,
    ParameterError for an unknown part, StoreError for a checkpoint of another run.
    """
    if parameters.part not in PARTS:
        raise ParameterError(
            f"floor level: part {parameters.part!r}, wanted {' or '.join(PARTS)}; set another"
        )
    torch.set_num_threads(parameters.threads)
    spots = _first_spots(encoder, spots_m, echoes_of, parameters, seed, known=checkpoint.exists())
    network = FloorNetwork(network_of(encoder.content).eval(), spots)
    optimizer = _optimizer(network, parameters)
    run = f"seed {seed}, from {encoder.identity}, {len(spots_m)} spots, {parameters}"
    losses, heard = resumed(checkpoint, run, network, optimizer), 0
    for step, batch in stream(echoes_of, len(losses), parameters.steps):
        share = warm_cosine(step, parameters.warmup_steps, parameters.steps)
        for group in optimizer.param_groups:
            group["lr"] = group["peak"] * share
        losses.append(_learn(network, optimizer, spots_m, batch, parameters))
        heard = len(batch.samples)
        report(TrainingStep(step + 1, losses[-1]))
        if (step + 1) % parameters.checkpoint_steps == 0 or step + 1 == parameters.steps:
            save(checkpoint, run, losses, network, optimizer)
    card = _card(encoder, heard * len(losses), losses, parameters, seed)
    content = encoder_content(network.encoder, card)
    return FloorLevel(OnnxEncoder(content, "floor level"), np.array(losses))


def batch_loss(
    network: nn.Module, spots_m: F64, batch: SpotEchoes, parameters: FloorLevelParameters
) -> Tensor:
    """What a batch costs, see `spot_contrast`."""
    cosines = network(torch.tensor(batch.samples), parameters.part)
    square_m2 = torch.tensor(cdist(batch.xy_m, spots_m, "sqeuclidean"), dtype=torch.float32)
    return spot_contrast(cosines / parameters.temperature, square_m2, parameters.near_m)


def floor_elfs(encoder: Encoder, spots_m: F64, echoes: Iterable[SpotEchoes]) -> F32:
    """The floor-level ELF (m, 128) of each spot (m, 2), from walks; see `spot_means`.

    As from any walk, what a walk's echoes have in common is taken away. A walk is dropped once it
    was heard.
    """
    return spot_means(
        spots_m,
        ((walk.xy_m, walk.heading_rad, walk_vectors(walk.samples, encoder)) for walk in echoes),
    )


def _first_spots(
    encoder: OnnxEncoder,
    spots_m: F64,
    echoes_of: EchoesOf,
    parameters: FloorLevelParameters,
    seed: int,
    *,
    known: bool,
) -> F32:
    """ELFs (m, 128) to start from: what `encoder` makes of the spots, where a batch heard them.

    Of a training that goes on, all is `known` and nothing is heard.
    """
    batches = range(0 if known else min(parameters.opening_batches, parameters.steps))
    heard = (echoes_of(step) for step in batches)
    spots = spot_means(
        spots_m, ((each.xy_m, each.heading_rad, encoder.embed(each.samples)) for each in heard)
    )
    guess = np.random.default_rng(seed).normal(0, ELF_SIZE**-0.5, spots.shape)
    unheard = ~spots.any(axis=1)
    spots[unheard] = guess[unheard]
    return spots


def _optimizer(network: FloorNetwork, parameters: FloorLevelParameters) -> torch.optim.Optimizer:
    """Of the weights and of the spots; each has a peak rate of its own."""
    learning = network.encoder if parameters.part == "whole" else network.encoder.head
    groups = [
        {"params": list(learning.parameters()), "peak": parameters.learning_rate},
        {"params": [network.spots], "peak": parameters.spot_rate},
    ]
    return torch.optim.AdamW(groups, weight_decay=0.0)


def _learn(
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    spots_m: F64,
    batch: SpotEchoes,
    parameters: FloorLevelParameters,
) -> float:
    """Take a step; the loss of the batch."""
    loss = batch_loss(network, spots_m, batch, parameters)
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
    return float(loss.item())


def _card(
    encoder: OnnxEncoder,
    echoes: int,
    losses: list[float],
    parameters: FloorLevelParameters,
    seed: int,
) -> Card:
    """The card of `encoder` with this training added."""
    parent = encoder.card or Card("ELF encoder: of one floor, from one whose file has no card.")
    made = Finetuning(
        parent=encoder.identity,
        software=f"elfslam {__version__}",
        seed=seed,
        echoes=echoes,
        outcome=f"floor level, loss {losses[0]:.2f} -> {losses[-1]:.2f}",
        **training_facts(parameters),
    )
    return replace(parent, finetunings=(*parent.finetunings, made))
