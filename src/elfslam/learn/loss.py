"""The contrastive losses."""

import torch
from torch import Tensor
from torch.nn import functional


def nt_xent(
    first: Tensor,
    second: Tensor,
    ignored: Tensor,
    temperature: float,
    log_weight: Tensor | None = None,
) -> Tensor:
    """Normalised temperature-scaled cross entropy over M positive pairs (SimCLR, Chen et al. 2020).

    `first`, `second` (M, d) are unit rows; `ignored` (M, M) marks pairs of places that are too
    close to count as negatives (its diagonal is not read). `log_weight` (M, M) is the logarithm of
    how many times a negative counts, once each without it; its diagonal is zero.
    """
    count = len(first)
    rows = torch.cat([first, second])
    logits = rows @ rows.T / temperature
    if log_weight is not None:
        logits = logits + log_weight.repeat(2, 2)
    logits = logits.masked_fill(_blocked(ignored, rows), float("-inf"))
    return functional.cross_entropy(logits, _partners(count, rows))


def margin_loss(
    first: Tensor, second: Tensor, ignored: Tensor, *, low: float, high: float, hardest: int
) -> Tensor:
    """What lies on the wrong side of a fixed similarity, squared: it gives cosines a meaning.

    Pairs below `high`, and of each row's negatives the `hardest` above `low`, on average. Rows and
    `ignored` are those of `nt_xent`.
    """
    count = len(first)
    rows = torch.cat([first, second])
    partner = _partners(count, rows)
    positive = (rows * rows[partner]).sum(dim=1)
    above = functional.relu(rows @ rows.T - low).square()
    above = above.masked_fill(_blocked(ignored, rows), 0.0)
    above = above.scatter(1, partner[:, None], 0.0)
    worst = torch.topk(above, min(hardest, 2 * count), dim=1).values
    return functional.relu(high - positive).square().mean() + worst.mean()


def spot_contrast(logits: Tensor, square_m2: Tensor, near_m: float) -> Tensor:
    """Cross entropy of the spots similar to echoes against those that they were heard near.

    `logits` (n, m) are similarities over the temperature, `square_m2` (n, m) squared distances.
    Wanted is a Gaussian about where the echo was heard, in shares that sum to 1: positions
    between spots, which training may never hear, come to lie between them.
    """
    wanted = functional.softmax(-square_m2 / (2 * near_m**2), dim=1)
    return -(wanted * functional.log_softmax(logits, dim=1)).sum(dim=1).mean()


def _blocked(ignored: Tensor, rows: Tensor) -> Tensor:
    """Which of the similarities (2M, 2M) are neither of a pair nor of a negative."""
    count = len(ignored)
    itself = torch.eye(count, dtype=torch.bool, device=rows.device)
    diagonal = torch.eye(2 * count, dtype=torch.bool, device=rows.device)
    return (ignored & ~itself).repeat(2, 2) | diagonal


def _partners(count: int, rows: Tensor) -> Tensor:
    """The row (2M) of the other member of each row's pair."""
    order = torch.arange(2 * count, device=rows.device)
    return (order + count) % (2 * count)
