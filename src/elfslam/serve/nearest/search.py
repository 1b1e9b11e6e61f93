"""The nearest spots by an index that lies on disk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F32, I64, Bool
from elfslam.base.errors import ParameterError
from elfslam.serve.nearest.engines import read_index, search_rows
from elfslam.serve.nearest.exact import NONE, exact_search
from elfslam.serve.nearest.folder import Meta, check_encoder, check_files, read_meta
from elfslam.serve.nearest.vectors import Rows, check_rows, read_rows, take


@dataclass(frozen=True, eq=False)
class Index:
    """One revision of an index, open for searching; it does not see later changes."""

    folder: Path
    meta: Meta
    main: Any
    vectors: tuple[Rows, ...]
    added: tuple[Rows, ...]
    gone: Bool | None

    def search(self, vectors: F32, k: int, *, effort: int | None = None) -> tuple[I64, F32]:
        """Ids (n, k) and similarities (n, k) of the spots nearest to unit rows, best first.

        The similarity is the cosine, by codes where the index has nothing else. Where fewer are
        found the rest have id -1. `effort` is that of the parameters unless it is given. Raises
        InputError for rows that are not unit rows of the index's width.
        """
        if k < 1:
            raise ParameterError(f"k: wanted 1 or more spots, got {k}; ask for some")
        rows = np.asarray(check_rows(np.asarray(vectors), self.meta.size, "query"), np.float32)
        ids, similarity = self._in_main(rows, k, effort or self.meta.parameters.effort)
        if not self.added:
            return ids, similarity
        first = self.meta.count - sum(map(len, self.added))
        gone = None if self.gone is None else self.gone[first:]
        more, scores = exact_search(self.added, rows, k, gone)
        more = np.where(more == NONE, NONE, more + first)
        return _best(np.hstack([ids, more]), np.hstack([similarity, scores]), k)

    def _in_main(self, rows: F32, k: int, effort: int) -> tuple[I64, F32]:
        known = self.meta.parameters
        if self.main is None:
            gone = None if self.gone is None else self.gone[: sum(map(len, self.vectors))]
            return exact_search(self.vectors, rows, k, gone)
        wanted = k * known.refine if self.vectors else k
        ids, similarity = search_rows(self.main, known.kind, rows, wanted, effort, self.gone)
        if self.vectors:
            similarity = _cosines(self.vectors, rows, ids)
        return _best(ids, similarity, k)

    def map_of(self, ids: I64) -> I64:
        """The number of the map, in `meta.maps`, that each id belongs to; -1 for none."""
        found = np.searchsorted(self.meta.ends, ids, side="right")
        return np.where(ids < 0, NONE, found).astype(np.int64)


def open_index(folder: Path, *, encoder: str | None = None) -> Index:
    """The newest revision of an index; its files are mapped and read as they are needed.

    Raises StoreError where a file is missing or cut off, and InputError where `encoder` (an
    identity) is not the one that made the index, or FAISS is missing.
    """
    meta = read_meta(folder)
    check_files(folder, meta)
    if encoder is not None:
        check_encoder(meta, encoder)
    return Index(
        folder,
        meta,
        read_index(folder / meta.main.name, meta.parameters.kind) if meta.main else None,
        tuple(read_rows(folder / each.name) for each in meta.vectors),
        tuple(read_rows(folder / each.name) for each in meta.added),
        meta.gone,
    )


def _cosines(shards: tuple[Rows, ...], rows: F32, ids: I64) -> F32:
    known = take(shards, np.maximum(ids, 0).ravel()).reshape(*ids.shape, -1)
    found = np.einsum("nd,nkd->nk", rows, known)
    return np.where(ids < 0, np.float32(-1.0), found)


def _best(ids: I64, similarity: F32, k: int) -> tuple[I64, F32]:
    """The k best of each row; what is none comes last, equal ones in the order of their ids."""
    order = np.lexsort((ids, -similarity, ids == NONE), axis=1)[:, :k]
    return np.take_along_axis(ids, order, 1), np.take_along_axis(similarity, order, 1)
