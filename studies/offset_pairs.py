"""Footsteps of two people near each other: how far apart they truly are, and how each sounds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from elfslam.base.arrays import F32, F64, I64, Bool, Value, array
from elfslam.base.geometry import between, wrap_angle
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.echo.envelope import matched_envelope
from elfslam.line.feature import Encoder
from studies.lap_echoes import (
    Lap,
    Places,
    footsteps_of,
    mapped_lap,
    own_lane_m,
    strange_laps,
    venue_of,
)

LAPS = 6
ALONG_M, ACROSS_M, TURN_RAD = 0.5, 0.8, 0.6
"""Footsteps no farther apart than this are near each other."""
ELSEWHERE_M = 2.0
FALSE_POSITIVES = 0.01
FINE_S = 1e-4
"""Of the envelope, which is averaged over so much."""


@dataclass(frozen=True, eq=False)
class Pairs(Value):
    """Footsteps that sound alike (n): the pose of the second seen from the first, and their sound.

    `first` and `second` are the directions of their mean features, `heard` and `again` envelopes
    of one echo each.
    """

    offset: F64 = array("n", 3)
    first: F32 = array("n", "d", dtype=np.float32, unit_rows=True)
    second: F32 = array("n", "d", dtype=np.float32, unit_rows=True)
    heard: F32 = array("n", "t", dtype=np.float32)
    again: F32 = array("n", "t", dtype=np.float32)

    @property
    def likeness(self) -> F64:
        """Cosines (n) of the mean features."""
        return np.asarray(np.einsum("nd,nd->n", self.first, self.second), np.float64)


class Footsteps(NamedTuple):
    """Those of a lap: where, the directions of their features (n, d), and envelopes (n, t)."""

    places: Places
    directions: F32
    envelopes: F32


def pairs_in(world: str, kind: str, encoder: Encoder, seed: int) -> Pairs:
    """Pairs of every footstep of somebody who asks and the most alike near one of each lap mapped.

    Who asks has another phone on another day. Of the pairs those that are more alike than all but
    1 % of footsteps 2 m apart.
    """
    venue, lane_m = venue_of(world, kind), own_lane_m(world)
    laps = [mapped_lap(venue, lane_m, seed, number) for number in range(LAPS)]
    mapped = [_footsteps(lap, encoder) for lap in laps]
    asked = [_footsteps(lap, encoder) for lap in strange_laps(venue, lane_m, seed)]
    return together(_near(one, other) for other in asked for one in mapped)


def together(parts: Iterable[Pairs]) -> Pairs:
    """All pairs as one."""
    every = list(parts)
    names = [item.name for item in fields(Pairs)]
    return Pairs(*(np.concatenate([getattr(part, name) for part in every]) for name in names))


def _footsteps(lap: Lap, encoder: Encoder) -> Footsteps:
    places = footsteps_of(lap, encoder)
    return Footsteps(places, _directions(places.vectors), _envelopes(lap, places))


def _near(one: Footsteps, other: Footsteps) -> Pairs:
    seen = between(_poses(one.places)[:, None], _poses(other.places)[None])
    alike = one.directions @ other.directions.T
    limit = np.quantile(alike[_elsewhere(one.places, other.places)], 1 - FALSE_POSITIVES)
    close = np.abs(wrap_angle(seen[..., 2])) <= TURN_RAD
    close &= (np.abs(seen[..., 0]) <= ALONG_M) & (np.abs(seen[..., 1]) <= ACROSS_M)
    best = np.where(close, alike, -1.0).argmax(axis=0)
    columns = np.arange(len(best))
    j = np.flatnonzero(close[best, columns] & (alike[best, columns] > limit))
    i = best[j]
    features = one.directions[i], other.directions[j]
    return Pairs(seen[i, j], *features, one.envelopes[i], other.envelopes[j])


def _poses(places: Places) -> F64:
    return np.column_stack([places.xy_m, places.heading_rad])


def _directions(vectors: F32) -> F32:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _elsewhere(one: Places, other: Places) -> Bool:
    return np.asarray(cdist(one.xy_m, other.xy_m) > ELSEWHERE_M)


def _envelopes(lap: Lap, places: Places) -> F32:
    """Envelopes (n, t) of the echo in the middle of each footstep, at every tenth of a ms."""
    middle: I64 = cdist(places.xy_m, lap.xy_m).argmin(axis=1)
    chirp = make_chirp(ChirpParameters(), ECHO_RATE_HZ)
    rows = [matched_envelope(lap.samples[k], chirp) for k in middle]
    count = round(FINE_S * ECHO_RATE_HZ)
    whole = len(rows[0]) // count * count
    return np.stack([row[:whole].reshape(-1, count).mean(axis=1) for row in rows])
