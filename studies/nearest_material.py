"""What the studies of nearest spots share in their folder: spots, lookups, answers and indexes."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from elfslam.app.workers import Workers
from elfslam.base.arrays import F32, I64
from elfslam.base.progress import Announce
from elfslam.data.folders import new_file
from elfslam.data.npz import read_npz, write_npz
from elfslam.line.feature import load_encoder
from elfslam.serve.nearest import Index, NearestParameters, build_index, exact_search, open_index
from elfslam.serve.nearest.vectors import Rows, read_rows
from studies.elf_spots import Lookups, make_lookups, make_spots

KINDS: Mapping[str, NearestParameters] = MappingProxyType(
    {
        "flat": NearestParameters(kind="flat"),
        "ivf-flat": NearestParameters(kind="ivf-flat"),
        "ivf-pq": NearestParameters(kind="ivf-pq", refine=20),
        "hnsw": NearestParameters(kind="hnsw", effort=64),
    }
)
"""The indexes that are built; the codes of ivf-pq are searched with and without refining."""
WAYS: Mapping[str, str] = MappingProxyType(
    {
        "flat": "flat",
        "ivf-flat": "ivf-flat",
        "ivf-pq": "ivf-pq",
        "ivf-pq, refined": "ivf-pq",
        "hnsw": "hnsw",
    }
)
"""Ways to search, and the index that each one searches."""
VISITORS = ("same phone", "another phone", "stranger")
NEIGHBOURS = 20
"""Spots that are asked for."""


@dataclass(frozen=True)
class Extent:
    """How much is measured: numbers of maps, spots of each, walks of each kind of visitor."""

    maps: tuple[int, ...] = (250, 2500)
    spots: int = 4000
    walks: int = 100
    kinds: tuple[str, ...] = tuple(KINDS)

    def count(self, maps: int) -> int:
        """All spots of so many maps."""
        return maps * self.spots


def folder_of(kept: Path | None) -> Path:
    """The folder of the studies beside the file that a long study keeps; it stays afterwards."""
    return (kept or Path("nearest.partial")).with_name("nearest.material")


def spots_of(
    folder: Path, extent: Extent, announce: Announce, workers: Workers | None = None
) -> list[Path]:
    """The shards of the most maps, made where they are missing."""
    return make_spots(
        folder / "spots", max(extent.maps), announce, spots=extent.spots, workers=workers
    )


def first_rows(shards: Sequence[Path], count: int) -> list[Rows]:
    """The first `count` rows of the shards, mapped."""
    found: list[Rows] = []
    for shard in shards:
        left = count - sum(map(len, found))
        if left > 0:
            found.append(read_rows(shard)[:left])
    return found


def lookups_of(folder: Path, extent: Extent, announce: Announce) -> dict[str, Lookups]:
    """Walks of each kind of visitor; strangers walk through buildings that no index has."""
    known = np.linspace(0, min(extent.maps) - 1, extent.walks).round().astype(int).tolist()
    unknown = [max(extent.maps) + number for number in range(extent.walks)]
    found = {}
    for purpose, who in enumerate(VISITORS, 1):
        announce(f"walks, {who}", None)
        file = folder / f"lookups-{purpose}-{extent.walks}-of-{min(extent.maps)}.npz"
        if not file.exists():
            made = make_lookups(
                unknown if who == "stranger" else known, purpose,
                other_phone=who != "same phone", spots=extent.spots,
            )  # fmt: skip
            with new_file(file) as partial:
                write_npz(partial, made._asdict())
        found[who] = Lookups(**read_npz(file, Lookups._fields))
    return found


def exact_answers(
    folder: Path, shards: Sequence[Path], count: int, lookups: Mapping[str, Lookups]
) -> dict[str, tuple[I64, F32]]:
    """For each visitor the exact ids and cosines (footsteps, 20) among the first `count` spots.

    What each shard gives is kept, so that looking at all goes on after a kill.
    """
    asked, first = np.concatenate([footsteps(lookups[who]) for who in VISITORS]), 0
    ids, cosines = exact_search([np.zeros((0, asked.shape[1]))], asked, NEIGHBOURS)
    for number, rows in enumerate(first_rows(shards, count)):
        file = folder / "exact" / f"{number:05d}-{len(rows)}-{len(asked)}.npz"
        if not file.exists():
            more, scores = exact_search([rows], asked, NEIGHBOURS, above=cosines[:, -1])
            with new_file(file) as partial:
                write_npz(
                    partial, {"ids": np.where(more < 0, more, more + first), "cosines": scores}
                )
        part = read_npz(file, ("ids", "cosines"))
        ids, cosines = _better(ids, cosines, part["ids"], part["cosines"])
        first += len(rows)
    split = zip(np.split(ids, len(VISITORS)), np.split(cosines, len(VISITORS)), strict=True)
    return dict(zip(VISITORS, split, strict=True))


def _better(ids: I64, cosines: F32, more: I64, scores: F32) -> tuple[I64, F32]:
    """The best 20 of two answers to the same questions."""
    both, alike = np.hstack([ids, more]), np.hstack([cosines, scores])
    order = np.lexsort((both, -alike, both < 0), axis=1)[:, :NEIGHBOURS]
    return np.take_along_axis(both, order, 1), np.take_along_axis(alike, order, 1)


def footsteps(lookups: Lookups) -> F32:
    """All footsteps of all walks (n, 128)."""
    return lookups.vectors.reshape(-1, lookups.vectors.shape[-1])


def index_of(folder: Path, shards: Sequence[Path], maps: int, extent: Extent, kind: str) -> Path:
    """The folder of an index, built where it is missing; beside it the seconds that it took."""
    out = folder / f"index-{extent.count(maps)}-{kind}"
    if not out.exists():
        start_s, busy_s = time.perf_counter(), time.process_time()
        build_index(
            kept_rows(shards, extent.count(maps)), out, KINDS[kind],
            encoder=load_encoder("compact").identity,
            maps={f"map {number}": extent.spots for number in range(maps)},
        )  # fmt: skip
        seconds = [time.perf_counter() - start_s, time.process_time() - busy_s]
        with new_file(out.with_suffix(".json")) as partial:
            partial.write_text(json.dumps(dict(zip(("wall", "busy"), seconds, strict=True))))
    return out


def kept_rows(shards: Sequence[Path], count: int) -> list[Rows | Path]:
    """Shards by their files where all of their rows are wanted, so that they are linked."""
    found: list[Rows | Path] = []
    for shard, rows in zip(shards, first_rows(shards, count), strict=False):
        found.append(shard if len(rows) == len(read_rows(shard)) else rows)
    return found


def opened(folder: Path, way: str) -> Index:
    """The index opened for a way of searching: codes alone, or refined by what is kept in full."""
    index = open_index(folder)
    if way == "ivf-pq":
        return Index(index.folder, index.meta, index.main, (), index.added, index.gone)
    return index
