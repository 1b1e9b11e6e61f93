"""Dynamic time warping of short sequences, every one of some against every one of others."""

from __future__ import annotations

import numpy as np
from numba import njit

from elfslam.base.arrays import F64


def warping_costs(windows: F64, others: F64, band: int) -> F64:
    """Cost (n, m) of warping each of n stretches (w, c) onto each of m, per sample.

    Dynamic time warping with Euclidean cost and a Sakoe-Chiba band: samples that are matched lie
    at most `band` apart.
    """
    return np.asarray(
        _warping_costs(np.ascontiguousarray(windows), np.ascontiguousarray(others), band)
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _warping_costs(windows: F64, others: F64, band: int) -> F64:
    costs = np.empty((len(windows), len(others)))
    for i in range(len(windows)):
        for j in range(len(others)):
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
