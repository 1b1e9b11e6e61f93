"""Where Wi-Fi places a walker on a floor that many walks have mapped: the mean of what is alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.baselines.wifi import Fingerprints, WifiFingerprintParameters


@dataclass(frozen=True)
class PlaceParameters:
    """How many mapped places tell where one is, and how much the more similar ones count."""

    count: int = parameter(12, "", "places whose mean is taken", low=1, high=1000)
    wifi_power: float = parameter(8.0, "", "exponent of the Wi-Fi score in the weight", low=0.0)
    sigma_m: float = parameter(
        4.0, "m", "error of a position by Wi-Fi alone, besides how its places scatter", low=0.01
    )
    near_m: float = parameter(
        15.0, "m", "the field is compared with places so near to where Wi-Fi has the walk", low=0.1
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
