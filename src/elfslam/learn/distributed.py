"""Data-parallel training by several processes (torchrun), each with a share of every batch.

Each computes the loss of the whole batch from the features of all, batch norms take their
statistics from all rows, and gradients are summed: N processes take the step of one, but for
rounding.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, cast

import torch
import torch.distributed as group
from torch import Tensor, nn

from elfslam.base.errors import ParameterError, StoreError
from elfslam.base.values import EchoPairs
from elfslam.learn.resumable import Stream


@dataclass(frozen=True)
class Ranks:
    """Which of the processes this is."""

    number: int = 0
    count: int = 1


ALONE = Ranks()


@contextmanager
def joined() -> Iterator[Ranks]:
    """The process group that torchrun's environment names; without one this process is alone.

    By NCCL where each process of this machine has a GPU of its own, by Gloo otherwise. Raises
    ParameterError where the environment names a group that cannot be joined.
    """
    if os.environ.get("WORLD_SIZE", "1") == "1":
        yield ALONE
        return
    try:
        own_gpu = torch.cuda.device_count() >= int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
        if own_gpu:
            torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
        group.init_process_group("nccl" if own_gpu else "gloo")
    except (ValueError, RuntimeError) as cause:
        said = str(cause).split("\n")[0]
        raise ParameterError(f"WORLD_SIZE: {said}; launch with torchrun, or unset it") from cause
    try:
        yield Ranks(group.get_rank(), group.get_world_size())
    finally:
        group.destroy_process_group()


def check_shares(pairs: int, ranks: Ranks) -> None:
    """Raise ParameterError where so many processes cannot share a batch evenly, two pairs each."""
    if pairs % ranks.count or pairs < 2 * ranks.count:
        raise ParameterError(
            f"torchrun: got {ranks.count} processes, wanted a number that pretrain.pairs "
            f"({pairs}) is a multiple of, two times or more; change one"
        )


def shares(
    stream: Stream, batch_of: Callable[[int], EchoPairs], first: int, last: int, ranks: Ranks
) -> Generator[tuple[int, EchoPairs]]:
    """Steps and this process's share of their batches; the processes make whole ones in turn."""
    if ranks.count == 1:
        yield from stream(batch_of, first, last)
        return
    start, end = (-(-(step - ranks.number) // ranks.count) for step in (first, last))
    in_turn = partial(_batch_in_turn, batch_of=batch_of, ranks=ranks)
    with closing(stream(in_turn, start, end)) as own:
        for step in range(first, last):
            maker, got = step % ranks.count, cast("list[EchoPairs]", [None])
            parts = _parts(next(own)[1], ranks.count) if maker == ranks.number else None
            group.scatter_object_list(got, parts, src=maker)
            yield step, got[0]


def _batch_in_turn(turn: int, *, batch_of: Callable[[int], EchoPairs], ranks: Ranks) -> EchoPairs:
    return batch_of(turn * ranks.count + ranks.number)


def start_together(steps: int, ranks: Ranks) -> None:
    """Raise StoreError where processes would go on from different checkpoints."""
    if ranks.count > 1:
        each: list[Any] = [None] * ranks.count
        group.all_gather_object(each, steps)
        if len(set(each)) > 1:
            raise StoreError(
                f"checkpoint: the processes see steps {each}; put it on a disk that all share"
            )


def norms_of_all(network: nn.Module, ranks: Ranks) -> None:
    """Put batch norms over the rows of all processes in the place of those over one's own."""
    for parent in list(network.modules()) if ranks.count > 1 else []:
        for name, child in list(parent.named_children()):
            if isinstance(child, nn.BatchNorm1d | nn.BatchNorm2d):
                setattr(parent, name, NormOfAll(child, ranks))


def rows_of_all(rows: Tensor, ranks: Ranks) -> Tensor:
    """Rows (processes, n, ...) of every process, each of which has as many."""
    if ranks.count == 1:
        return rows[None]
    nobody = torch.zeros_like(rows)
    return _summed(torch.stack([rows if k == ranks.number else nobody for k in range(ranks.count)]))


def sum_gradients(network: nn.Module, ranks: Ranks) -> None:
    """Gradients of the whole loss, after each process went back through its share of it."""
    for value in network.parameters() if ranks.count > 1 else []:
        if value.grad is not None:
            group.all_reduce(value.grad)


class NormOfAll(nn.Module):
    """A batch norm whose statistics are those of all processes (SyncBatchNorm is for GPUs alone).

    Weights and statistics are those of `norm`, under the same names.
    """

    def __init__(self, norm: nn.BatchNorm1d | nn.BatchNorm2d, ranks: Ranks) -> None:
        super().__init__()
        self.weight, self.bias = norm.weight, norm.bias
        for name, value in norm.named_buffers():
            self.register_buffer(name, value)
        self.eps, self.momentum, self.ranks = norm.eps, norm.momentum or 0.0, ranks
        self.train(norm.training)

    def forward(self, x: Tensor) -> Tensor:
        known = self.get_buffer("running_mean"), self.get_buffer("running_var")
        if not self.training:
            return nn.functional.batch_norm(x, *known, self.weight, self.bias, eps=self.eps)
        wide, rest, count = x.to(self.weight.dtype), [0, *range(2, x.dim())], self.ranks.count
        mean = _summed(wide.mean(rest, keepdim=True)) / count
        variance = _summed((wide - mean).square().mean(rest, keepdim=True)) / count
        unit = (wide - mean) * torch.rsqrt(variance + self.eps)
        rows = x.numel() // x.shape[1] * count
        with torch.no_grad():
            self.get_buffer("num_batches_tracked").add_(1)
            for old, new in zip(known, (mean, variance * (rows / (rows - 1))), strict=True):
                old.mul_(1 - self.momentum).add_(new.flatten(), alpha=self.momentum)
        return (unit * self.weight.view_as(mean) + self.bias.view_as(mean)).to(x.dtype)


class _Sum(torch.autograd.Function):
    """The sum over the processes. The loss of each depends on it: so do the slopes add up."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        total = value.contiguous().clone()
        group.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Tensor:
        total = slope.contiguous().clone()
        group.all_reduce(total)
        return total


def _summed(value: Tensor) -> Tensor:
    total: Tensor = _Sum.apply(value)  # type: ignore[no-untyped-call]
    return total


def _parts(batch: EchoPairs, count: int) -> list[EchoPairs]:
    """The rows of a batch in so many even shares."""
    size = len(batch.xy_m) // count
    return [
        replace(batch, **{each.name: getattr(batch, each.name)[k * size : (k + 1) * size]
                          for each in fields(batch)})
        for k in range(count)
    ]  # fmt: skip
