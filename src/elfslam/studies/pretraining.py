"""The shipped encoder: the compact network trained on echoes from random simulated rooms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from elfslam.base.errors import ParameterError, StoreError
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
    Raises StoreError or ParameterError before anything is made.
    """
    _check(out, parameters)
    losses: list[float] = []

    def batch(step: int) -> EchoPairs:
        return echo_pairs(np.random.default_rng([seed, step]), parameters.pairs, parameters.rooms)

    def report(progress: Progress) -> None:
        losses.append(progress.loss)
        share = progress.step / parameters.steps
        announce(f"step {progress.step} of {parameters.steps}, loss {progress.loss:.3f}", share)

    checkpoint = out.with_suffix(".checkpoint")
    with _folder_of(out):
        network = pretrain(batch, parameters, seed=seed, checkpoint=checkpoint, report=report)
        export_encoder(network, out)
        checkpoint.unlink(missing_ok=True)
    return float(np.mean(losses[-max(len(losses) // 10, 1) :])) if losses else float("nan")


def _check(out: Path, parameters: PretrainParameters) -> None:
    if out.is_dir():
        raise StoreError(f"{out}: is a folder; name a file such as {out / 'compact.onnx'}")
    if out.suffix != ".onnx":
        raise StoreError(f"{out}: wanted a name that ends in .onnx; rename it")
    if parameters.pairs % parameters.rooms:
        raise ParameterError(
            f"pretrain.pairs: wanted a multiple of pretrain.rooms ({parameters.rooms}), "
            f"got {parameters.pairs}; change one"
        )


@contextmanager
def _folder_of(file: Path) -> Iterator[None]:
    """A folder for `file` that can be written; what was made for it and stays empty goes again."""
    missing = [folder for folder in file.parents if not folder.exists()]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=file.parent).close()  # fails now, not after an hour
        yield
    finally:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()
