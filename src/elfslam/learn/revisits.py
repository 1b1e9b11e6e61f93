"""Where a walk may come back to, as far as an encoder hears it: without any label."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from elfslam.base.arrays import F32, F64, I64, Bool


def windows_of(count: int, length: int) -> I64:
    """The window of each of `count` echoes: `length` consecutive ones share one."""
    return np.arange(count) // length


def window_means(values: F32 | F64, window: I64) -> F32:
    """Means (k, d) of the rows (n, d) of each window."""
    sums = np.zeros((int(window[-1]) + 1, values.shape[1]))
    np.add.at(sums, window, values)
    return (sums / np.bincount(window)[:, None]).astype(np.float32)


def likely_revisits(means: F32, line_windows: int, similarity: float) -> Bool:
    """Pairs of windows (k, k) on a stretch that sounds like another one.

    One window is similar to many places, a sequence to few: `similarity` is asked of the mean over
    `line_windows` windows that advance together, or one forward and one back.
    """
    scores = means @ means.T
    along = _mean_along(scores, line_windows)
    back = _mean_along(scores[:, ::-1], line_windows)[:, ::-1]
    return np.asarray(np.maximum(along, back) >= similarity, dtype=bool)


def beside(pairs: Bool, windows: int) -> Bool:
    """`pairs` (k, k) and those at most `windows` windows from one of them, on either side."""
    return np.asarray(maximum_filter(pairs, size=2 * windows + 1), dtype=bool)


def _mean_along(scores: F32, length: int) -> F32:
    """Mean of `length` elements along the diagonal about each element, fewer at the border."""
    half, size = length // 2, scores.shape
    total, count = np.zeros(size, dtype=np.float32), np.zeros(size, dtype=np.float32)
    for shift in range(-half, half + 1):
        here = tuple(slice(max(-shift, 0), max(extent - max(shift, 0), 0)) for extent in size)
        there = tuple(slice(max(shift, 0), max(extent + min(shift, 0), 0)) for extent in size)
        total[here] += scores[there]
        count[here] += 1
    return total / count
