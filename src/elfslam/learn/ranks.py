"""Several processes that train one network: rank by rank a share of each batch, one loss.

Every rank holds the same weights and computes the loss of the whole batch from the features of
all ranks; what its own rows owe to it goes back through its own network, and gradients are added
up over the ranks. So N ranks take the very step that one process would, but for rounding. Sums
are made in the order of the ranks: however PyTorch bundles what it sends, and however often a
training was interrupted, the same bits come out.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import torch
import torch.distributed
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

LONGEST_WAIT_S = 600.0
"""A rank that has not answered by then is taken for lost."""


@dataclass(frozen=True)
class Ranks:
    """Which of the ranks this process is."""

    number: int = 0
    count: int = 1


ALONE = Ranks()


@contextmanager
def joined(ranks: Ranks, meeting: str) -> Iterator[None]:
    """The ranks can talk to each other; `meeting` is where they meet, a URL as PyTorch has it.

    By NCCL where each rank has a GPU of its own, by Gloo otherwise.
    """
    own_gpus = torch.cuda.is_available() and torch.cuda.device_count() >= ranks.count
    if own_gpus:
        torch.cuda.set_device(ranks.number)
    torch.distributed.init_process_group(
        "nccl" if own_gpus else "gloo",
        init_method=meeting,
        rank=ranks.number,
        world_size=ranks.count,
        timeout=timedelta(seconds=LONGEST_WAIT_S),
    )
    try:
        yield
    finally:
        torch.distributed.destroy_process_group()


def shared(network: nn.Module, ranks: Ranks) -> nn.Module:
    """The network, such that its gradients are the sums over all ranks; itself where it is alone.

    Batch norms of `network`, which keeps its weights, take their statistics from all ranks too.
    """
    if ranks.count == 1:
        return network
    _norms_of_all(network, ranks)
    parallel = DistributedDataParallel(network)
    # It reads annotations and wants its own, which are no strings.
    hook = lambda ranks, bucket: _summed_gradients(ranks, bucket)  # noqa: E731, PLW0108
    parallel.register_comm_hook(ranks, hook)
    return parallel


def rows_of_all(rows: Tensor, ranks: Ranks) -> Tensor:
    """Rows (ranks, n, ...) of every rank, each of which has as many; gradients find their way."""
    if ranks.count == 1:
        return rows[None]
    gathered: Tensor = _Gathered.apply(rows, ranks)  # type: ignore[no-untyped-call]
    return gathered


def mean_over(loss: Tensor, ranks: Ranks) -> Tensor:
    """The mean of a loss over the ranks; gradients find their way."""
    return loss if ranks.count == 1 else rows_of_all(loss, ranks).mean()


class _Gathered(torch.autograd.Function):
    """Each rank computes the same from all rows, so what its own owe is its part of the slope."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, ranks: Ranks) -> Tensor:
        ctx.number = ranks.number
        return torch.stack(_of_each(rows, ranks))

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, None]:
        return slope[ctx.number], None


class NormOfAll(nn.Module):
    """A batch norm whose statistics are those of the rows of all ranks.

    PyTorch has one for GPUs alone (SyncBatchNorm). Weights and statistics are those of `norm`,
    under the same names, and no longer trained it is the same.
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
        y, mean, variance = _Normed.apply(  # type: ignore[no-untyped-call]
            x, self.weight, self.bias, self.eps, self.ranks
        )
        count = x.numel() // x.shape[1] * self.ranks.count
        with torch.no_grad():
            self.get_buffer("num_batches_tracked").add_(1)
            for old, new in zip(known, (mean, variance * (count / (count - 1))), strict=True):
                old.mul_(1 - self.momentum).add_(new.to(old.dtype), alpha=self.momentum)
        normed: Tensor = y
        return normed


class _Normed(torch.autograd.Function):
    """(x - mean) / sqrt(variance + eps) * weight + bias, both by channel and over all ranks."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, eps: float, ranks: Ranks
    ) -> tuple[Tensor, Tensor, Tensor]:
        wide = x.to(weight.dtype)
        own = torch.stack(torch.var_mean(wide, _but_channels(x), correction=0)[::-1])
        means, variances = torch.stack(_of_each(own, ranks)).unbind(1)
        mean = means.mean(0)
        variance = variances.mean(0) + (means - mean).square().mean(0)
        ctx.save_for_backward(x, weight, mean, variance)
        ctx.eps, ctx.ranks = eps, ranks
        ctx.mark_non_differentiable(mean, variance)
        y = nn.functional.batch_norm(wide, mean, variance, weight, bias, eps=eps)
        return y.to(x.dtype), mean, variance

    @staticmethod
    def backward(
        ctx: Any, slope: Tensor, *statistics: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, None, None]:
        """Ioffe and Szegedy 2015, section 3; the sums over the rows are over those of all ranks."""
        x, weight, mean, variance = ctx.saved_tensors
        rest, shape = _but_channels(x), (1, -1, *[1] * (x.dim() - 2))
        scale = torch.rsqrt(variance + ctx.eps)
        steep = slope.to(weight.dtype)
        unit = (x.to(weight.dtype) - mean.view(shape)) * scale.view(shape)
        own = torch.stack([steep.sum(rest), (steep * unit).sum(rest)])
        count = x.numel() // x.shape[1] * ctx.ranks.count
        level, tilt = (_in_order(_of_each(own, ctx.ranks)) / count).unbind(0)
        inner = steep - level.view(shape) - unit * tilt.view(shape)
        back = inner * (scale * weight).view(shape)
        return back.to(x.dtype), own[1], own[0], None, None


def _norms_of_all(network: nn.Module, ranks: Ranks) -> None:
    """Put batch norms over all ranks in the place of those over one."""
    for parent in list(network.modules()):
        for name, child in list(parent.named_children()):
            if isinstance(child, nn.BatchNorm1d | nn.BatchNorm2d):
                setattr(parent, name, NormOfAll(child, ranks))


def _but_channels(x: Tensor) -> list[int]:
    return [0, *range(2, x.dim())]


def _of_each(values: Tensor, ranks: Ranks) -> list[Tensor]:
    """The values (of one shape) of each rank, in order."""
    own = values.contiguous()
    parts = [torch.empty_like(own) for _ in range(ranks.count)]
    torch.distributed.all_gather(parts, own)
    return parts


def _in_order(parts: list[Tensor]) -> Tensor:
    """The sum, made in one order: rounding depends on it."""
    total = parts[0].clone()
    for part in parts[1:]:
        total += part
    return total


def _summed_gradients(ranks: Ranks, bucket: Any) -> torch.futures.Future[Tensor]:
    """What DistributedDataParallel asks of a bundle of gradients. It would take their mean."""
    future: torch.futures.Future[Tensor] = torch.futures.Future()
    future.set_result(_in_order(_of_each(bucket.buffer(), ranks)))
    return future
