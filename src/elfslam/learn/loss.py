"""The contrastive losses."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def nt_xent(first: Tensor, second: Tensor, ignored: Tensor, temperature: float) -> Tensor:
    """Normalised temperature-scaled cross entropy over M positive pairs (SimCLR, Chen et al. 2020).

    `first`, `second` (M, d) are unit rows; `ignored` (M, M) marks pairs of places that are too
    close to count as negatives (its diagonal is not read).
    """
    count = len(first)
    rows = torch.cat([first, second])
    logits = rows @ rows.T / temperature
    logits = logits.masked_fill(_blocked(ignored, rows), float("-inf"))
    return functional.cross_entropy(logits, _partners(count, rows))


def margin_loss(
    similarity: Tensor, wanted: Tensor, elsewhere: Tensor, *, low: float, hardest: int
) -> Tensor:
    """What lies on the wrong side of a fixed similarity, squared: it gives cosines a meaning.

    Of `similarity` (n, n), pairs on its diagonal that are below `wanted` (n), and of each row the
    `hardest` of those `elsewhere` (n, n) that are above `low`, on average.
    """
    above = functional.relu(similarity - low).square().masked_fill(~elsewhere, 0.0)
    worst = torch.topk(above, min(hardest, len(above)), dim=1).values
    return functional.relu(wanted - similarity.diagonal()).square().mean() + worst.mean()


def spot_contrast(logits: Tensor, square_m2: Tensor, near_m: float) -> Tensor:
    """Cross entropy of the spots that echoes resemble against those that they were heard near.

    `logits` (n, m) are similarities over the temperature, `square_m2` (n, m) squared distances,
    infinite where a spot is another place whatever the distance. Wanted is a Gaussian about where
    the echo was heard, in shares that sum to 1: positions between spots, which training may never
    hear, come to lie between them.
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
