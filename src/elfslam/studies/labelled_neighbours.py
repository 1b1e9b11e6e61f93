"""Located by Wi-Fi scans whose true positions are known: the rival that was given the labels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Truth, WifiScans
from elfslam.baselines.wifi import Fingerprints, WifiParameters
from elfslam.baselines.wifi_places import place_scores, wifi_places

NEIGHBOURS = 3
UNHEARD_DBM = -104.0
POWED = WifiParameters(floor_dbm=UNHEARD_DBM, power=float(np.e))
"""Strengths above the floor to the power of e (Torres-Sospedra et al. 2015). By these the share of
power in common orders places as Soerensen's distance does, which is a function of it."""
Scan = tuple[WifiScans, Truth]
Alike = Callable[[Fingerprints, Sequence[Fingerprints]], F64]


def labelled_neighbours(walk: Scan, known: Sequence[Scan], distance: str) -> F64:
    """Positions (k, 2) at the waypoints of a walk: each from the scan that is nearest in time.

    The mean of the three most alike scans of all other walks, which are labelled with the truth.
    """
    scans, truth = walk
    xy_m = np.vstack([_true_at(other.t_s, waypoints) for other, waypoints in known])
    alike = ALIKE[distance](_each(scans), [_each(other) for other, _ in known])
    best = np.argsort(-alike, axis=1, kind="stable")[:, :NEIGHBOURS]
    at_m = xy_m[best].mean(axis=1)
    nearest = np.abs(scans.t_s[:, None] - truth.t_s[None]).argmin(axis=0)
    return np.asarray(at_m[nearest])


def _each(scans: WifiScans) -> Fingerprints:
    heard = np.where(np.isfinite(scans.rssi_dbm), scans.rssi_dbm, UNHEARD_DBM)
    return Fingerprints(scans.bssids, heard)


def _true_at(t_s: F64, truth: Truth) -> F64:
    xy_m = truth.world_from_body[:, :2]
    return np.column_stack([np.interp(t_s, truth.t_s, xy_m[:, axis]) for axis in (0, 1)])


def _soerensen(one: Fingerprints, others: Sequence[Fingerprints]) -> F64:
    nowhere = [np.zeros((len(each.rssi_dbm), 2)) for each in others]
    return place_scores(one, wifi_places(others, nowhere, POWED), POWED)


def _euclidean(one: Fingerprints, others: Sequence[Fingerprints]) -> F64:
    """Minus the squared distances."""
    names = sorted({name for each in [one, *others] for name in each.bssids})
    here = _above(one, names)
    there = np.vstack([_above(each, names) for each in others])
    return np.asarray(2 * here @ there.T - (here**2).sum(axis=1)[:, None] - (there**2).sum(axis=1))


def _above(heard: Fingerprints, names: Sequence[str]) -> F64:
    column = {name: k for k, name in enumerate(names)}
    wide = np.zeros((len(heard.rssi_dbm), len(names)))
    wide[:, [column[name] for name in heard.bssids]] = heard.rssi_dbm - UNHEARD_DBM
    return wide


ALIKE: Mapping[str, Alike] = {"Soerensen": _soerensen, "Euclidean": _euclidean}
