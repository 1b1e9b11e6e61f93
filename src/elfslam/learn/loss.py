"""The contrastive loss."""

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
    itself = torch.eye(count, dtype=torch.bool, device=rows.device)
    blocked = (ignored & ~itself).repeat(2, 2) | torch.eye(
        2 * count, dtype=torch.bool, device=rows.device
    )
    logits = logits.masked_fill(blocked, float("-inf"))
    target = torch.cat([torch.arange(count, 2 * count), torch.arange(count)]).to(rows.device)
    return functional.cross_entropy(logits, target)
