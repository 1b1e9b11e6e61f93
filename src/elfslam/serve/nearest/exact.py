"""The nearest spots by looking at all of them: the oracle, and the index of small collections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elfslam.base.arrays import F32, I64, Bool
from elfslam.serve.nearest.vectors import Rows, blocks, loaded

EXACT_BLOCK = 8192
NONE = -1
"""The id where there is no further spot; its similarity is -1, too."""


def exact_search(
    shards: Sequence[Rows],
    vectors: F32,
    k: int,
    gone: Bool | None = None,
    *,
    above: F32 | None = None,
) -> tuple[I64, F32]:
    """Ids (n, k) and cosines (n, k) of the spots nearest to unit rows (n, d), best first.

    A spot's id is its number in all shards; of equal ones the lower id comes first. `gone` marks
    spots that are not to be found; only those more similar than `above` (n) are, where it is given.
    Where there are fewer than k, the rest have id -1.
    """
    least = np.full(len(vectors), -np.inf, dtype=np.float32) if above is None else above
    ids = np.full((len(vectors), k), NONE, dtype=np.int64)
    similarity = np.full((len(vectors), k), -1.0, dtype=np.float32)
    for first, rows in blocks([loaded(shard) for shard in shards], EXACT_BLOCK):
        scores = vectors @ rows.T
        if gone is not None:
            scores[:, gone[first : first + len(rows)]] = -np.inf
        _keep_better(ids, similarity, scores, first, least)
    return ids, similarity


def _keep_better(ids: I64, similarity: F32, scores: F32, first: int, least: F32) -> None:
    """Put what beats the worst of each row's best into them, in place."""
    k = ids.shape[1]
    bar = np.where(ids[:, -1] == NONE, least, similarity[:, -1])
    for row in np.flatnonzero(scores.max(axis=1) > bar):
        new = np.flatnonzero(scores[row] > bar[row])
        if len(new) > k:
            new = new[np.argpartition(-scores[row, new], k - 1)[:k]]
        both_ids = np.concatenate([ids[row], first + new])
        both = np.concatenate([similarity[row], scores[row, new]])
        order = np.lexsort((both_ids, -both, both_ids == NONE))[:k]
        ids[row], similarity[row] = both_ids[order], both[order]
