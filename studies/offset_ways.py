"""Ways to tell how two footsteps that sound alike lie to each other, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.line.closure import ClosureParameters
from elfslam.world.air import SPEED_OF_SOUND_MPS
from studies.offset_pairs import FINE_S, Pairs

TENTHS = 10
WINDOW, REACH = 50, 24
"""Of the envelope: 5 ms are looked for up to 2.4 ms, 0.8 m of path, earlier or later."""
RIDGE = 10.0
STEPS, BATCH, HIDDEN, DROPPED = 1500, 256, 96, 0.5


class Told(NamedTuple):
    """Offsets (n, 3) along, across and in heading, and their standard deviations (n, 3)."""

    mean: F64
    sigma: F64


Teller = Callable[[Pairs], Told]


def as_the_line_claims(pairs: Pairs) -> Told:
    """No offset, by the sigmas of a loop closure."""
    line = ClosureParameters()
    sigma = np.array([line.along_sigma_m, line.across_sigma_m, line.heading_sigma_rad])
    none = np.zeros_like(pairs.offset)
    return Told(none, none + sigma)


def by_likeness(known: Pairs) -> Teller:
    """No offset, by sigmas whose logarithm falls with the likeness, as over tenths of `known`."""
    tenths = np.array_split(np.argsort(known.likeness), TENTHS)
    likeness = [known.likeness[rows].mean() for rows in tenths]
    rms = [np.sqrt(np.mean(known.offset[rows] ** 2, axis=0)) for rows in tenths]
    slope, log_sigma = np.polyfit(likeness, np.log(rms), 1)

    def tell(pairs: Pairs) -> Told:
        sigma = np.exp(pairs.likeness[:, None] * slope + log_sigma)
        return Told(np.zeros_like(pairs.offset), sigma)

    return tell


def by_matched_filter(known: Pairs) -> Teller:
    """By how much later each 5 ms of the echo come: ridge regression on `known` pairs."""
    seen = _lag_terms(known)
    weights = np.linalg.solve(seen.T @ seen + RIDGE * np.eye(seen.shape[1]), seen.T @ known.offset)
    sigma = np.sqrt(np.mean((known.offset - seen @ weights) ** 2, axis=0))

    def tell(pairs: Pairs) -> Told:
        mean = _lag_terms(pairs) @ weights
        return Told(mean, np.zeros_like(mean) + sigma)

    return tell


def by_head(known: Pairs) -> Teller:
    """By a network of two layers on both features, their product and all lags: Gaussian likelihood.

    Nix and Weigend 1994. The same for the same pairs, on one thread.
    """
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(0)
    seen = _head_terms(known)
    middle, spread = seen.mean(axis=0), seen.std(axis=0) + 1e-6
    net = torch.nn.Sequential(
        torch.nn.Dropout(DROPPED), torch.nn.Linear(seen.shape[1], HIDDEN), torch.nn.ReLU(),
        torch.nn.Dropout(DROPPED), torch.nn.Linear(HIDDEN, 6),
    )  # fmt: skip
    optimizer = torch.optim.AdamW(net.parameters(), 1e-3, weight_decay=1e-2)
    inputs = torch.from_numpy((seen - middle) / spread)
    wanted = torch.from_numpy(known.offset.astype(np.float32))
    for _ in range(STEPS):
        rows = torch.randint(0, len(inputs), (BATCH,))
        mean, log_sigma = net(inputs[rows]).split(3, dim=1)
        log_sigma = log_sigma.clamp(-4, 1)
        missed = (wanted[rows] - mean) / log_sigma.exp()
        loss = (0.5 * missed.square() + log_sigma).sum(dim=1).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    net.eval()

    def tell(pairs: Pairs) -> Told:
        with torch.no_grad():
            mean, log_sigma = net(torch.from_numpy((_head_terms(pairs) - middle) / spread)).split(
                3, dim=1
            )
        return Told(mean.double().numpy(), log_sigma.clamp(-4, 1).exp().double().numpy())

    return tell


LEARNT: Mapping[str, Callable[[Pairs], Teller]] = {
    "zero, by likeness": by_likeness,
    "matched filter": by_matched_filter,
    "head": by_head,
}


def lags_of(pairs: Pairs) -> tuple[F64, F64]:
    """How much longer the path of each 5 ms of the first echo is in the second (n, w), in metres.

    And how alike they are there (n, w), -1 to 1.
    """
    starts = range(0, pairs.heard.shape[1] - WINDOW + 1, WINDOW)
    found = [_lag(pairs.heard[:, at : at + WINDOW], pairs.again, at) for at in starts]
    longer, alike = (np.stack(column, axis=1) for column in zip(*found, strict=True))
    return longer * FINE_S * SPEED_OF_SOUND_MPS, alike


def _lag(window: F32, again: F32, at: int) -> tuple[F64, F64]:
    """The shift at which a window (n, t) that begins at `at` is found again, and how alike."""
    shifts = [s for s in range(-REACH, REACH + 1) if 0 <= at + s <= again.shape[1] - WINDOW]
    wanted = _standardised(window)
    alike = np.stack(
        [
            np.einsum("nt,nt->n", wanted, _standardised(again[:, at + s : at + s + WINDOW]))
            for s in shifts
        ]
    )
    best = alike.argmax(axis=0)
    return np.array(shifts, np.float64)[best], alike[best, np.arange(len(best))].astype(np.float64)


def _standardised(rows: F32) -> F32:
    rest = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(rest / np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), 1e-12))


def _lag_terms(pairs: Pairs) -> F64:
    longer, alike = lags_of(pairs)
    one = np.ones((len(longer), 1))
    return np.hstack([longer, longer * alike, np.abs(longer), alike, one])


def _head_terms(pairs: Pairs) -> F32:
    features = [pairs.first, pairs.second, pairs.first * pairs.second]
    return np.hstack([*features, *lags_of(pairs), pairs.likeness[:, None]]).astype(np.float32)
