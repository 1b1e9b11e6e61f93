"""Long trainings: batches made ahead, a learning rate that falls, and checkpoints to go on from."""

import io
import math
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from torch import nn

from elfslam.base.errors import StoreError

Batch = TypeVar("Batch")
AHEAD = 3
"""Batches that wait for the network."""


@dataclass(frozen=True)
class TrainingStep:
    """Where the training stands after a step."""

    step: int
    loss: float


class Stream(Protocol):
    """Who makes the batches of a training, ahead of it."""

    def __call__(
        self, batch_of: Callable[[int], Batch], first: int, last: int, /
    ) -> Generator[tuple[int, Batch]]:
        """Steps from `first` to before `last` and the batches of `batch_of`, in order."""


def warm_cosine(step: int, warmup_steps: int, steps: int) -> float:
    """Share of the peak learning rate at a step: a linear rise, and half a cosine down to 0."""
    warm = min((step + 1) / warmup_steps, 1.0)
    return warm * (0.5 + 0.5 * math.cos(math.pi * step / steps))


def prefetched(
    batch_of: Callable[[int], Batch], first: int, last: int
) -> Generator[tuple[int, Batch]]:
    """Steps and their batches in order, made on another core while the network learns."""
    with ThreadPoolExecutor(1) as pool:
        waiting: list[tuple[int, Future[Batch]]] = []
        for step in range(first, last):
            waiting.append((step, pool.submit(batch_of, step)))
            if len(waiting) > AHEAD:
                ready, future = waiting.pop(0)
                yield ready, future.result()
        for ready, future in waiting:
            yield ready, future.result()


def save(
    checkpoint: Path,
    run: str,
    losses: list[float],
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
) -> None:
    """Write how far the training `run` has come, whole or not at all. Raises OSError."""
    parts = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
    state = {"run": run, "losses": losses, **parts}
    content = io.BytesIO()  # torch does not say of a disk that it is full
    torch.save(state, content)
    partial = checkpoint.with_name(f".{checkpoint.name}.partial")
    partial.parent.mkdir(parents=True, exist_ok=True)
    try:
        partial.write_bytes(content.getbuffer())
        partial.replace(checkpoint)
    finally:
        partial.unlink(missing_ok=True)


def resumed(
    checkpoint: Path, run: str, network: nn.Module, optimizer: torch.optim.Optimizer
) -> list[float]:
    """The losses so far; none without a checkpoint. Raises StoreError for one of another run."""
    if not checkpoint.exists():
        return []
    try:
        state: dict[str, Any] = torch.load(checkpoint, weights_only=True, map_location="cpu")
        if state["run"] != run:
            raise StoreError(
                f"{checkpoint}: of another seed, parameters or arithmetic; delete it to start over"
            )
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
        return [float(loss) for loss in state["losses"]]
    except StoreError:
        raise
    except Exception as cause:  # torch raises many types for a damaged or foreign file
        raise StoreError(
            f"{checkpoint}: not a checkpoint of this network; delete it to start over"
        ) from cause
