"""Which map a phone is in, by the nearest spots of its footsteps: a vote that may abstain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import FixStatus


@dataclass(frozen=True)
class VoteParameters:
    """When a map is named. Cosines, for votes of 20 neighbours a footstep."""

    least: float = parameter(
        0.04, "", "how far the best map's spots must stand out of the other neighbours", low=0.0
    )
    lead: float = parameter(
        0.1,
        "",
        "how much further than those of the next map, over the root of the footsteps",
        low=0.0,
    )
    candidates: int = parameter(5, "", "maps that are given at most", low=2)


@dataclass(frozen=True)
class MapCandidate:
    """A map by its number, how far its spots stand out, and in how many footsteps they do."""

    number: int
    score: float
    footsteps: int


@dataclass(frozen=True)
class Naming:
    """What a vote gave: candidates, best first; one is named only where the status is OK."""

    status: FixStatus
    candidates: tuple[MapCandidate, ...]


def which_map(
    ids: I64,
    similarity: F32,
    map_of: Callable[[I64], I64],
    parameters: VoteParameters = VoteParameters(),
) -> Naming:
    """The maps that the nearest spots (n footsteps, k) speak for, and whether one stands out.

    A footstep speaks for a map by how much more like it the map's best spot is than the k-th
    nearest spot of all: where spots of many maps sound alike it says little. `map_of` gives the
    map of each id (`Index.map_of`); a coarser one, of buildings, votes for those. The more
    footsteps, the surer. Raises InputError where k is 1: nothing could stand out.
    """
    if ids.shape != similarity.shape or ids.ndim != 2 or (len(ids) and ids.shape[1] < 2):
        raise InputError(
            f"vote: wanted ids and similarities (footsteps, 2 or more), got {ids.shape} and "
            f"{similarity.shape}; search for more spots, such as 20"
        )
    numbers, excess = _excess(ids, similarity, map_of)
    score = excess.mean(axis=0) if len(excess) else np.zeros(len(numbers))
    order = np.argsort(-score, kind="stable")
    found = tuple(
        MapCandidate(int(numbers[j]), float(score[j]), int((excess[:, j] > 0).sum()))
        for j in order[: parameters.candidates]
        if score[j] > 0
    )
    return Naming(_status(found, len(ids), parameters), found)


def _excess(ids: I64, similarity: F32, map_of: Callable[[I64], I64]) -> tuple[I64, F64]:
    """The maps (m), and how far each stands out in each footstep (n, m)."""
    known = ids >= 0
    numbers, column = np.unique(map_of(ids[known]), return_inverse=True)
    floor = np.where(known, similarity, np.inf).min(axis=1, initial=np.inf)
    row = np.nonzero(known)[0]
    excess = np.zeros((len(ids), len(numbers)))
    np.maximum.at(excess, (row, column), (similarity[known] - floor[row]).astype(np.float64))
    return numbers.astype(np.int64), excess


def _status(
    found: tuple[MapCandidate, ...], footsteps: int, parameters: VoteParameters
) -> FixStatus:
    if footsteps == 0:
        return FixStatus.NO_ECHO
    if not found or found[0].score < parameters.least:
        return FixStatus.UNKNOWN_PLACE
    next_score = found[1].score if len(found) > 1 else 0.0
    if found[0].score - next_score < parameters.lead / np.sqrt(footsteps):
        return FixStatus.AMBIGUOUS
    return FixStatus.OK
