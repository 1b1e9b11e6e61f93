"""Whether echoes alone say which of many buildings a phone is in: votes of footsteps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import FixStatus
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.serve.nearest import Naming, which_map
from studies.elf_spots import FOOTSTEPS, Lookups
from studies.figures.nearest_figures import endings_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_range
from studies.nearest_material import (
    NEIGHBOURS,
    VISITORS,
    Extent,
    exact_answers,
    folder_of,
    footsteps,
    index_of,
    lookups_of,
    opened,
    spots_of,
)
from studies.simulated_buildings import FLOORS

TAKEN = (1, 4, 8, 16)
"""Footsteps that vote."""
EXACT = "looking at all"
BY = {"ivf-flat": "ivf-flat", "ivf-pq, refined": "ivf-pq"}
"""Ways to search whose votes are counted, and their indexes."""
ENDINGS = ("right", "wrong", "ambiguous", "unknown")
NOTE = (
    "A map is one floor of a building of two, which are alike but for surfaces and furniture. "
    "Right map and right building: of the first candidate, however the vote ends; the maps of a "
    "building are taken together there. Right, wrong, ambiguous, unknown: how the vote ends. A "
    "stranger walks through a building that has no map: whatever is named is wrong there. "
    "Intervals: 95 %, over walks."
)


def measure_nearest_map(
    given: Given,
    *,
    extent: Extent = Extent(),  # noqa: B008
) -> Finding:
    """A row per number of buildings, way to search, visitor and number of footsteps that vote.

    It takes what `nearest` left in the folder `nearest.material`, and makes what is missing.
    """
    folder = folder_of(given.kept)
    shards = spots_of(folder, extent, given.announce, given.workers)
    lookups = lookups_of(folder, extent, given.announce)
    rows: list[Row] = []
    for maps in extent.maps:
        given.announce(f"{maps} maps", extent.maps.index(maps) / len(extent.maps))
        exact = exact_answers(folder, shards, extent.count(maps), lookups)
        rows += _rows(EXACT, maps, exact, lookups, partial(_floor_divided, extent.spots))
        for way, kind in BY.items():
            if kind in extent.kinds:
                index = opened(index_of(folder, shards, maps, extent, kind), way)
                found = {who: index.search(footsteps(lookups[who]), NEIGHBOURS) for who in VISITORS}
                rows += _rows(way, maps, found, lookups, index.map_of)
    return Finding(rows, _page(rows))


def _floor_divided(spots: int, ids: I64) -> I64:
    return ids // spots


def _rows(
    by: str,
    maps: int,
    found: dict[str, tuple[I64, F32]],
    lookups: dict[str, Lookups],
    map_of: Callable[[I64], I64],
) -> Iterator[Row]:
    for who in VISITORS:
        for taken in TAKEN:
            yield {
                "buildings": -(-maps // FLOORS), "by": by, "visitor": who, "footsteps": taken,
                **votes(*found[who], lookups[who].map_number, taken, map_of),
            }  # fmt: skip


def votes(
    ids: I64, similarity: F32, true: I64, taken: int, map_of: Callable[[I64], I64]
) -> dict[str, float]:
    """How the votes of `taken` footsteps each end, over walks of 16 that follow one another."""
    walk = np.repeat(np.arange(len(true)), FOOTSTEPS // taken)
    groups = np.arange(len(ids)).reshape(-1, taken)
    named = [which_map(ids[rows], similarity[rows], map_of) for rows in groups]
    built = [
        which_map(ids[rows], similarity[rows], lambda each: map_of(each) // FLOORS)
        for rows in groups
    ]
    right = np.array([_first(each) for each in named]) == true[walk]
    house = np.array([_first(each) for each in built]) == true[walk] // FLOORS
    ends = Counter(_ending(each, int(true[k])) for each, k in zip(named, walk, strict=True))
    low, high = mean_range(right.astype(float).reshape(len(true), -1))
    return {
        "votes": len(groups),
        "right map": round(_mean(right), 3),
        "from": round(low, 3),
        "to": round(high, 3),
        "right building": round(_mean(house), 3),
        **{ending: round(ends[ending] / len(groups), 3) for ending in ENDINGS},
    }


def _mean(values: F64) -> float:
    return float(np.mean(values))


def _first(naming: Naming) -> int:
    return naming.candidates[0].number if naming.candidates else -1


def _ending(naming: Naming, true: int) -> str:
    if naming.status is FixStatus.OK:
        return "right" if _first(naming) == true else "wrong"
    return "ambiguous" if naming.status is FixStatus.AMBIGUOUS else "unknown"


def _page(rows: Sequence[Row]) -> Page:
    buildings = sorted({int(str(row["buildings"])) for row in rows})
    panels = [
        Panel(f"{count:,} buildings", endings_figure(_shares(rows, count), TAKEN))
        for count in buildings
    ]
    table = Panel("All", rows_table(list(rows)), NOTE, wide=True)
    return Page("Which building", "Named by echoes alone, or not", [*panels, table])


def _shares(rows: Sequence[Row], buildings: int) -> dict[str, dict[str, list[float]]]:
    """The shares of endings of each visitor by exact search, in the order of the footsteps."""
    mine = [row for row in rows if row["buildings"] == buildings and row["by"] == EXACT]
    return {
        who: {
            ending: [float(str(row[ending])) for row in mine if row["visitor"] == who]
            for ending in ENDINGS
        }
        for who in VISITORS
    }
