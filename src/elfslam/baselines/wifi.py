"""Wi-Fi similarity: which access points are heard along the walk, and how strongly.

The paper's baseline takes the scan nearest in time and compares the signal strengths by their
Euclidean distance. The tuned one takes every entry for what it is: an access point heard once, at
the time of the scan less the entry's age. Strengths are averaged over the footsteps around, so
that old entries neither repeat themselves nor count where they were not heard, and are compared by
the share of power that two places have in common (Ruzicka), which weighs what is heard at both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from elfslam.base.arrays import F64, I64, Value, array
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.parameters import parameter
from elfslam.base.values import Odometry, Similarity, WifiScans
from elfslam.stages.closure import ClosureParameters

VARIANTS = ("tuned", "paper")
SAME_SIGHTING_S = 0.05
"""Ages are rounded: entries that were heard this close in time are one sighting."""
FLOOR_WEIGHT = 0.2
"""What an access point that was not heard weighs, beside a sighting at the very moment."""
WIFI_CLOSURES = ClosureParameters(
    threshold=0.93,
    back_margin=0.0,
    along_sigma_m=4.0,
    across_sigma_m=4.0,
    heading_sigma_rad=2.0,
    shared_footsteps=20,
    sigma_fall=0.0,
    most_earned=0.0,
)
"""Wi-Fi knows the place to metres. The heading of a closure is that of its line alone: which way
the walker passes is told, how exactly is not."""


@dataclass(frozen=True)
class WifiFingerprintParameters:
    """How strengths are gathered at each footstep and compared."""

    variant: str = parameter("tuned", "", "tuned, or the paper's Euclidean distance")
    floor_dbm: float = parameter(
        -93.0, "dBm", "what an access point counts that was not heard", -120.0, -50.0
    )
    window_s: float = parameter(
        3.0, "s", "sightings count half this far from the footstep (tuned)", 0.1, 60.0
    )
    power: float = parameter(
        2.0, "", "exponent by which strong access points weigh more (tuned)", 0.1, 10.0
    )
    distance_scale_db: float = parameter(
        20.0, "dB", "distance where the score falls to 1/e (paper)", 0.1, 1000.0
    )


@dataclass(frozen=True, eq=False)
class Fingerprints(Value):
    """Strength (n, m) of each access point at each stretch of a walk; the floor where unheard."""

    bssids: tuple[str, ...]
    rssi_dbm: F64 = array("n", "m")


def wifi_similarity(
    wifi: WifiScans, nodes: Odometry, parameters: WifiFingerprintParameters
) -> Similarity:
    """Scores (n-1, n-1) in [0, 1] between stretches of a walk, symmetric, 1 for equal strengths.

    Raises InputError where no scan was made on the walk, ParameterError for an unknown variant.
    """
    heard = fingerprints(wifi, nodes, parameters)
    return Similarity(wifi_scores(heard, heard, parameters).astype(np.float32), kind="wifi")


def fingerprints(
    wifi: WifiScans, nodes: Odometry, parameters: WifiFingerprintParameters
) -> Fingerprints:
    """What is heard at the middle of each stretch between nodes.

    Raises InputError where no scan was made on the walk, ParameterError for an unknown variant.
    """
    _check(parameters)
    inside = (wifi.t_s >= nodes.t_s[0]) & (wifi.t_s <= nodes.t_s[-1])
    if not inside.any():
        raise InputError(
            f"Wi-Fi: got no scan between {nodes.t_s[0]:.1f} and {nodes.t_s[-1]:.1f} s of the walk; "
            "scan while walking"
        )
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    gather = _nearest_scan if parameters.variant == "paper" else _averaged_sightings
    return Fingerprints(wifi.bssids, gather(wifi, middle_s, parameters))


def wifi_scores(
    one: Fingerprints, other: Fingerprints, parameters: WifiFingerprintParameters
) -> F64:
    """Scores (n, m) in [0, 1] between the stretches of two walks, which may be the same."""
    _check(parameters)
    here, there = _on_common_columns(one, other, parameters.floor_dbm)
    if parameters.variant == "paper":
        return np.asarray(np.exp(-_distances(here, there) / parameters.distance_scale_db))
    return np.asarray(
        _common_shares(_above_floor(here, parameters), _above_floor(there, parameters))
    )


def sightings(wifi: WifiScans) -> tuple[F64, I64, F64]:
    """When (k, s) which column (k) was heard how strongly (k, dBm); repetitions count once."""
    scan, column = np.nonzero(np.isfinite(wifi.rssi_dbm))
    heard_s = wifi.t_s[scan] - np.nan_to_num(wifi.age_s[scan, column])
    order = np.lexsort((heard_s, column))
    scan, column, heard_s = scan[order], column[order], heard_s[order]
    again = (np.diff(column, prepend=-1) == 0) & (
        np.diff(heard_s, prepend=-np.inf) < SAME_SIGHTING_S
    )
    return heard_s[~again], column[~again], wifi.rssi_dbm[scan, column][~again]


def _check(parameters: WifiFingerprintParameters) -> None:
    if parameters.variant not in VARIANTS:
        raise ParameterError(
            f"wifi.variant: wanted {' or '.join(VARIANTS)}, got {parameters.variant!r}; choose one"
        )


def _nearest_scan(wifi: WifiScans, at_s: F64, parameters: WifiFingerprintParameters) -> F64:
    after = np.clip(np.searchsorted(wifi.t_s, at_s), 1, max(len(wifi.t_s) - 1, 1))
    after = np.minimum(after, len(wifi.t_s) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(wifi.t_s[before] - at_s) <= np.abs(wifi.t_s[after] - at_s)
    rssi_dbm = wifi.rssi_dbm[np.where(nearer, before, after)]
    return np.asarray(np.where(np.isfinite(rssi_dbm), rssi_dbm, parameters.floor_dbm))


def _averaged_sightings(wifi: WifiScans, at_s: F64, parameters: WifiFingerprintParameters) -> F64:
    """Means weighted by nearness in time; the floor weighs as much as a sighting far away."""
    heard_s, column, rssi_dbm = sightings(wifi)
    shape = (len(at_s), len(wifi.bssids))
    above, weight = _gathered(at_s, heard_s, column, rssi_dbm - parameters.floor_dbm,
                              parameters.window_s, shape)  # fmt: skip
    return np.asarray(parameters.floor_dbm + np.maximum(above / (weight + FLOOR_WEIGHT), 0.0))


def _on_common_columns(one: Fingerprints, other: Fingerprints, floor_dbm: float) -> tuple[F64, F64]:
    """Both with a column for each access point that either has heard."""
    if one.bssids == other.bssids:
        return one.rssi_dbm, other.rssi_dbm
    names = sorted({*one.bssids, *other.bssids})
    return on_columns(one, names, floor_dbm), on_columns(other, names, floor_dbm)


def on_columns(heard: Fingerprints, names: Sequence[str], floor_dbm: float) -> F64:
    """Strengths (n, c) at a column for each of these names, the floor where one is unheard."""
    column = {name: k for k, name in enumerate(names)}
    wide = np.full((len(heard.rssi_dbm), len(names)), floor_dbm)
    wide[:, [column[name] for name in heard.bssids]] = heard.rssi_dbm
    return wide


def _above_floor(rssi_dbm: F64, parameters: WifiFingerprintParameters) -> F64:
    above = np.maximum(rssi_dbm - parameters.floor_dbm, 0.0) / -parameters.floor_dbm
    return np.asarray(above**parameters.power)


def _distances(here: F64, there: F64) -> F64:
    square = (here**2).sum(axis=1)[:, None] - 2 * here @ there.T + (there**2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _gathered(
    at_s: F64, heard_s: F64, column: I64, value: F64, window_s: float, shape: tuple[int, int]
) -> tuple[F64, F64]:
    """Sums (n, m) of weighted values and of weights, Gaussian in time, cut at three windows."""
    sums, weights = np.zeros(shape), np.zeros(shape)
    for k in range(len(heard_s)):
        first = np.searchsorted(at_s, heard_s[k] - 3 * window_s)
        last = np.searchsorted(at_s, heard_s[k] + 3 * window_s)
        for i in range(first, last):
            weight = np.exp(-0.5 * ((at_s[i] - heard_s[k]) / window_s) ** 2)
            sums[i, column[k]] += weight * value[k]
            weights[i, column[k]] += weight
    return sums, weights


@njit(cache=True)  # type: ignore[untyped-decorator]
def _common_shares(here: F64, there: F64) -> F64:
    shares = np.zeros((len(here), len(there)))
    for i in range(len(here)):
        for j in range(len(there)):
            common, total = 0.0, 0.0
            for k in range(here.shape[1]):
                common += min(here[i, k], there[j, k])
                total += max(here[i, k], there[j, k])
            shares[i, j] = common / total if total > 0 else 0.0
    return shares


@dataclass(frozen=True)
class PlaceParameters:
    """How many mapped places tell where one is, and how much the more similar ones count."""

    count: int = parameter(12, "", "places whose mean is taken", 1, 1000)
    wifi_power: float = parameter(8.0, "", "exponent of the Wi-Fi score in the weight", 0.0)
    sigma_m: float = parameter(
        4.0, "m", "error of a position by Wi-Fi alone, besides how its places scatter", 0.01
    )
    near_m: float = parameter(
        15.0, "m", "the field is compared with places so near to where Wi-Fi has the walk", 0.1
    )


@dataclass(frozen=True, eq=False)
class WifiPlaces(Value):
    """Places (m) of a map and the power above the floor of each access point (c) there.

    One access point after the other, which is how they are added up.
    """

    bssids: tuple[str, ...]
    xy_m: F64 = array("m", 2)
    power: F64 = array("c", "m")


def wifi_places(
    heard: Sequence[Fingerprints], xy_m: Sequence[F64], parameters: WifiFingerprintParameters
) -> WifiPlaces:
    """The places of all walks of a map, from what each heard and where each has been.

    Raises InputError where there is no walk.
    """
    if not heard:
        raise InputError("Wi-Fi map: got no walk with scans, wanted one or more; add walks")
    names = tuple(sorted({name for each in heard for name in each.bssids}))
    power = np.vstack([powers(each, names, parameters) for each in heard])
    return WifiPlaces(names, np.vstack(xy_m), np.ascontiguousarray(power.T))


def place_scores(
    heard: Fingerprints, places: WifiPlaces, parameters: WifiFingerprintParameters
) -> F64:
    """Scores (n, m) in [0, 1] of all places: the share of power in common, as `wifi_scores` has it.

    What the map has never heard counts as different.
    """
    here = powers(heard, places.bssids, parameters)
    everything = powers(heard, heard.bssids, parameters).sum(axis=1)
    common = _in_common(here, places.power)
    total = everything[:, None] + places.power.sum(axis=0) - common
    return np.asarray(common / np.maximum(total, 1e-300))


def placed_by(scores: F64, xy_m: F64, parameters: PlaceParameters) -> tuple[F64, F64]:
    """Positions (n, 2) by scores (n, m) of places (m, 2), and how the best few scatter (n, 2, 2).

    The weighted mean of the best few; NaN where nothing is in common with any place.
    """
    count = min(parameters.count, len(xy_m))
    best = np.argpartition(-scores, count - 1, axis=1)[:, :count]
    weight = np.take_along_axis(scores, best, axis=1) ** parameters.wifi_power
    total = weight.sum(axis=1, keepdims=True)
    share = np.divide(weight, total, out=np.full_like(weight, np.nan), where=total > 0)
    mean_m = np.einsum("nk,nkd->nd", share, xy_m[best])
    off_m = xy_m[best] - mean_m[:, None]
    return mean_m, np.einsum("nk,nkd,nke->nde", share, off_m, off_m)


def powers(heard: Fingerprints, names: Sequence[str], parameters: WifiFingerprintParameters) -> F64:
    """Powers (n, c) of those access points, 0 where unheard."""
    column = {name: k for k, name in enumerate(names)}
    both = [k for k, name in enumerate(heard.bssids) if name in column]
    above = np.maximum(heard.rssi_dbm[:, both] - parameters.floor_dbm, 0.0) / -parameters.floor_dbm
    powers = np.zeros((len(heard.rssi_dbm), len(names)))
    powers[:, [column[heard.bssids[k]] for k in both]] = above**parameters.power
    return powers


@njit(cache=True)  # type: ignore[untyped-decorator]
def _in_common(here: F64, there: F64) -> F64:
    common = np.zeros((here.shape[0], there.shape[1]))
    for i in range(here.shape[0]):
        for k in range(here.shape[1]):
            if here[i, k] > 0:
                for j in range(there.shape[1]):
                    common[i, j] += min(here[i, k], there[k, j])
    return common
