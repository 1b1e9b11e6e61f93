"""Maps: spots with positions and what they sound like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import interpolate_poses
from elfslam.base.parameters import parameter
from elfslam.base.values import Features, FloorMap, Payload, Trajectory


@dataclass(frozen=True)
class FloorMapParameters:
    """How a walk becomes spots."""

    window_s: float = parameter(0.6, "s", "echoes around a spot that make its feature", 0.1, 60.0)


def trajectory_map(
    trajectory: Trajectory,
    features: Features,
    parameters: FloorMapParameters,
    *,
    parameters_digest: str,
    source: str,
) -> FloorMap:
    """The map of one walk: a spot per echo, so that half a footstep is not the floor of the error.

    A spot's ELF is the mean over the echoes within the window about it. Echoes before the first
    and after the last footstep have no position and give no spot.
    """
    inside = (features.t_s >= trajectory.t_s[0]) & (features.t_s <= trajectory.t_s[-1])
    t_s = features.t_s[inside]
    poses = interpolate_poses(trajectory.t_s, trajectory.world_from_body, t_s)
    node = np.clip(
        np.searchsorted(trajectory.t_s, t_s, side="right") - 1, 0, len(trajectory.t_s) - 1
    )
    vectors = window_means(features, t_s, parameters.window_s)
    return FloorMap(
        xy_m=poses[:, :2],
        heading_rad=poses[:, 2],
        walk=np.zeros(len(t_s), dtype=np.int64),
        order=np.arange(len(t_s)),
        covariance_m2=trajectory.covariance[node][:, :2, :2],
        payloads=(Payload("elf", features.encoder, vectors),),
        parameters_digest=parameters_digest,
        sources=(source,),
    )


def window_means(features: Features, centres_t_s: F64, window_s: float) -> F32:
    """Mean features (m, d) within half a window of each centre; zero where there is none."""
    first = np.searchsorted(features.t_s, centres_t_s - window_s / 2 - 1e-9)
    last = np.searchsorted(features.t_s, centres_t_s + window_s / 2 + 1e-9)
    sums = np.vstack(
        [np.zeros(features.vectors.shape[1]), np.cumsum(features.vectors, axis=0, dtype=np.float64)]
    )
    counts = np.maximum(last - first, 1)
    return np.asarray((sums[last] - sums[first]) / counts[:, None], dtype=np.float32)
