"""The nearest spots: by looking at all of them (the oracle), or by an index of FAISS on disk.

FAISS is imported here alone, and only when an index of it is used. By the nearest spots of its
footsteps a vote, which may abstain, names the map that a phone is in.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F32, F64, I64, Bool
from elfslam.base.errors import InputError, ParameterError, StoreError
from elfslam.base.extras import installing
from elfslam.base.parameters import parameter
from elfslam.base.values import FixStatus
from elfslam.serve.nearest import folder as disk

EXACT_BLOCK = 8192
NONE = -1
"""The id where there is no further spot; its similarity is -1, too."""


def exact_search(
    shards: Sequence[disk.Rows], vectors: F32, k: int, gone: Bool | None = None
) -> tuple[I64, F32]:
    """Ids (n, k) and cosines (n, k) of the spots nearest to unit rows (n, d), best first.

    A spot's id is its number in all shards; of equal ones the lower id comes first. `gone` marks
    spots that are not to be found. Where there are fewer than k, the rest have id -1.
    """
    ids = np.full((len(vectors), k), NONE, dtype=np.int64)
    similarity = np.full((len(vectors), k), -1.0, dtype=np.float32)
    for first, rows in disk.blocks([disk.loaded(shard) for shard in shards], EXACT_BLOCK):
        scores = vectors @ rows.T
        if gone is not None:
            scores[:, gone[first : first + len(rows)]] = -np.inf
        _keep_better(ids, similarity, scores, first)
    return ids, similarity


def _keep_better(ids: I64, similarity: F32, scores: F32, first: int) -> None:
    """Put what beats the worst of each row's best into them, in place."""
    k = ids.shape[1]
    bar = np.where(ids[:, -1] == NONE, -np.inf, similarity[:, -1])
    for row in np.flatnonzero(scores.max(axis=1) > bar):
        new = np.flatnonzero(scores[row] > bar[row])
        if len(new) > k:
            new = new[np.argpartition(-scores[row, new], k - 1)[:k]]
        both_ids = np.concatenate([ids[row], first + new])
        both = np.concatenate([similarity[row], scores[row, new]])
        order = np.lexsort((both_ids, -both, both_ids == NONE))[:k]
        ids[row], similarity[row] = both_ids[order], both[order]


FEWEST_CODES = 256
"""Examples that the codes of ivf-pq need at least: one per value of a byte."""


def faiss_module() -> Any:
    """FAISS. Raises InputError where it is not installed."""
    try:
        import faiss
    except ImportError as cause:
        raise InputError(
            "an index other than flat needs faiss, which is not installed; "
            f"{installing('buildings')}, or build one of kind flat"
        ) from cause
    return faiss


def cells_for(parameters: disk.NearestParameters, count: int) -> int:
    """How many cells an ivf index of so many spots has."""
    return parameters.cells or 2 ** int(np.ceil(np.log2(max(count, 1)) / 2))


def trained(parameters: disk.NearestParameters, shards: Sequence[disk.Rows]) -> Any:
    """An empty index of a kind other than flat that has learnt from some of the rows."""
    faiss = faiss_module()
    count, size = sum(map(len, shards)), shards[0].shape[1]
    ip, half = faiss.METRIC_INNER_PRODUCT, faiss.ScalarQuantizer.QT_fp16
    cells, centres = cells_for(parameters, count), faiss.IndexFlatIP(size)
    if parameters.kind == "hnsw":
        eight = faiss.ScalarQuantizer.QT_8bit
        index = faiss.IndexHNSWSQ(size, eight, parameters.links, ip)
        index.hnsw.efConstruction = parameters.breadth
    elif parameters.kind == "ivf-flat":
        index = faiss.IndexIVFScalarQuantizer(centres, size, cells, half, ip, False)
    else:
        index = faiss.IndexIVFPQ(centres, size, cells, parameters.code_bytes, 8, ip)
    if parameters.kind != "hnsw":
        index.cp.spherical, index.cp.seed = True, parameters.seed + 1
        index.cp.min_points_per_centroid = 1
    index.train(_examples(parameters, shards, cells))
    return index


def _examples(parameters: disk.NearestParameters, shards: Sequence[disk.Rows], cells: int) -> F32:
    count = sum(map(len, shards))
    wanted = min(max(parameters.examples * cells, FEWEST_CODES * 40), count)
    generator = np.random.default_rng(parameters.seed)
    return disk.take(shards, np.sort(generator.choice(count, wanted, replace=False)))


def add_rows(index: Any, shards: Sequence[disk.Rows]) -> None:
    """All rows added to an index; their ids go on from those that it has."""
    for _, rows in disk.blocks(shards):
        index.add(rows)


def write_index(index: Any, file: Path) -> None:
    """The index as a file of FAISS. Raises StoreError."""
    try:
        faiss_module().write_index(index, str(file))
    except RuntimeError as cause:
        raise StoreError(f"{file}: cannot be written; is the disk full?") from cause


def read_index(file: Path, kind: str, *, mapped: bool = True) -> Any:
    """The index of a file, its spots left on the disk until they are needed where `mapped`.

    Raises StoreError where it cannot be read.
    """
    faiss = faiss_module()
    flags = faiss.IO_FLAG_MMAP_IFC if kind == "hnsw" else faiss.IO_FLAG_MMAP
    try:
        return faiss.read_index(str(file), flags if mapped else 0)
    except RuntimeError as cause:
        raise StoreError(f"{file}: is no index of FAISS; build the index again") from cause


def search_rows(
    index: Any, kind: str, vectors: F32, k: int, effort: int, gone: Bool | None
) -> tuple[I64, F32]:
    """Ids and similarities (n, k) by FAISS, without the spots that are `gone`; -1 for none."""
    faiss = faiss_module()
    settings = _settings(faiss, index, kind, effort, gone)
    similarity, ids = index.search(np.ascontiguousarray(vectors), k, params=settings)
    return ids, np.where(ids < 0, np.float32(-1.0), similarity)


def _settings(faiss: Any, index: Any, kind: str, effort: int, gone: Bool | None) -> Any:
    kept = {}
    if gone is not None:
        bits = np.packbits(~gone[: index.ntotal], bitorder="little")
        kept["sel"] = faiss.IDSelectorBitmap(bits)
    if kind == "hnsw":
        return faiss.SearchParametersHNSW(efSearch=effort, **kept)
    return faiss.SearchParametersIVF(nprobe=min(effort, index.nlist), **kept)


@dataclass(frozen=True, eq=False)
class Index:
    """One revision of an index, open for searching; it does not see later changes."""

    folder: Path
    meta: disk.Meta
    main: Any
    vectors: tuple[disk.Rows, ...]
    added: tuple[disk.Rows, ...]
    gone: Bool | None

    def search(self, vectors: F32, k: int, *, effort: int | None = None) -> tuple[I64, F32]:
        """Ids (n, k) and similarities (n, k) of the spots nearest to unit rows, best first.

        The similarity is the cosine, by codes where the index has nothing else. Where fewer are
        found the rest have id -1. `effort` is that of the parameters unless it is given. Raises
        InputError for rows that are not unit rows of the index's width.
        """
        if k < 1:
            raise ParameterError(f"k: wanted 1 or more spots, got {k}; ask for some")
        rows = np.asarray(disk.check_rows(np.asarray(vectors), self.meta.size, "query"), np.float32)
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


def open_index(folder: Path) -> Index:
    """The newest revision of an index; its files are mapped and read as they are needed.

    Raises StoreError where a file is missing or cut off, InputError where FAISS is missing.
    """
    meta = disk.read_meta(folder)
    disk.check_files(folder, meta)
    return Index(
        folder,
        meta,
        read_index(folder / meta.main.name, meta.parameters.kind) if meta.main else None,
        tuple(disk.read_rows(folder / each.name) for each in meta.vectors),
        tuple(disk.read_rows(folder / each.name) for each in meta.added),
        meta.gone,
    )


def _cosines(shards: tuple[disk.Rows, ...], rows: F32, ids: I64) -> F32:
    known = disk.take(shards, np.maximum(ids, 0).ravel()).reshape(*ids.shape, -1)
    found = np.einsum("nd,nkd->nk", rows, known)
    return np.where(ids < 0, np.float32(-1.0), found)


def _best(ids: I64, similarity: F32, k: int) -> tuple[I64, F32]:
    """The k best of each row; what is none comes last, equal ones in the order of their ids."""
    order = np.lexsort((ids, -similarity, ids == NONE), axis=1)[:, :k]
    return np.take_along_axis(ids, order, 1), np.take_along_axis(similarity, order, 1)


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
