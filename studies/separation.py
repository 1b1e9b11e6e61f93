"""How well a similarity tells the same place from elsewhere, from histograms of its values.

Histograms add up: pooling walks, and drawing them again for an interval, needs no values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.scoring.errors import interval
from studies.results import Record

CELLS = 4000
EDGES = np.round(np.linspace(-1.0, 1.0, CELLS + 1), 6)
SAME, ELSEWHERE = 0, 1

Measure = Callable[[F64], float]
"""A figure of the histograms (2, 4000)."""


def histograms(same: F32 | F64, elsewhere: F32 | F64) -> F64:
    """Counts (2, 4000) of the similarities, in [-1, 1], of one place and of different places."""
    return np.stack(
        [np.histogram(np.clip(values, -1.0, 1.0), EDGES)[0] for values in (same, elsewhere)]
    ).astype(np.float64)


def area_under_curve(counts: F64) -> float:
    """Chance that a pair of one place is more similar than one of different places (2, cells).

    Pairs within a cell of 0.0005 count half (Hanley and McNeil 1982).
    """
    below = np.cumsum(counts[ELSEWHERE]) - counts[ELSEWHERE] / 2
    return float(counts[SAME] @ below / (counts[SAME].sum() * counts[ELSEWHERE].sum()))


def recall_at(counts: F64, false_positive_rate: float) -> float:
    """Share of same-place pairs found by the lowest threshold that keeps false positives so few."""
    found, false = shares_above(counts)
    return float(found[false <= false_positive_rate].max())


def shares_above(counts: F64) -> tuple[F64, F64]:
    """Shares (4001) of same-place pairs and of others at or above each threshold of `EDGES`."""
    above = np.cumsum(counts[:, ::-1], axis=1)[:, ::-1]
    shares = np.pad(above, ((0, 0), (0, 1))) / counts.sum(axis=1, keepdims=True)
    return shares[SAME], shares[ELSEWHERE]


def separation_records(walks: Sequence[F64], threshold: float, of: Record) -> list[Record]:
    """Measures of the pooled histograms (2, 4000) of walks, with 95 % intervals over walks.

    Raises InputError where no walk has a pair of both kinds.
    """
    walks = [counts for counts in walks if counts.sum(axis=1).all()]
    if not walks:
        raise InputError("separation: no walk comes back to a place; walk more rounds")
    stacked = [counts[None] for counts in walks]
    measures = {**MEASURES, **_at(threshold)}
    return [
        _record(of, metric, stacked, partial(_of_pooled, measure))
        for metric, measure in measures.items()
    ]


def _record(of: Record, metric: str, walks: Sequence[F64], measure: Measure) -> Record:
    low, high = interval(walks, measure, np.random.default_rng(0))
    value = measure(np.concatenate(walks))
    return replace(of, metric=metric, value=value, low=low, high=high)


def _at(threshold: float) -> Mapping[str, Measure]:
    """What a threshold keeps of both kinds of pairs."""
    at = int(np.searchsorted(EDGES, threshold))
    return {
        f"recall at {threshold:g}": lambda counts: float(shares_above(counts)[SAME][at]),
        f"false positives at {threshold:g}": (
            lambda counts: float(shares_above(counts)[ELSEWHERE][at])
        ),
    }


def _mean(counts: F64, kind: int) -> float:
    cells = (EDGES[:-1] + EDGES[1:]) / 2
    return float(counts[kind] @ cells / counts[kind].sum())


MEASURES: Mapping[str, Measure] = {
    "AUC": area_under_curve,
    "recall at 1 % false positives": partial(recall_at, false_positive_rate=0.01),
    "recall at 0.1 % false positives": partial(recall_at, false_positive_rate=0.001),
    "mean similarity, same place": partial(_mean, kind=SAME),
    "mean similarity, elsewhere": partial(_mean, kind=ELSEWHERE),
}


def _of_pooled(measure: Measure, walks: F64) -> float:
    """A measure of the sum of histograms (walks, 2, 4000)."""
    return measure(walks.sum(axis=0))
