"""The supervised fingerprint: a ResNet-18 that names the spot of an echo (paper, section 3).

It needs labelled echoes of every spot, which is what the ELF does without.
"""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import ECHO_SAMPLES
from elfslam.learn.network import STAGES, Spectrogram, Stem, normalised_log, resnet18
from elfslam.learn.resumable import resumed, save

ROWS_AT_ONCE = 256
CHECKPOINT_STEPS = 500
_DRAWING = threading.Lock()
"""First weights come from the one generator of the process: two trainings must not mix theirs."""


@dataclass(frozen=True)
class FingerprintParameters:
    """How the classifier of spots is trained."""

    epochs: int = parameter(10, "", "passes over the labelled echoes", low=1)
    batch: int = parameter(64, "", "echoes in a batch", low=2)
    learning_rate: float = parameter(1e-3, "", "peak learning rate (AdamW, one cycle)", low=1e-6)
    weight_decay: float = parameter(1e-4, "", "weight decay of AdamW", low=0.0)
    threads: int = parameter(2, "", "threads of the network; rounding depends on them", low=1)


class SpotClassifier(nn.Module):
    """Raw aligned samples (n, 2352) to a score for every spot (n, spots)."""

    def __init__(self, spots: int, stem: Stem = "imagenet") -> None:
        super().__init__()
        self.spectrogram = Spectrogram()
        self.body = resnet18(stem)
        self.head = nn.Linear(STAGES[-1], spots)

    def forward(self, samples: Tensor) -> Tensor:
        image = normalised_log(self.spectrogram(samples))
        scores: Tensor = self.head(self.body(image[:, None]))
        return scores


class FingerprintScore(NamedTuple):
    """How often the right spot is named, and how far the named one lies off on average."""

    top_1: float
    mean_error_m: float


def train_fingerprint(
    samples: F32,
    spot: I64,
    parameters: FingerprintParameters,
    *,
    seed: int,
    stem: Stem = "imagenet",
    report: Callable[[float], None] = lambda share: None,
) -> SpotClassifier:
    """A classifier trained on traces (n, 2352) of known spots (n), numbered from 0.

    `report` hears the share done. The same seed and `parameters.threads` give the same one.
    Raises InputError for traces that are too few or have no spot each.
    """
    _check(samples, spot, parameters)
    rows = list(_all_batches(np.random.default_rng(seed), len(samples), parameters))
    return train_on_batches(
        lambda step: (samples[rows[step]], spot[rows[step]]),
        int(spot.max()) + 1, len(rows), parameters, seed=seed, stem=stem, report=report,
    )  # fmt: skip


def train_on_batches(
    batch_of: Callable[[int], tuple[F32, I64]],
    spots: int,
    steps: int,
    parameters: FingerprintParameters,
    *,
    seed: int,
    stem: Stem = "imagenet",
    checkpoint: Path | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> SpotClassifier:
    """A classifier of so many spots, trained on `steps` batches that are heard once and dropped.

    Each batch is traces (n, 2352) and their spots (n). Of the parameters, `epochs` and `batch` say
    nothing here. `report` hears the share done. Goes on from `checkpoint` if there is one. Raises
    StoreError for one of another run.
    """
    torch.set_num_threads(parameters.threads)
    with _DRAWING:
        torch.manual_seed(seed)
        network = SpotClassifier(spots, stem)
    decay = parameters.weight_decay
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=decay, fused=True)
    run = f"seed {seed}, {spots} spots, {steps} steps, {stem} stem, {parameters}"
    losses = [] if checkpoint is None else resumed(checkpoint, run, network, optimizer)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, parameters.learning_rate, steps, last_epoch=len(losses) - 1
    )
    network.train()
    for step in range(len(losses), steps):
        losses.append(_learn(network, optimizer, *batch_of(step)))
        schedule.step()
        report((step + 1) / steps)
        if checkpoint is not None and (step + 1) % CHECKPOINT_STEPS == 0:
            save(checkpoint, run, losses, network, optimizer)
    return network.eval()


def _learn(
    network: SpotClassifier, optimizer: torch.optim.Optimizer, samples: F32, spot: I64
) -> float:
    """One step; gives the loss."""
    loss = functional.cross_entropy(network(torch.from_numpy(samples)), torch.from_numpy(spot))
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
    return float(loss.detach())


def named_spots(network: SpotClassifier, samples: F32, *, together: int = 1) -> I64:
    """The spot (n / together) that the classifier names for the traces (n, 2352).

    Of `together` traces in a row, which must divide n, the scores are added.
    """
    parts = np.array_split(samples, range(ROWS_AT_ONCE, len(samples), ROWS_AT_ONCE))
    with torch.no_grad():
        scores = torch.cat([network(torch.from_numpy(part)).log_softmax(dim=1) for part in parts])
    rows = scores.reshape(-1, together, scores.shape[1]).sum(dim=1)
    return np.asarray(rows.argmax(dim=1).numpy())


def score_fingerprint(named: I64, spot: I64, spots_m: F64) -> FingerprintScore:
    """Top-1 and mean error of named spots (n) against the true ones, at `spots_m` (spots, 2)."""
    error_m = np.linalg.norm(spots_m[named] - spots_m[spot], axis=1)
    return FingerprintScore(float(np.mean(named == spot)), float(error_m.mean()))


def _all_batches(
    generator: np.random.Generator, count: int, parameters: FingerprintParameters
) -> Iterator[I64]:
    """Rows in random order, in whole batches, epoch by epoch."""
    batch = parameters.batch
    for _ in range(parameters.epochs):
        order = generator.permutation(count)
        yield from (order[k : k + batch] for k in range(0, count - batch + 1, batch))


def _check(samples: F32, spot: I64, parameters: FingerprintParameters) -> None:
    if samples.shape != (len(spot), ECHO_SAMPLES) or (len(spot) and spot.min() < 0):
        raise InputError(
            f"fingerprint: wanted a spot from 0 up for each trace (n, {ECHO_SAMPLES}), got traces "
            f"{samples.shape} and {len(spot)} spots; check both"
        )
    if len(samples) < parameters.batch:
        raise InputError(
            f"fingerprint: wanted at least one batch of {parameters.batch} echoes, "
            f"got {len(samples)}; record more or lower the batch"
        )
