"""The kinds of index that FAISS makes. It is imported here alone, and only when one is used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F32, I64, Bool
from elfslam.base.errors import InputError, StoreError
from elfslam.base.extras import installing
from elfslam.serve.nearest.parameters import NearestParameters
from elfslam.serve.nearest.vectors import Rows, blocks, take

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


def cells_for(parameters: NearestParameters, count: int) -> int:
    """How many cells an ivf index of so many spots has."""
    return parameters.cells or 2 ** int(np.ceil(np.log2(max(count, 1)) / 2))


def trained(parameters: NearestParameters, shards: Sequence[Rows]) -> Any:
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


def _examples(parameters: NearestParameters, shards: Sequence[Rows], cells: int) -> F32:
    count = sum(map(len, shards))
    wanted = min(max(parameters.examples * cells, FEWEST_CODES * 40), count)
    generator = np.random.default_rng(parameters.seed)
    return take(shards, np.sort(generator.choice(count, wanted, replace=False)))


def add_rows(index: Any, shards: Sequence[Rows]) -> None:
    """All rows added to an index; their ids go on from those that it has."""
    for _, rows in blocks(shards):
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
