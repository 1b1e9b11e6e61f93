"""An index that goes on: maps added and removed without building it again."""

from __future__ import annotations

import secrets
from dataclasses import replace
from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.serve.nearest.engines import add_rows, read_index, write_index
from elfslam.serve.nearest.folder import (
    MapRange,
    Meta,
    check_encoder,
    check_files,
    read_meta,
    stored,
    tidy,
    write_meta,
)
from elfslam.serve.nearest.vectors import Rows, check_rows, read_rows, write_rows


def add_map(folder: Path, name: str, rows: Rows, *, encoder: str) -> Meta:
    """The next revision, which holds the spots (n, d) of one more map.

    They are looked at one by one until `absorb` takes them in. Raises InputError for rows it
    cannot use, those of another encoder, and the name of a map that it holds.
    """
    meta = read_meta(folder)
    check_encoder(meta, encoder)
    if _number(meta, name) is not None:
        raise InputError(f"map {name!r}: is in the index; remove it first or choose another name")
    rows = check_rows(np.asarray(rows), meta.size, f"map {name!r}")
    file = folder / f"added-{meta.count:012d}-{secrets.token_hex(4)}.npy"
    write_rows(file, rows)
    try:
        return _next(
            folder, meta,
            replace(
                meta,
                maps=(*meta.maps, MapRange(name, meta.count, len(rows))),
                added=(*meta.added, stored(folder, file.name, len(rows))),
            ),
        )  # fmt: skip
    except Exception:
        file.unlink(missing_ok=True)
        raise


def remove_map(folder: Path, name: str) -> Meta:
    """The next revision, in which the spots of a map are not found; their ids stay unused.

    Raises InputError where the index holds no such map.
    """
    meta = read_meta(folder)
    number = _number(meta, name)
    if number is None:
        raise InputError(f"map {name!r}: is not in the index; name one that it holds")
    maps = list(meta.maps)
    maps[number] = replace(maps[number], removed=True)
    return _next(folder, meta, replace(meta, maps=tuple(maps)))


def absorb(folder: Path) -> Meta:
    """The next revision, in which the spots that were added are part of the index itself.

    Its cells and codes stay those that were learnt when it was built.
    """
    meta = read_meta(folder)
    check_files(folder, meta)
    if not meta.added:
        return meta
    main, vectors = meta.main, meta.vectors
    if main is not None:
        index = read_index(folder / main.name, meta.parameters.kind, mapped=False)
        add_rows(index, [read_rows(folder / each.name) for each in meta.added])
        name = f"main-{meta.revision + 1:06d}-{secrets.token_hex(4)}.faiss"
        write_index(index, folder / name)
        main = stored(folder, name, meta.count)
    if main is None or vectors:
        vectors = (*vectors, *meta.added)
    return _next(folder, meta, replace(meta, main=main, vectors=vectors, added=()))


def _number(meta: Meta, name: str) -> int | None:
    """Where a map that is not removed stands in the list."""
    found = [k for k, each in enumerate(meta.maps) if each.name == name and not each.removed]
    return found[0] if found else None


def _next(folder: Path, before: Meta, meta: Meta) -> Meta:
    meta = replace(meta, revision=before.revision + 1)
    write_meta(folder, meta)
    tidy(folder, before, meta)
    return meta
