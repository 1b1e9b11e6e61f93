"""What of an end error comes from where: one thing after the other is replaced by the truth."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64


def end_errors(estimate_m: F64, true_m: F64) -> dict[str, float]:
    """End errors as shares of the true path, by what was replaced by the truth.

    Both walks (n, 2) are given at the true positions, the estimate with its heading from the phone.
    Legs are the moves from one true position to the next.
    """
    estimate, true = (np.diff(xy_m @ np.array([1, 1j])) for xy_m in (estimate_m, true_m))
    length_m, walked_m = np.abs(true).sum(), np.abs(estimate).sum()
    ahead = estimate / np.maximum(np.abs(estimate), 1e-9)
    scale = length_m / max(float(walked_m), 1e-9)
    turn = np.exp(1j * np.angle(np.vdot(estimate, true)))
    towards = true / np.maximum(np.abs(true), 1e-9)
    replaced = {
        "nothing": estimate,
        "the whole length": scale * estimate,
        "the length of every leg": np.abs(true) * ahead,
        "the heading of the whole walk": turn * estimate,
        "the direction of every leg": np.abs(estimate) * towards,
        "directions of legs, whole length": scale * np.abs(estimate) * towards,
    }
    return {name: float(abs(legs.sum() - true.sum()) / length_m) for name, legs in replaced.items()}
