"""Dynamic time warping of short sequences, every one of some against every one of others."""

from __future__ import annotations

import numpy as np
from numba import njit

from elfslam.base.arrays import F64, Bool


def warping_costs(windows: F64, others: F64, band: int) -> F64:
    """Cost (n, m) of warping each of n stretches (w, c) onto each of m, per sample.

    Dynamic time warping with Euclidean cost and a Sakoe-Chiba band: samples that are matched lie
    at most `band` apart.
    """
    return warping_costs_where(
        np.ones((len(windows), len(others)), dtype=np.bool_), windows, others, band
    )


def warping_costs_where(wanted: Bool, windows: F64, others: F64, band: int) -> F64:
    """The same costs (n, m) where they are wanted (n, m), infinite elsewhere."""
    sequences = np.ascontiguousarray(windows), np.ascontiguousarray(others)
    return np.asarray(_warping_costs(wanted, *sequences, band))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _warping_costs(wanted: Bool, windows: F64, others: F64, band: int) -> F64:
    costs = np.full((len(windows), len(others)), np.inf)
    for i in range(len(windows)):
        for j in range(len(others)):
            if wanted[i, j]:
                costs[i, j] = _warping_cost(windows[i], others[j], band)
    return costs


@njit(cache=True)  # type: ignore[untyped-decorator]
def _warping_cost(one: F64, other: F64, band: int) -> float:
    size = len(one)
    before = np.full(size + 1, np.inf)
    before[0] = 0.0
    now = np.empty(size + 1)
    for i in range(1, size + 1):
        now[:] = np.inf
        for j in range(max(1, i - band), min(size, i + band) + 1):
            square = 0.0
            for k in range(one.shape[1]):
                square += (one[i - 1, k] - other[j - 1, k]) ** 2
            now[j] = np.sqrt(square) + min(before[j], before[j - 1], now[j - 1])
        before, now = now, before
    return float(before[size] / size)
