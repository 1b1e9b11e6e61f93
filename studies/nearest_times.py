"""How long looking up nearest spots takes: one query at a time, many at once, and a map added."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F32
from elfslam.line.feature import load_encoder
from elfslam.serve.nearest import absorb, add_map, open_index
from elfslam.serve.nearest.vectors import read_rows
from studies.finding import Given, Row
from studies.nearest_material import (
    NEIGHBOURS,
    VISITORS,
    WAYS,
    Extent,
    folder_of,
    footsteps,
    index_of,
    lookups_of,
    opened,
    spots_of,
)

SINGLE, SLOW_SINGLE = 1000, 5
"""Queries one at a time; looking at all is asked fewer."""
BATCH = 200
ABSORBED_AT_MOST = 1_000_000
"""Spots up to which taking in an added map is timed: it writes the index anew."""
MIB = 2.0**20


def measure_nearest_times(
    given: Given,
    *,
    extent: Extent = Extent(),  # noqa: B008
    single: int = SINGLE,
) -> list[Row]:
    """A row per number of spots and way to search: milliseconds, memory, seconds to add a map.

    It takes the indexes that `nearest` left in the folder `nearest.material`, and makes what is
    missing; those it has are timed in minutes.
    """
    folder = folder_of(given.kept)
    shards = spots_of(folder, extent, given.announce, given.workers)
    asked = footsteps(lookups_of(folder, extent, given.announce)[VISITORS[0]])
    rows: list[Row] = []
    for maps in extent.maps:
        for way, kind in WAYS.items():
            if kind in extent.kinds:
                given.announce(f"{extent.count(maps):,} spots, {way}", None)
                index = index_of(folder, shards, maps, extent, kind)
                few = min(single, SLOW_SINGLE if way == "flat" else single)
                row = {"spots": extent.count(maps), "way": way, **_searched(index, way, asked, few)}
                rows.append({**row, **_changed(index, shards, extent)})
    return rows


def _searched(folder: Path, way: str, asked: F32, single: int) -> Row:
    before = _memory_mib()
    start_s = time.perf_counter()
    index = opened(folder, way)
    opened_s = time.perf_counter() - start_s
    queries = np.resize(asked, (single + 1, asked.shape[1]))
    took_ms = [_ms(partial(index.search, row[None], NEIGHBOURS)) for row in queries][1:]
    many = np.resize(asked, (min(BATCH, 40 * single), asked.shape[1]))
    batch_ms = _ms(lambda: index.search(many, NEIGHBOURS)) / len(many)
    return {
        "open (s)": round(opened_s, 3),
        "median (ms)": round(float(np.median(took_ms)), 3),
        "99 % (ms)": round(float(np.quantile(took_ms, 0.99)), 3),
        f"one of {BATCH} (ms)": round(batch_ms, 3),
        "memory (MiB)": round(_memory_mib() - before, 1),
    }


def _ms(do: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    do()
    return 1000 * (time.perf_counter() - start_s)


def _memory_mib() -> float:
    """What this process holds in memory, files that it maps among it; 0 where that is not told."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / MIB


def _changed(folder: Path, shards: Sequence[Path], extent: Extent) -> Row:
    """Seconds to add a map, to search with it, and to take it into the index."""
    rows = np.asarray(read_rows(shards[0])[: extent.spots])
    copy = folder.with_name(f"{folder.name}-copy")
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy, copy_function=os.link)
    try:
        add_s = _ms(lambda: add_map(copy, "new", rows, encoder=load_encoder("compact").identity))
        small = open_index(copy).meta.count <= ABSORBED_AT_MOST + extent.spots
        absorb_s = _ms(lambda: absorb(copy)) if small else None
    finally:
        shutil.rmtree(copy)
    return {
        "add a map (s)": round(add_s / 1000, 3),
        "take it in (s)": None if absorb_s is None else round(absorb_s / 1000, 2),
    }
