"""An index made from the spots of many maps."""

from __future__ import annotations

import platform
import secrets
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elfslam import __version__
from elfslam.base.errors import InputError, StoreError
from elfslam.serve.nearest.engines import add_rows, faiss_module, trained, write_index
from elfslam.serve.nearest.folder import MapRange, Meta, StoredFile, stored, write_meta
from elfslam.serve.nearest.parameters import NearestParameters, checked
from elfslam.serve.nearest.vectors import Rows, check_rows, loaded, place_rows

MAIN = "main.faiss"


def build_index(
    shards: Sequence[Rows | Path],
    folder: Path,
    parameters: NearestParameters,
    *,
    encoder: str,
    maps: Mapping[str, int] | None = None,
) -> Path:
    """The folder of an index of unit rows (n, d), given as arrays or as .npy files.

    `maps` gives the number of spots of each map, in the order of the rows; without it all are of
    one map called "all". `encoder` is the identity of what made the rows. Files of rows that the
    index keeps are linked where they can be; they must not be changed later. Raises InputError for
    rows it cannot use, ParameterError, and StoreError where the folder holds something.
    """
    rows = [loaded(shard) for shard in shards]
    ranges = _check(rows, maps)
    checked(parameters, rows[0].shape[1])
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StoreError(f"{folder}: already exists; choose another folder or delete it")
    partial = folder.parent / f".{folder.name}.{secrets.token_hex(4)}.partial"
    try:
        partial.mkdir(parents=True)
        meta = Meta(
            encoder, rows[0].shape[1], parameters, ranges,
            main=_main(partial, rows, parameters),
            vectors=_vectors(partial, shards, rows) if keeps_vectors(parameters) else (),
            software=_software(parameters),
        )  # fmt: skip
        write_meta(partial, meta)
        partial.replace(folder)
    except OSError as cause:
        raise StoreError(f"{folder}: cannot be written ({cause}); choose another place") from cause
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder


def keeps_vectors(parameters: NearestParameters) -> bool:
    """Whether an index needs its spots in full beside what FAISS keeps."""
    return parameters.kind == "flat" or (parameters.kind == "ivf-pq" and parameters.refine > 0)


def _check(rows: Sequence[Rows], maps: Mapping[str, int] | None) -> tuple[MapRange, ...]:
    count = sum(map(len, rows))
    if count == 0:
        raise InputError("nearest: wanted some spots, got none; give the rows of a map")
    for k, shard in enumerate(rows):
        check_rows(shard, rows[0].shape[1] if k else None, f"shard {k}")
    counts = dict(maps or {"all": count})
    if sum(counts.values()) != count or min(counts.values()) < 0:
        raise InputError(
            f"maps: wanted {count} spots in all, got {sum(counts.values())}; "
            "name how many rows each map has"
        )
    firsts = np.cumsum([0, *counts.values()])
    return tuple(
        MapRange(name, int(first), size)
        for (name, size), first in zip(counts.items(), firsts, strict=False)
    )


def _main(folder: Path, rows: Sequence[Rows], parameters: NearestParameters) -> StoredFile | None:
    if parameters.kind == "flat":
        return None
    index = trained(parameters, rows)
    add_rows(index, rows)
    write_index(index, folder / MAIN)
    return stored(folder, MAIN, int(index.ntotal))


def _vectors(
    folder: Path, shards: Sequence[Rows | Path], rows: Sequence[Rows]
) -> tuple[StoredFile, ...]:
    names = [f"vectors-{k:05d}.npy" for k in range(len(shards))]
    for name, shard in zip(names, shards, strict=True):
        place_rows(shard, folder / name)
    return tuple(stored(folder, name, len(n)) for name, n in zip(names, rows, strict=True))


def _software(parameters: NearestParameters) -> dict[str, str]:
    versions = {"elfslam": __version__, "numpy": np.__version__, "machine": platform.machine()}
    if parameters.kind != "flat":
        versions["faiss"] = str(faiss_module().__version__)
    return versions
