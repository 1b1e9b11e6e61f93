"""Echo sequence similarity (ESS) between the footsteps of a walk."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import Features, MeanSimilarity, Odometry


def footstep_means(features: Features, footsteps_t_s: F64) -> F32:
    """Mean feature (n-1, d) of the echoes between footsteps k and k+1; zero where there is none.

    The mean of unit vectors is kept as it is: its dot products are then exactly the means of the
    pairwise cosines, which is the ESS (paper, section 5.3.1).
    """
    node = np.searchsorted(footsteps_t_s, features.t_s, side="right") - 1
    inside = (node >= 0) & (node < len(footsteps_t_s) - 1)
    sums = np.zeros((len(footsteps_t_s) - 1, features.vectors.shape[1]))
    np.add.at(sums, node[inside], features.vectors[inside])
    counts = np.bincount(node[inside], minlength=len(sums))
    return (sums / np.maximum(counts, 1)[:, None]).astype(np.float32)


def echo_sequence_similarity(features: Features, nodes: Odometry) -> MeanSimilarity:
    """ESS between all footsteps, symmetric."""
    means = footstep_means(features, nodes.t_s)
    return MeanSimilarity(means, kind=f"elf:{features.encoder}")
