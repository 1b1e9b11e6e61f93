"""The shipped encoder: the compact network trained on echoes from random simulated rooms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from elfslam.base.errors import StoreError
from elfslam.base.values import EchoPairs
from elfslam.learn.export import export_encoder
from elfslam.learn.pretrain import Progress, pretrain
from elfslam.learn.settings import PretrainParameters
from elfslam.world.echo_pairs import echo_pairs


def pretrain_on_simulated_echoes(
    out: Path,
    parameters: PretrainParameters,
    *,
    seed: int,
    announce: Callable[[str, float | None], None],
) -> float:
    """Train, write the ONNX file `out`, and give the mean loss over the last tenth of the steps.

    The checkpoint lies beside `out` until the training is done, so that a killed run goes on.
    """
    if out.is_dir():
        raise StoreError(f"{out}: is a folder; name a file such as {out / 'compact.onnx'}")
    losses: list[float] = []

    def batch(step: int) -> EchoPairs:
        return echo_pairs(np.random.default_rng([seed, step]), parameters.pairs, parameters.rooms)

    def report(progress: Progress) -> None:
        losses.append(progress.loss)
        share = progress.step / parameters.steps
        announce(f"step {progress.step} of {parameters.steps}, loss {progress.loss:.3f}", share)

    out.parent.mkdir(parents=True, exist_ok=True)
    checkpoint = out.with_suffix(".checkpoint")
    network = pretrain(batch, parameters, seed=seed, checkpoint=checkpoint, report=report)
    export_encoder(network, out)
    checkpoint.unlink(missing_ok=True)
    return float(np.mean(losses[-max(len(losses) // 10, 1) :])) if losses else float("nan")
