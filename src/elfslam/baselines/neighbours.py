"""Many walks of one floor: which places of other walks each place is most similar to.

Two walks of a large floor may cross, share a corridor for a while, or never meet. Their best
pair would pull together what only lies next to each other, so no pair of walks is joined as such:
each place is drawn towards the mean of the few places, of all other walks, most similar to it,
which lie on all sides of it. Many such weak pulls share their errors, so each is given little
weight; nothing is known of headings.
"""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.parameters import parameter
from elfslam.base.values import Closures, Magnetometer, Odometry, Orientation
from elfslam.baselines.magnetic import field_by_distance, warping_costs_where

UNKNOWN_HEADING_RAD = 100.0
"""Far more than a full turn: such a sigma leaves the heading free."""
LEAST_SHARE = 1e-9
"""Of all pulls on a place; what has less of them pulls nothing."""


@dataclass(frozen=True)
class NeighbourParameters:
    """What places are compared by, and how strongly those that are alike attract each other."""

    count: int = parameter(6, "", "places that draw a place towards them", 1, 1000)
    within_m: float = parameter(
        20.0, "m", "dead reckoning is never so far off: what lies beyond is not asked", 0.1
    )
    wifi_power: float = parameter(8.0, "", "exponent of the Wi-Fi score in the weight", 0.0)
    field_scale: float = parameter(
        1.0, "", "warping cost where the weight by field falls to 1/e", 0.01
    )
    field_unit_ut: float = parameter(8.0, "uT", "difference of the field that costs 1", 0.01)
    half_window_m: float = parameter(8.0, "m", "field compared before and after", 0.1)
    spacing_m: float = parameter(0.5, "m", "distance between samples of the field", 0.05)
    warp_m: float = parameter(1.5, "m", "how far the warping may shift a sample", 0.0)
    sigma_m: float = parameter(20.0, "m", "error of all pulls on one place together", 0.01)


def candidates(xy_m: F64, walk: I64, parameters: NeighbourParameters) -> Bool:
    """Which places (n, n) may be the same: of two walks, and near by dead reckoning (n, 2)."""
    apart_m = np.linalg.norm(xy_m[:, None] - xy_m[None], axis=2)
    return np.asarray((apart_m <= parameters.within_m) & (walk[:, None] != walk[None]))


def field_windows(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    parameters: NeighbourParameters,
) -> F64:
    """The field (n, w, 2) about each node: its horizontal strength and its upward part.

    Its mean is kept: between walks the strength itself says more than its shape, which
    changes with the side of the corridor. Raises InputError where the magnetometer is off.
    """
    seen = field_by_distance(magnetometer, orientation, nodes, parameters.spacing_m)
    reach = round(parameters.half_window_m / parameters.spacing_m)
    offsets_m = parameters.spacing_m * np.arange(-reach, reach + 1)
    field = seen.at(seen.walked_m[:, None] + offsets_m)
    horizontal = np.linalg.norm(field[..., :-1], axis=-1)
    return np.stack([horizontal, field[..., -1]], axis=-1) / parameters.field_unit_ut


def field_weights(
    windows: F64, heading_rad: F64, near: Bool, parameters: NeighbourParameters
) -> F64:
    """Weights (n, n) in [0, 1] of near places by their field; against each other in reverse."""
    band = round(parameters.warp_m / parameters.spacing_m)
    same_way = np.cos(heading_rad[:, None] - heading_rad[None]) > 0
    costs = np.minimum(
        warping_costs_where(near & same_way, windows, windows, band),
        warping_costs_where(near & ~same_way, windows, windows[:, ::-1], band),
    )
    return np.asarray(np.exp(-costs / parameters.field_scale))


def neighbour_closures(weights: F64, parameters: NeighbourParameters) -> Closures:
    """Closures of each place with those (n, n) that weigh most, together as exact as sigma says."""
    count = min(parameters.count, len(weights))
    least = -np.sort(-weights, axis=1)[:, count - 1 : count]
    strongest = np.where((weights >= least) & (weights > 0), weights, 0.0)
    share = strongest / np.maximum(strongest.sum(axis=1, keepdims=True), 1e-300)
    share = np.triu(share + share.T)
    i, j = np.nonzero(share > LEAST_SHARE)
    variance_m2 = parameters.sigma_m**2 / share[i, j]
    covariance = np.zeros((len(i), 3, 3))
    covariance[:, 0, 0] = covariance[:, 1, 1] = variance_m2
    covariance[:, 2, 2] = UNKNOWN_HEADING_RAD**2
    return Closures(i, j, weights[i, j], np.zeros((len(i), 3)), covariance)
