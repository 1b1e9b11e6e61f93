"""Nearest spots among the ELFs of many maps: an index on disk, and the vote for a map."""

import platform
import secrets
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elfslam import __version__
from elfslam.base.errors import InputError, StoreError
from elfslam.serve.nearest import folder as disk
from elfslam.serve.nearest import search
from elfslam.serve.nearest.folder import NearestParameters, newest_revision, read_meta
from elfslam.serve.nearest.search import VoteParameters, exact_search, open_index, which_map

__all__ = [
    "NearestParameters",
    "VoteParameters",
    "absorb",
    "add_map",
    "build_index",
    "exact_search",
    "newest_revision",
    "open_index",
    "read_meta",
    "remove_map",
    "which_map",
]

MAIN = "main.faiss"


def build_index(
    shards: Sequence[disk.Rows | Path],
    folder: Path,
    parameters: disk.NearestParameters,
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
    rows = [disk.loaded(shard) for shard in shards]
    ranges = _check(rows, maps)
    disk.checked(parameters, rows[0].shape[1])
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StoreError(f"{folder}: already exists; choose another folder or delete it")
    partial = folder.parent / f".{folder.name}.{secrets.token_hex(4)}.partial"
    try:
        partial.mkdir(parents=True)
        meta = disk.Meta(
            encoder, rows[0].shape[1], parameters, ranges,
            main=_main(partial, rows, parameters),
            vectors=_vectors(partial, shards, rows) if keeps_vectors(parameters) else (),
            software=_software(parameters),
        )  # fmt: skip
        disk.write_meta(partial, meta)
        partial.replace(folder)
    except OSError as cause:
        raise StoreError(f"{folder}: cannot be written ({cause}); choose another place") from cause
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder


def keeps_vectors(parameters: disk.NearestParameters) -> bool:
    """Whether an index needs its spots in full beside what FAISS keeps."""
    return parameters.kind == "flat" or (parameters.kind == "ivf-pq" and parameters.refine > 0)


def _check(rows: Sequence[disk.Rows], maps: Mapping[str, int] | None) -> tuple[disk.MapRange, ...]:
    count = sum(map(len, rows))
    if count == 0:
        raise InputError("nearest: wanted some spots, got none; give the rows of a map")
    for k, shard in enumerate(rows):
        disk.check_rows(shard, rows[0].shape[1] if k else None, f"shard {k}")
    counts = dict(maps or {"all": count})
    if sum(counts.values()) != count or min(counts.values()) < 0:
        raise InputError(
            f"maps: wanted {count} spots in all, got {sum(counts.values())}; "
            "name how many rows each map has"
        )
    firsts = np.cumsum([0, *counts.values()])
    return tuple(
        disk.MapRange(name, int(first), size)
        for (name, size), first in zip(counts.items(), firsts, strict=False)
    )


def _main(
    folder: Path, rows: Sequence[disk.Rows], parameters: disk.NearestParameters
) -> disk.StoredFile | None:
    if parameters.kind == "flat":
        return None
    index = search.trained(parameters, rows)
    search.add_rows(index, rows)
    search.write_index(index, folder / MAIN)
    return disk.stored(folder, MAIN, int(index.ntotal))


def _vectors(
    folder: Path, shards: Sequence[disk.Rows | Path], rows: Sequence[disk.Rows]
) -> tuple[disk.StoredFile, ...]:
    names = [f"vectors-{k:05d}.npy" for k in range(len(shards))]
    for name, shard in zip(names, shards, strict=True):
        disk.place_rows(shard, folder / name)
    return tuple(disk.stored(folder, name, len(n)) for name, n in zip(names, rows, strict=True))


def _software(parameters: disk.NearestParameters) -> dict[str, str]:
    versions = {"elfslam": __version__, "numpy": np.__version__, "machine": platform.machine()}
    if parameters.kind != "flat":
        versions["faiss"] = str(search.faiss_module().__version__)
    return versions


def add_map(folder: Path, name: str, rows: disk.Rows, *, encoder: str) -> disk.Meta:
    """The next revision, which holds the spots (n, d) of one more map.

    They are looked at one by one until `absorb` takes them in. Raises InputError for rows it
    cannot use, those of another encoder, and the name of a map that it holds.
    """
    meta = disk.read_meta(folder)
    disk.check_encoder(meta, encoder)
    if _number(meta, name) is not None:
        raise InputError(f"map {name!r}: is in the index; remove it first or choose another name")
    rows = disk.check_rows(np.asarray(rows), meta.size, f"map {name!r}")
    file = folder / f"added-{meta.count:012d}-{secrets.token_hex(4)}.npy"
    disk.write_rows(file, rows)
    try:
        return _next(
            folder, meta,
            replace(
                meta,
                maps=(*meta.maps, disk.MapRange(name, meta.count, len(rows))),
                added=(*meta.added, disk.stored(folder, file.name, len(rows))),
            ),
        )  # fmt: skip
    except Exception:
        file.unlink(missing_ok=True)
        raise


def remove_map(folder: Path, name: str) -> disk.Meta:
    """The next revision, in which the spots of a map are not found; their ids stay unused.

    Raises InputError where the index holds no such map.
    """
    meta = disk.read_meta(folder)
    number = _number(meta, name)
    if number is None:
        raise InputError(f"map {name!r}: is not in the index; name one that it holds")
    maps = list(meta.maps)
    maps[number] = replace(maps[number], removed=True)
    return _next(folder, meta, replace(meta, maps=tuple(maps)))


def absorb(folder: Path) -> disk.Meta:
    """The next revision, in which the spots that were added are part of the index itself.

    Its cells and codes stay those that were learnt when it was built.
    """
    meta = disk.read_meta(folder)
    disk.check_files(folder, meta)
    if not meta.added:
        return meta
    main, vectors = meta.main, meta.vectors
    if main is not None:
        index = search.read_index(folder / main.name, meta.parameters.kind, mapped=False)
        search.add_rows(index, [disk.read_rows(folder / each.name) for each in meta.added])
        name = f"main-{meta.revision + 1:06d}-{secrets.token_hex(4)}.faiss"
        search.write_index(index, folder / name)
        main = disk.stored(folder, name, meta.count)
    if main is None or vectors:
        vectors = (*vectors, *meta.added)
    return _next(folder, meta, replace(meta, main=main, vectors=vectors, added=()))


def _number(meta: disk.Meta, name: str) -> int | None:
    """Where a map that is not removed stands in the list."""
    found = [k for k, each in enumerate(meta.maps) if each.name == name and not each.removed]
    return found[0] if found else None


def _next(folder: Path, before: disk.Meta, meta: disk.Meta) -> disk.Meta:
    meta = replace(meta, revision=before.revision + 1)
    disk.write_meta(folder, meta)
    disk.tidy(folder, before, meta)
    return meta
