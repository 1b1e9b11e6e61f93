"""On which floor echoes are known, from the spots of all floors that are nearest to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elfslam.base.arrays import F32, I64, Value, array
from elfslam.base.parameters import parameter
from elfslam.base.values import ELF_SIZE


@dataclass(frozen=True)
class EchoFindParameters:
    """How far echoes tell the floor."""

    nearest: int = parameter(32, "", "spots that each footstep is compared with", low=1, high=1000)
    known_similarity: float = parameter(
        0.5, "", "from here on a spot rather is the place than not", low=-1.0, high=1.0
    )
    steepness: float = parameter(
        12.0, "", "log-odds for each whole number of similarity", low=0.0, high=1000.0
    )
    most_odds: float = parameter(
        2.5, "", "that one footstep speaks for or against a floor", low=0.0, high=30.0
    )


class NearestSpots(Protocol):
    """The spots of many floors, to be searched."""

    def search(self, vectors: F32, k: int) -> tuple[I64, F32]:
        """Ids (n, k) and similarities (n, k) of the nearest spots of each vector (n, 128)."""
        ...


@dataclass(frozen=True, eq=False)
class Ranges(Value):
    """Spots from `first` (ascending) to the next one's lie on `floor`."""

    first: I64 = array("n", dtype=np.int64)
    floor: I64 = array("n", dtype=np.int64)


@dataclass(frozen=True, eq=False)
class EchoIndex:
    """An index of spots, whose floors they are, and the encoder of their features."""

    spots: NearestSpots
    ranges: Ranges
    encoder: str


def floors_of(ids: I64, ranges: Ranges) -> I64:
    """The floors of spots; -1 where there is none, as for ids below zero."""
    row = np.searchsorted(ranges.first, ids, side="right") - 1
    return np.asarray(np.where((ids >= 0) & (row >= 0), ranges.floor[row], -1))


def echo_log_odds(
    vectors: F32, index: EchoIndex, parameters: EchoFindParameters
) -> dict[int, float]:
    """What features of footsteps (n, 128) say for each floor of the index, against any other place.

    A floor that is not among the nearest is no nearer than the last of them.
    """
    ids, similarity = index.spots.search(vectors, parameters.nearest)
    floors = floors_of(ids, index.ranges)
    found = {int(floor): similarity.min(axis=1) for floor in index.ranges.floor}
    for floor in np.unique(floors[floors >= 0]).tolist():
        hits = np.where(floors == floor, similarity, -np.inf).max(axis=1)
        found[floor] = np.maximum(hits, similarity.min(axis=1))
    return {floor: float(_odds(best, parameters).sum()) for floor, best in found.items()}


def _odds(similarity: F32, parameters: EchoFindParameters) -> F32:
    told = parameters.steepness * (similarity - parameters.known_similarity)
    return np.asarray(np.clip(told, -parameters.most_odds, parameters.most_odds))


def unit_rows(vectors: F32) -> F32:
    """Vectors (n, 128), scaled to length 1 where they are longer."""
    assert vectors.ndim == 2
    assert vectors.shape[1] == ELF_SIZE
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1.0))
