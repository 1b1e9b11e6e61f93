"""How sure a figure is: bootstrap over walks, since the footsteps of one walk are correlated."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError

RESAMPLES = 2000
CONFIDENCE = 0.95


def interval(
    values_per_walk: Sequence[F64],
    statistic: Callable[[F64], float],
    generator: np.random.Generator,
) -> tuple[float, float]:
    """95 % percentile interval of a statistic of all values, walks drawn with replacement.

    `values_per_walk` holds one array per walk or seed (Efron and Tibshirani 1993, chapter 13).
    Raises InputError where no walk has a value.
    """
    walks = [np.asarray(values, float) for values in values_per_walk if np.size(values)]
    if not walks:
        raise InputError("bootstrap: got no values, wanted at least one walk; check coverage")
    drawn = generator.integers(len(walks), size=(RESAMPLES, len(walks)))
    statistics = [statistic(np.concatenate([walks[k] for k in row])) for row in drawn]
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(statistics, [tail, 1 - tail])
    return float(low), float(high)
