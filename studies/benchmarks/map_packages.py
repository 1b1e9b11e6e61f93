"""What a phone fetches of a map that it holds when one more walk is added to it.

    python -m studies.benchmarks.map_packages

Two walks become a map; then a third is added to it, or all three are merged anew. A row has the
bytes of the parts that changed against all of them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterator

from elfslam.base.values import FloorMap
from elfslam.data.tiles import Stretch, Tile, stretches_of, tiles_of
from elfslam.slam.merging import MappedWalk, MergeParameters, add_walk, merge
from elfslam.world.kinds import QUIET
from studies.merged_walks import FIRST, WHOLE, Stroll, strolled

Row = dict[str, object]


def main() -> None:
    """Print rows as JSON."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for row in updates():
        print(json.dumps(row), flush=True)


def updates() -> Iterator[Row]:
    """A row for each world, and for a third walk of a part of its route and of all of it."""
    parameters = MergeParameters()
    for world in ("studio", "lounge", "concourse"):
        walks = [strolled(Stroll(world, seed, rounds=2, kind=QUIET.name))[0] for seed in (100, 101)]
        for part, seed in ((FIRST, 102), (WHOLE, 103)):
            third = strolled(Stroll(world, seed, rounds=1, part=part, kind=QUIET.name))[0]
            yield {"world": world, "walked": part, **grown(walks, third, parameters)}


def grown(walks: list[MappedWalk], third: MappedWalk, parameters: MergeParameters) -> Row:
    """A map of two walks, and what a phone fetches once there are three."""
    before = merge(walks, parameters).maps
    if not before:
        return {"problem": "the first two are not merged"}
    added, found, _ = add_walk(before[0].floor_map, third, parameters)
    if found.refusal:
        return {"problem": found.refusal}
    anew = merge([*walks, third], parameters).maps
    row: Row = {"added": compared(before[0].floor_map, added)}
    return {**row, "anew": compared(before[0].floor_map, anew[0].floor_map)} if anew else row


def compared(before: FloorMap, after: FloorMap) -> Row:
    """How much of a map a phone fetches that holds the map before."""
    held = {sha256_of(each.content) for each in parts_of(before)}
    fresh = [each for each in parts_of(after) if sha256_of(each.content) not in held]
    whole, fetched = (sum(len(each.content) for each in some) for some in (parts_of(after), fresh))
    return {
        "spots": [len(before.xy_m), len(after.xy_m)],
        "parts": len(parts_of(after)),
        "bytes": whole,
        "fetched_parts": len(fresh),
        "fetched_bytes": fetched,
        "share": round(fetched / whole, 3),
    }


def parts_of(floor_map: FloorMap) -> list[Tile | Stretch]:
    """All parts of a map's package but the encoder, which stays."""
    return [*tiles_of(floor_map), *stretches_of(floor_map)]


def sha256_of(content: bytes) -> str:
    """What a part is known by."""
    return hashlib.sha256(content).hexdigest()


if __name__ == "__main__":
    main()
