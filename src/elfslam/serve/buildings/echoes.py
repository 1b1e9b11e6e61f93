"""On which floor echoes are known, from the spots of all floors that are nearest to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Set
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elfslam.base.arrays import F32, I64
from elfslam.base.parameters import parameter
from elfslam.serve.nearest import VoteParameters, which_map

SURE_ODDS = 19.0
"""Where the vote would name a map it is 95 % sure of it, against the next and against none."""


@dataclass(frozen=True)
class EchoFindParameters:
    """How far echoes tell the floor; least and lead are those of the vote."""

    nearest: int = parameter(20, "", "spots that each footstep is compared with", low=2, high=1000)
    least: float = parameter(
        VoteParameters.least, "", "so far a floor's spots stand out where it is as likely as not"
    )
    lead: float = parameter(
        VoteParameters.lead, "", "so much further in one footstep, 19 times as likely", low=0.001
    )


class NearestSpots(Protocol):
    """The spots of many floors, to be searched."""

    def search(self, vectors: F32, k: int) -> tuple[I64, F32]:
        """Ids (n, k) and similarities (n, k) of the nearest spots of each unit row (n, 128)."""
        ...


@dataclass(frozen=True, eq=False)
class EchoIndex:
    """An index of spots, whose floors they are, and the identity of their encoder.

    `map_of` gives the place in `floors` (ids of maps) of each spot, and -1 for none.
    """

    spots: NearestSpots
    map_of: Callable[[I64], I64]
    floors: tuple[str, ...]
    encoder: str


@dataclass(frozen=True, eq=False)
class EchoEvidence:
    """Log-odds by the id of a floor's map; `silent` for those of the index that stand out nowhere.

    Against being anywhere else.
    """

    odds: dict[str, float]
    silent: float
    indexed: Set[str]

    def of(self, map_id: str) -> float | None:
        """What is said for a floor; None where the index knows nothing of it."""
        return self.odds.get(map_id, self.silent) if map_id in self.indexed else None


def echo_evidence(vectors: F32, index: EchoIndex, parameters: EchoFindParameters) -> EchoEvidence:
    """What features of footsteps (n, 128) say."""
    every = VoteParameters(parameters.least, parameters.lead, candidates=len(index.floors) + 1)
    found = which_map(*index.spots.search(vectors, parameters.nearest), index.map_of, every)
    steepness = math.log(SURE_ODDS) * math.sqrt(len(vectors)) / parameters.lead
    return EchoEvidence(
        {
            index.floors[each.number]: steepness * (each.score - parameters.least)
            for each in found.candidates
            if each.number >= 0
        },
        -steepness * parameters.least,
        frozenset(index.floors),
    )


def unit_rows(vectors: F32) -> F32:
    """Vectors (n, 128), those that are nothing left out, the others scaled to length 1."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    heard = length[:, 0] > 0
    return np.asarray(vectors[heard] / length[heard], dtype=np.float32)
