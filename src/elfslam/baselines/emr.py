"""Similarity by mains hum: how strongly power lines are heard at each harmonic, along the walk.

After the EMR SLAM that the paper compares with: a vector of amplitudes for each footstep, and
stretches of footsteps compared by dynamic time warping. Amplitudes have no sign: a stretch that is
walked back sounds the same in reverse order.
"""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import Emr, Odometry, Similarity
from elfslam.baselines.magnetic import warping_costs
from elfslam.stages.closure import ClosureParameters

EMR_CLOSURES = ClosureParameters(
    threshold=0.4,
    back_margin=0.0,
    along_sigma_m=1.0,
    across_sigma_m=0.3,
    heading_sigma_rad=0.4,
    shared_footsteps=10,
    sigma_fall=0.0,
    most_earned=0.0,
)


@dataclass(frozen=True)
class EmrParameters:
    """How stretches of hum are cut and compared."""

    half_window: int = parameter(8, "footsteps", "compared before and after each footstep", 0, 64)
    warp: int = parameter(1, "footsteps", "how far the warping may shift a footstep", 0, 64)
    quiet_uv: float = parameter(
        0.1, "uV", "amplitudes far below this are all one: noise", 1e-6, 1e6
    )
    cost_scale: float = parameter(
        1.0, "", "warping cost (in standard deviations) where the score falls to 1/e", 0.01
    )


def emr_similarity(emr: Emr, nodes: Odometry, parameters: EmrParameters) -> Similarity:
    """Scores (n-1, n-1) in [0, 1] between stretches: exp(-cost / scale), symmetric.

    Raises InputError where the hum was not recorded along the walk.
    """
    windows = hum_sequences(emr, nodes, parameters)
    return Similarity(emr_scores(windows, windows, parameters).astype(np.float32), kind="emr")


def hum_sequences(emr: Emr, nodes: Odometry, parameters: EmrParameters) -> F64:
    """The hum (n-1, w, h) around each stretch: log amplitudes, in deviations from their mean.

    Before the first and after the last footstep the nearest one is repeated.
    """
    inside = (emr.t_s >= nodes.t_s[0]) & (emr.t_s <= nodes.t_s[-1])
    if inside.sum() < 2:
        raise InputError(
            f"EMR: got {inside.sum()} samples between {nodes.t_s[0]:.1f} and "
            f"{nodes.t_s[-1]:.1f} s of the walk, wanted at least 2; record it while walking"
        )
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    level = np.log(emr.amplitude + parameters.quiet_uv)
    hum = np.column_stack([np.interp(middle_s, emr.t_s, column) for column in level.T])
    hum = (hum - hum.mean(axis=0)) / np.maximum(hum.std(axis=0), 1e-9)
    reach = np.arange(-parameters.half_window, parameters.half_window + 1)
    rows = np.clip(np.arange(len(hum))[:, None] + reach, 0, len(hum) - 1)
    return np.asarray(hum[rows] / np.sqrt(hum.shape[1]))


def emr_scores(windows: F64, others: F64, parameters: EmrParameters) -> F64:
    """Scores (n, m) between the stretches of two walks, which may be the same."""
    costs = np.minimum(
        warping_costs(windows, others, parameters.warp),
        warping_costs(windows, others[:, ::-1], parameters.warp),
    )
    return np.asarray(np.exp(-costs / parameters.cost_scale))
