"""The paper's fine-tuning as it stands, from random weights or from those of an encoder.

From random weights it gives the paper's "ELF without pre-training", which has heard one walk alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch

from elfslam.base.arrays import I64
from elfslam.base.errors import InputError
from elfslam.base.values import Echoes
from elfslam.learn.loss import nt_xent
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.learn.parameters import ScratchParameters
from elfslam.line.feature import BINS, OnnxEncoder


def learn_from_scratch(
    echoes: Echoes,
    parameters: ScratchParameters,
    *,
    seed: int,
    width: int = 24,
    start: OnnxEncoder | None = None,
    report: Callable[[float], None] = lambda loss: None,
) -> OnnxEncoder:
    """A compact encoder trained on the echoes of one walk alone, by the paper's section 5.3.

    Positives are consecutive echoes, negatives all others of the batch that are not near in time;
    what the walk passes twice pushes itself apart. `start` gives the first weights, which are
    random without it; `report` hears every loss. Same seed and number of threads, same bytes.
    Raises InputError for a walk of too few echoes.
    """
    first = np.flatnonzero(np.diff(echoes.t_s) <= parameters.gap_s)
    if len(first) < parameters.pairs:
        raise InputError(
            f"learning from scratch: wanted {parameters.pairs} consecutive echoes, "
            f"got {len(first)}; walk longer"
        )
    torch.set_num_threads(parameters.threads)
    torch.manual_seed(seed)
    network = (CompactEncoder(width) if start is None else network_of(start.content)).train()
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
    return OnnxEncoder(encoder_content(network.eval()), "without pre-training")


def _loss(
    network: CompactEncoder, echoes: Echoes, first: I64, parameters: ScratchParameters
) -> torch.Tensor:
    both = torch.from_numpy(np.concatenate([echoes.samples[first], echoes.samples[first + 1]]))
    rows = network(both, torch.zeros(BINS))
    t_s = echoes.t_s[first]
    near = torch.from_numpy(np.abs(t_s[:, None] - t_s) < parameters.near_s)
    return nt_xent(rows[: len(first)], rows[len(first) :], near, parameters.temperature)
