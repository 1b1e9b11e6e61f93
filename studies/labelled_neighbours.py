"""Located by Wi-Fi scans whose true positions are known: the rival that was given the labels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Truth, WifiScans
from elfslam.baselines.wifi import Fingerprints, WifiFingerprintParameters
from elfslam.baselines.wifi_places import place_scores, powers, wifi_places

NEIGHBOURS = 3
UNHEARD_DBM = -104.0
POWED = WifiFingerprintParameters(floor_dbm=UNHEARD_DBM, power=float(np.e))
"""Strengths above the floor to the power of e (Torres-Sospedra et al. 2015). By these the share of
power in common orders places as Soerensen's distance does, which is a function of it."""
LINEAR = WifiFingerprintParameters(floor_dbm=UNHEARD_DBM, power=1.0)
Scan = tuple[WifiScans, Truth]
Alike = Callable[[Fingerprints], F64]


def labelled_neighbours(
    walks: Sequence[Scan], known: Sequence[Scan], distance: str
) -> Iterator[F64]:
    """Positions (k, 2) at the waypoints of each walk: each from the scans before and after it.

    A scan is where the three most alike scans of the known walks were, which are labelled with the
    truth.
    """
    xy_m = np.vstack([_true_at(scans.t_s, truth) for scans, truth in known])
    alike = ALIKE[distance]([_each(scans) for scans, _ in known])
    for scans, truth in walks:
        best = np.argsort(-alike(_each(scans)), axis=1, kind="stable")[:, :NEIGHBOURS]
        at_m = xy_m[best].mean(axis=1)
        yield _between(scans.t_s, at_m, truth.t_s)


def _each(scans: WifiScans) -> Fingerprints:
    heard = np.where(np.isfinite(scans.rssi_dbm), scans.rssi_dbm, UNHEARD_DBM)
    return Fingerprints(scans.bssids, heard)


def _true_at(t_s: F64, truth: Truth) -> F64:
    return _between(truth.t_s, truth.world_from_body[:, :2], t_s)


def _between(t_s: F64, xy_m: F64, at_s: F64) -> F64:
    return np.column_stack([np.interp(at_s, t_s, xy_m[:, axis]) for axis in (0, 1)])


def _soerensen(known: Sequence[Fingerprints]) -> Alike:
    nowhere = [np.zeros((len(each.rssi_dbm), 2)) for each in known]
    places = wifi_places(known, nowhere, POWED)
    return lambda one: place_scores(one, places, POWED)


def _euclidean(known: Sequence[Fingerprints]) -> Alike:
    """Minus the squared distances, but for what is heard at the one place and never there."""
    places = wifi_places(known, [np.zeros((len(each.rssi_dbm), 2)) for each in known], LINEAR)
    square = (places.power**2).sum(axis=0)

    def alike(one: Fingerprints) -> F64:
        here = powers(one, places.bssids, LINEAR)
        return np.asarray(2 * here @ places.power - square)

    return alike


ALIKE: Mapping[str, Callable[[Sequence[Fingerprints]], Alike]] = {
    "Soerensen": _soerensen,
    "Euclidean": _euclidean,
}
