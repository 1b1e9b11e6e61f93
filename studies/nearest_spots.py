"""Nearest spots among millions of simulated ELFs: what each kind of index finds, and its size."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.serve.nearest import Index, build_index, exact_search, open_index
from studies.elf_spots import FOOTSTEPS, Lookups, places_of
from studies.figures.nearest_figures import Recall, recall_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_range
from studies.nearest_material import (
    KINDS,
    NEIGHBOURS,
    VISITORS,
    WAYS,
    Extent,
    exact_answers,
    first_rows,
    folder_of,
    footsteps,
    index_of,
    lookups_of,
    opened,
    spots_of,
)

EFFORTS = {"ivf-flat": (1, 4, 16, 32, 64), "ivf-pq": (4, 32), "ivf-pq, refined": (4, 16, 32, 64)}
EFFORTS |= {"hnsw": (16, 64, 256), "flat": (1,)}
"""Cells or open ends that a search looks at."""
NEAR_M = 1.0
RANDOM = "random vectors"
SIZES = ("bytes per spot", "of them searched", "build (s)", "build, processor (s)")
NOTE = (
    "Spots: mean ELFs over 0.6 s of simulated walks through random furnished rooms, 4,000 a map, "
    "by the shipped encoder. Asked: footsteps of walks on another day, about 10 cm off, half of "
    "them with another phone. Recall at 1: the very spot that looking at all gives; in 10: it is "
    "among ten. Within 1 m: the found spot is of the right map and at most 1 m from where the "
    "footstep was. Intervals: 95 %, over walks."
)


def measure_nearest(
    given: Given,
    *,
    extent: Extent = Extent(),  # noqa: B008
    random_spots: int = 1_000_000,
) -> Finding:
    """A row per number of spots, kind of index and effort: recall, size, seconds to build.

    Spots, walks and indexes stay in the folder `nearest.material` beside `kept` and are not made
    again. The last rows are of vectors drawn at random, `random_spots` of them.
    """
    folder = folder_of(given.kept)
    shards = spots_of(folder, extent, given.announce, given.workers)
    lookups = lookups_of(folder, extent, given.announce)
    rows: list[Row] = []
    for maps in extent.maps:
        given.announce(f"{extent.count(maps):,} spots, looking at all", None)
        exact = exact_answers(folder, shards, extent.count(maps), lookups)
        for kind in extent.kinds:
            given.announce(f"{extent.count(maps):,} spots, {kind}", None)
            index = index_of(folder, shards, maps, extent, kind)
            rows += _rows_of(index, kind, lookups, exact, shards)
    given.announce("random vectors", None)
    rows += _random_rows(folder, random_spots, extent.walks)
    return Finding(rows, page(rows))


def _rows_of(
    folder: Path,
    kind: str,
    lookups: dict[str, Lookups],
    exact: dict[str, tuple[I64, F32]],
    shards: Sequence[Path],
) -> Iterator[Row]:
    known = VISITORS[:2]
    asked = np.concatenate([footsteps(lookups[who]) for who in known])
    wanted = np.concatenate([exact[who][0] for who in known])
    size = _sizes(folder)
    for way in (way for way, of in WAYS.items() if of == kind):
        index = opened(folder, way)
        for effort in EFFORTS[way]:
            ids = wanted if way == "flat" else index.search(asked, NEIGHBOURS, effort=effort)[0]
            within = [
                _near(part[:, 0], lookups[who], index, shards)
                for part, who in zip(np.split(ids, 2), known, strict=True)
            ]
            yield {
                "vectors": "ELFs", **_recalls(index, way, effort, ids, wanted),
                "within 1 m": round(float(np.mean(within)), 3), **size,
            }  # fmt: skip


def _recalls(index: Index, way: str, effort: int, ids: I64, wanted: I64) -> Row:
    found = (ids[:, 0] == wanted[:, 0]).astype(float)
    low, high = mean_range(found.reshape(-1, FOOTSTEPS))
    ten = (ids[:, :10] == wanted[:, :1]).any(axis=1)
    return {
        "spots": index.meta.count,
        "way": way,
        "effort": effort,
        "recall at 1": round(float(found.mean()), 4),
        "from": round(low, 4),
        "to": round(high, 4),
        "in 10": round(float(ten.mean()), 4),
    }


def _near(ids: I64, lookups: Lookups, index: Index, shards: Sequence[Path]) -> F64:
    """Whether each spot is of the right map and room and within 1 m of the footstep."""
    places = first_rows([places_of(shard) for shard in shards], index.meta.count)
    size = np.cumsum([0, *map(len, places)])
    which = np.searchsorted(size, ids, side="right") - 1
    there = np.stack([places[k][j - size[k]] for k, j in zip(which, ids, strict=True)])
    asked = lookups.places.reshape(-1, there.shape[1])
    near = np.hypot(*(there[:, :2] - asked[:, :2]).T) <= NEAR_M
    right = index.map_of(ids) == np.repeat(lookups.map_number, FOOTSTEPS)
    return np.asarray(near & right & (there[:, 3] == asked[:, 3].round()), dtype=np.float64)


def _sizes(folder: Path) -> Row:
    """Bytes on the disk per spot, and seconds to build, in all and of the processor."""
    index = open_index(folder)
    took = json.loads(folder.with_suffix(".json").read_text(encoding="utf-8"))
    every = sum(each.bytes for each in index.meta.files)
    searched = index.meta.main.bytes if index.meta.main else every
    of_each = [round(total / index.meta.count, 1) for total in (every, searched)]
    return dict(zip(SIZES, [*of_each, *(round(took[k], 1) for k in ("wall", "busy"))], strict=True))


def _random_rows(folder: Path, count: int, walks: int) -> Iterator[Row]:
    """The same for rows without any structure, asked with noise that leaves a cosine of 0.87."""
    generator = np.random.default_rng(0)
    rows = _unit(generator.standard_normal((count, 128), dtype=np.float32)).astype(np.float16)
    picked = rows[generator.choice(count, 2 * walks * FOOTSTEPS)].astype(np.float32)
    noise = generator.standard_normal(picked.shape, dtype=np.float32) / np.sqrt(128.0)
    asked = _unit(picked + np.float32(0.57) * noise)
    wanted, _ = exact_search([rows], asked, NEIGHBOURS)
    for kind in ("ivf-flat",):
        out = folder / f"random-{count}-{kind}"
        if not out.exists():
            build_index([rows], out, KINDS[kind], encoder="random")
        index = open_index(out)
        for effort in EFFORTS[kind]:
            ids, _ = index.search(asked, NEIGHBOURS, effort=effort)
            row = _recalls(index, kind, effort, ids, wanted)
            yield {"vectors": RANDOM, **row, "within 1 m": None, **dict.fromkeys(SIZES)}


def _unit(rows: F32) -> F32:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


def page(rows: Sequence[Row]) -> Page:
    """Recall by effort for each number of spots, and the table."""
    counts = sorted({(str(row["vectors"]), int(str(row["spots"]))) for row in rows})
    panels = [
        Panel(f"{count:,} {vectors}", recall_figure(_curves(rows, vectors, count)))
        for vectors, count in counts
    ]
    table = Panel("All", rows_table(rows), NOTE, wide=True)
    return Page(
        "Nearest spots", "What an index finds of what looking at all finds", [*panels, table]
    )


def _curves(rows: Sequence[Row], vectors: str, count: int) -> dict[str, Recall]:
    found: dict[str, Recall] = {}
    for way in WAYS:
        mine = [
            [float(str(row[name])) for name in ("effort", "recall at 1", "from", "to")]
            for row in rows
            if (row["vectors"], row["spots"], row["way"]) == (vectors, count, way)
        ]
        if mine and way != "flat":
            found[way] = Recall(*np.array(mine).T)
    return found
