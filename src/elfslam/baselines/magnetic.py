"""Geomagnetic similarity: the field along the walk, compared by dynamic time warping.

Steel and wiring bend the field in a way that stays with the place. The paper's baseline (after
Wang et al., keyframe-based geomagnetic SLAM) warps the normalised field of one footstep, in the
phone's axes and by time, onto that of another. The tuned one levels the field by roll and pitch,
samples it by distance walked, and warps the stretches around any two nodes, as walked and turned
round. Yaw is never used.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy import ndimage
from scipy.spatial.transform import Rotation, Slerp

from elfslam.base.arrays import F64, Bool, Value, array
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.parameters import parameter
from elfslam.base.values import Imu, Magnetometer, Odometry, Orientation, Similarity
from elfslam.stages.closure import ClosureParameters


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


VARIANTS = ("tuned", "paper")
PAPER_SAMPLES = 25
"""Of a footstep: half a second at 50 samples/s, whatever the pace."""
GRAVITY_WINDOW_S = 1.0
"""A stride: over it the acceleration of walking averages out."""

TURNED_ROUND = {1: np.array([1.0]), 3: np.array([-1.0, -1.0, 1.0])}
"""What walking the other way does to the magnitude alone, and to forward, left and up."""
LOOKS_AHEAD = np.array([0.0, 1.0, -1.0])
"""A phone axis that is never vertical, be the phone held flat or upright."""
MAGNETIC_CLOSURES = ClosureParameters(
    threshold=0.65,
    back_margin=0.0,
    along_sigma_m=0.5,
    across_sigma_m=0.5,
    heading_sigma_rad=0.35,
    shared_footsteps=2,
    sigma_fall=0.0,
    most_earned=0.0,
)
"""Chosen on the simulated development worlds, levelled by gravity."""


@dataclass(frozen=True)
class MagneticParameters:
    """How stretches of the magnetic field are cut and compared, most of it for `tuned` alone."""

    variant: str = parameter("tuned", "", "tuned, or the paper's warping footstep by footstep")
    spacing_m: float = parameter(0.25, "m", "distance between samples of the field", 0.02)
    half_window_m: float = parameter(2.0, "m", "length compared before and after each node", 0.1)
    warp_m: float = parameter(0.5, "m", "how far the warping may shift a sample", 0.0)
    least_variation_ut: float = parameter(
        2.0, "uT", "components that vary less are not scaled up to unit variance", 0.1
    )
    cost_scale: float = parameter(
        0.82, "", "warping cost (in standard deviations) where the score falls to 1/e", 0.01
    )


def magnetic_similarity(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    parameters: MagneticParameters,
) -> Similarity:
    """Scores (n-1, n-1) in [0, 1]: exp(-cost / scale), symmetric, 1 for a stretch and itself.

    Raises InputError where the magnetometer does not cover the walk, ParameterError for an
    unknown variant.
    """
    windows = field_sequences(magnetometer, orientation, nodes, parameters)
    scores = magnetic_scores(windows, windows, parameters)
    return Similarity(np.asarray((scores + scores.T) / 2, np.float32), kind="magnetic")


def magnetic_scores(windows: F64, others: F64, parameters: MagneticParameters) -> F64:
    """Scores (n, m) in [0, 1] between the stretches of two walks, which may be the same.

    Tuned, a stretch is compared as it was walked and turned round, and the better of the two
    counts.
    """
    if parameters.variant == "paper":
        costs = warping_costs(windows, others, windows.shape[1])
    else:
        band = round(parameters.warp_m / parameters.spacing_m)
        costs = np.minimum(
            warping_costs(windows, others, band), warping_costs(windows, turned_round(others), band)
        )
    return np.asarray(np.exp(-costs / parameters.cost_scale))


def field_sequences(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    parameters: MagneticParameters,
) -> F64:
    """The field (n-1, w, c) of each stretch between nodes: around its middle, sampled by distance.

    The components are forward, left and up of the levelled phone, or the magnitude alone where the
    orientation is unknown; each without its mean over the walk, in standard deviations. The paper's
    are those of the phone, within the stretch, sampled by time.
    """
    if parameters.variant not in VARIANTS:
        raise ParameterError(
            f"magnetic.variant: wanted {' or '.join(VARIANTS)}, got {parameters.variant!r}; "
            "choose one"
        )
    if parameters.variant == "paper":
        return _by_time(magnetometer, nodes, parameters)
    profile = field_profile(magnetometer, orientation, nodes, parameters)
    middle_m = (profile.walked_m[1:] + profile.walked_m[:-1]) / 2
    reach = round(parameters.half_window_m / parameters.spacing_m)
    offsets_m = parameters.spacing_m * np.arange(-reach, reach + 1)
    return profile.at(middle_m[:, None] + offsets_m)


@dataclass(frozen=True, eq=False)
class FieldProfile(Value):
    """The field (s, c) at distances walked (s), and the distance walked to each node (n)."""

    along_m: F64 = array("s", increasing=True)
    field: F64 = array("s", "c")
    walked_m: F64 = array("n")

    def at(self, walked_m: F64) -> F64:
        """The field (..., c) at any distances walked (...)."""
        columns = [np.interp(walked_m, self.along_m, column) for column in self.field.T]
        return np.stack(columns, axis=-1)


def field_profile(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    parameters: MagneticParameters,
) -> FieldProfile:
    """The normalised field along a walk. Raises InputError where the magnetometer is off."""
    seen = field_by_distance(magnetometer, orientation, nodes, parameters.spacing_m)
    return replace(seen, field=_normalised(seen.field, parameters))


def field_by_distance(
    magnetometer: Magnetometer, orientation: Orientation | None, nodes: Odometry, spacing_m: float
) -> FieldProfile:
    """The levelled field along a walk, microtesla, its mean in cells of equal length.

    Raises InputError where the magnetometer does not cover the walk.
    """
    inside = _covering(magnetometer.t_s, nodes.t_s)
    field = levelled_field(magnetometer, orientation)[inside]
    steps_m = np.linalg.norm(np.diff(nodes.world_from_body[:, :2], axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    at_m = np.interp(magnetometer.t_s[inside], nodes.t_s, walked_m)
    cell = np.round(at_m / spacing_m).astype(int)
    counts = np.bincount(cell)
    seen = np.flatnonzero(counts)
    sums = np.column_stack([np.bincount(cell, weights=column) for column in field.T])
    return FieldProfile(
        np.asarray(seen * spacing_m), np.asarray(sums[seen] / counts[seen, None]), walked_m
    )


def levelled_field(magnetometer: Magnetometer, orientation: Orientation | None) -> F64:
    """The field (n, 3), forward, left and up of the phone held level, microtesla.

    Without an orientation only its magnitude (n, 1). Turning the walker about the vertical turns
    forward and left with it: no yaw enters.
    """
    if orientation is None or len(orientation.t_s) < 2:
        return np.asarray(np.linalg.norm(magnetometer.field_ut, axis=1, keepdims=True))
    attitude = Slerp(orientation.t_s, Rotation.from_quat(orientation.world_from_phone))
    at_s = np.clip(magnetometer.t_s, orientation.t_s[0], orientation.t_s[-1])
    world_from_phone = attitude(at_s).as_matrix()
    east, north, up = np.einsum("nij,nj->in", world_from_phone, magnetometer.field_ut)
    ahead = (world_from_phone @ LOOKS_AHEAD)[:, :2]
    cos, sin = (ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)).T
    return np.column_stack([cos * east + sin * north, cos * north - sin * east, up])


def level_by_gravity(imu: Imu) -> Orientation:
    """Roll and pitch from the accelerometer, where the phone tells no orientation; any yaw."""
    size = max(1, round(GRAVITY_WINDOW_S / float(np.median(np.diff(imu.t_s)))))
    up = ndimage.uniform_filter1d(imu.accel_mps2, size, axis=0, mode="nearest")
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    north = LOOKS_AHEAD - (up @ LOOKS_AHEAD)[:, None] * up
    north = north / np.linalg.norm(north, axis=1, keepdims=True)
    world_from_phone = np.stack([np.cross(north, up), north, up], axis=1)
    return Orientation(imu.t_s, Rotation.from_matrix(world_from_phone).as_quat())


def turned_round(windows: F64) -> F64:
    """The same stretches walked the other way: order reversed, forward and left with other sign."""
    return np.asarray(windows[:, ::-1] * TURNED_ROUND[windows.shape[2]])


def _covering(t_s: F64, nodes_t_s: F64) -> Bool:
    inside: Bool = (t_s >= nodes_t_s[0]) & (t_s <= nodes_t_s[-1])
    if inside.sum() < 2:
        raise InputError(
            f"magnetometer: got {inside.sum()} samples between {nodes_t_s[0]:.1f} and "
            f"{nodes_t_s[-1]:.1f} s of the walk, wanted at least 2; record it while walking"
        )
    return inside


def _by_time(magnetometer: Magnetometer, nodes: Odometry, parameters: MagneticParameters) -> F64:
    """The field (n-1, PAPER_SAMPLES, 3) in the phone's axes from each node to the next."""
    inside = _covering(magnetometer.t_s, nodes.t_s)
    normal = _normalised(magnetometer.field_ut[inside], parameters)
    share = (np.arange(PAPER_SAMPLES) + 0.5) / PAPER_SAMPLES
    at_s = nodes.t_s[:-1, None] + np.diff(nodes.t_s)[:, None] * share
    columns = [np.interp(at_s, magnetometer.t_s[inside], column) for column in normal.T]
    return np.stack(columns, axis=-1)


def _normalised(sampled: F64, parameters: MagneticParameters) -> F64:
    """Without the mean, which holds the phone's own magnetism, and of comparable variation."""
    variation_ut = np.maximum(sampled.std(axis=0), parameters.least_variation_ut)
    return np.asarray((sampled - sampled.mean(axis=0)) / variation_ut)
