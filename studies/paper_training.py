"""The paper's own training (section 5.3): simulated echoes of one phone, then those of one walk.

From random weights the second gives its "ELF without pre-training", which has heard a walk alone.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from elfslam.base.arrays import I64
from elfslam.base.errors import InputError
from elfslam.base.values import Announce, Echoes, EchoPairs
from elfslam.data.atomic_files import replaced_file
from elfslam.learn.loss import nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.learn.parameters import PretrainParameters, ScratchParameters
from elfslam.learn.pretrain import pretrain
from elfslam.learn.resumable import TrainingStep
from elfslam.stages.feature import OnnxEncoder
from elfslam.world.echo_pairs import POSITIVE_DISTANCE_M, at_one_time, echo_pairs

AS_IN_PAPER = replace(
    PretrainParameters(), steps=1172, temperature=0.1, room_weight=1.0, margin_weight=0.0,
    too_near_m=POSITIVE_DISTANCE_M,
)  # fmt: skip
"""600,000 echoes, from which on the paper's error no longer falls. It tells no temperature."""


def pretrain_as_in_paper(file: Path, parameters: PretrainParameters, announce: Announce) -> None:
    """Write a compact encoder that has heard one phone in rooms where nothing changes.

    Positives are echoes closer than 20 cm, negatives all others of the batch. A killed run goes on.
    """
    checkpoint = file.with_suffix(".checkpoint")
    pairs_of = partial(_pairs, pairs=parameters.pairs, rooms=parameters.rooms)

    def report(progress: TrainingStep) -> None:
        announce("pre-training", progress.step / parameters.steps)

    made = pretrain(pairs_of, parameters, seed=0, checkpoint=checkpoint, report=report)
    with replaced_file(file) as unfinished:
        unfinished.write_bytes(encoder_content(made.network))
    checkpoint.unlink(missing_ok=True)


def _pairs(step: int, *, pairs: int, rooms: int) -> EchoPairs:
    """Those of a step."""
    return echo_pairs(np.random.default_rng([1, step]), pairs, rooms, visits=at_one_time)


def learnt_from_walk(
    echoes: Echoes,
    parameters: ScratchParameters,
    *,
    seed: int,
    width: int = 24,
    start: OnnxEncoder | None = None,
    report: Callable[[float], None] = lambda loss: None,
) -> OnnxEncoder:
    """A compact encoder trained on the echoes of one walk, by the paper's section 5.3.

    Positives are consecutive echoes, negatives all others of the batch that are not near in time;
    what the walk passes twice pushes itself apart. `start` gives the first weights, which are
    random without it; `report` hears every loss. Same seed and number of threads, same bytes.
    Raises InputError for a walk of too few echoes.
    """
    first = np.flatnonzero(np.diff(echoes.t_s) <= parameters.gap_s)
    if len(first) < parameters.pairs:
        raise InputError(
            f"learning from a walk: wanted {parameters.pairs} consecutive echoes, "
            f"got {len(first)}; walk longer"
        )
    torch.set_num_threads(parameters.threads)
    torch.manual_seed(seed)
    # The statistics of the norms of a start stay: a walk's own would undo what it has learnt.
    network = CompactEncoder(width).train() if start is None else network_of(start.content).eval()
    optimizer = torch.optim.AdamW(network.parameters(), lr=parameters.learning_rate)
    draw = np.random.default_rng(seed)
    for step in range(parameters.steps):
        for group in optimizer.param_groups:
            cosine = 0.5 + 0.5 * math.cos(math.pi * step / parameters.steps)
            group["lr"] = parameters.learning_rate * cosine
        chosen = draw.choice(first, parameters.pairs, replace=False)
        loss = _loss(network, echoes, chosen, parameters)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        report(float(loss.item()))
    return OnnxEncoder(encoder_content(network.eval()), "learnt from a walk")


def _loss(
    network: CompactEncoder, echoes: Echoes, first: I64, parameters: ScratchParameters
) -> torch.Tensor:
    both = torch.from_numpy(np.concatenate([echoes.samples[first], echoes.samples[first + 1]]))
    rows = network(both)
    t_s = echoes.t_s[first]
    near = torch.from_numpy(np.abs(t_s[:, None] - t_s) < parameters.near_s)
    return nt_xent(rows[: len(first)], rows[len(first) :], near, parameters.temperature)
