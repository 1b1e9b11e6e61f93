"""Revisits heard without labels: planted ones are found, chance likenesses are not."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.learn.revisits import beside, likely_revisits, window_means, windows_of


def unit_rows(count: int, seed: int = 0) -> F32:
    rows = np.random.default_rng(seed).standard_normal((count, 64))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


def test_windows_are_means_of_consecutive_echoes() -> None:
    window = windows_of(7, 3)
    assert window.tolist() == [0, 0, 0, 1, 1, 1, 2]
    means = window_means(np.arange(7, dtype=np.float32)[:, None], window)
    assert means[:, 0].tolist() == [1.0, 4.0, 6.0]


@pytest.mark.parametrize("back", [False, True])
def test_a_stretch_walked_again_is_found_and_a_single_likeness_is_not(back: bool) -> None:
    rows = unit_rows(40)
    rows[25:35] = rows[5:15][::-1] if back else rows[5:15]
    rows[20] = rows[1]
    found = likely_revisits(rows, 5, 0.5)
    here = np.arange(7, 13)
    assert found[here, 39 - here if back else here + 20].all()
    assert not found[1, 20]
    assert (found == found.T).all()
    assert found.diagonal().all(), "every stretch is like itself"


def test_the_mean_along_a_line_is_that_of_a_loop() -> None:
    rows = unit_rows(12, 3)
    scores = rows @ rows.T
    for threshold in (-0.05, 0.0, 0.05):
        found = likely_revisits(rows, 5, threshold)
        for i in range(12):
            for j in range(12):
                means = [
                    np.mean([
                        scores[i + k, j + turn * k]
                        for k in range(-2, 3)
                        if 0 <= i + k < 12 and 0 <= j + turn * k < 12
                    ])
                    for turn in (1, -1)
                ]  # fmt: skip
                assert abs(max(means) - threshold) < 1e-5 or found[i, j] == (
                    max(means) >= threshold
                )


def test_beside_reaches_as_far_as_asked() -> None:
    pairs = np.zeros((9, 9), dtype=bool)
    pairs[4, 2] = True
    assert (beside(pairs, 0) == pairs).all()
    assert np.argwhere(beside(pairs, 1)).tolist() == [[i, j] for i in (3, 4, 5) for j in (1, 2, 3)]
