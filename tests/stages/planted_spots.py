"""A map whose spots lie on a walk, and how alike its places sound to who walks there again."""

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import FloorMap

STEP_M = 0.7


def made_map(poses: F64) -> FloorMap:
    count = len(poses)
    return FloorMap(
        poses[:, :2], poses[:, 2], np.zeros(count), np.arange(count),
        np.tile(0.01 * np.eye(2), (count, 1, 1)), (), "digest", ("walk",),
    )  # fmt: skip


def heard(poses: F64, floor_map: FloorMap, reach_m: float = 1.0) -> F32:
    """Likeness 0.95 where the walker is in the middle of each step, falling with distance."""
    middle_m = (poses[1:, :2] + poses[:-1, :2]) / 2
    away_m = np.linalg.norm(middle_m[:, None] - floor_map.xy_m[None], axis=2)
    return np.asarray(0.95 * np.exp(-((away_m / reach_m) ** 2) / 2), np.float32)
