"""What phones fetch of a map: how far fixes move by its halves, and what one more walk costs.

python -m studies.benchmarks.map_packages fixes      development worlds, seeds 100 to 103
python -m studies.benchmarks.map_packages updates    maps of two walks, and a third that is added
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterator

import numpy as np

from elfslam.base.choices import Mode
from elfslam.base.values import Features, Fixes, FloorMap, Odometry
from elfslam.data.tiles import Stretch, Tile, encoder_identity, map_of_parts, stretches_of, tiles_of
from elfslam.line.feature import extract_features, load_encoder
from elfslam.line.locate import locate_one_shot
from elfslam.slam.front_end import hear, walk_nodes
from elfslam.slam.merging import MappedWalk, MergeParameters, add_walk, merge
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import footstep_likeness, locate_walk, map_by_echoes
from elfslam.world.kinds import QUIET
from elfslam.world.simulate import load_world, simulate
from studies.merged_walks import FIRST, WHOLE, Stroll, strolled

Row = dict[str, object]
PARAMETERS = Parameters()


def main() -> None:
    """Print rows as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("fixes", "updates"))
    for row in {"fixes": moved_fixes, "updates": updates}[parser.parse_args().what]():
        print(json.dumps(row), flush=True)


def moved_fixes() -> Iterator[Row]:
    """How far fixes in the map of tiles lie from those in the map itself, per walk.

    Beside the tracker's it says how far another seed moves them, as its particles are drawn.
    """
    encoder = load_encoder("compact")
    for world, seed in ((name, seed) for name in ("studio", "lounge") for seed in range(100, 104)):
        recording, _ = simulate(load_world(world), seed, rounds=2)
        stranger, _ = simulate(load_world(world), seed + 50, rounds=1)
        floor_map = map_by_echoes(recording, encoder, PARAMETERS).floor_map
        assert floor_map is not None
        heard = extract_features(hear(stranger, PARAMETERS), encoder)
        nodes, tiled = walk_nodes(stranger, PARAMETERS), through_tiles(floor_map)
        one, other = (
            locate_one_shot(heard, each, PARAMETERS.locate) for each in (floor_map, tiled)
        )
        drawn = (floor_map, 0), (tiled, 0), (floor_map, 1)
        tracked = [tracks(heard, nodes, each, seed) for each, seed in drawn]
        yield {
            "world": world, "seed": seed, "spots": len(floor_map.xy_m),
            "one_shot_mm": apart_mm(one, other), "tracked_mm": apart_mm(tracked[0], tracked[1]),
            "other_seed_mm": apart_mm(tracked[0], tracked[2]),
        }  # fmt: skip


def through_tiles(floor_map: FloorMap) -> FloorMap:
    """The map as a phone holds it."""
    tiles = [tile.content for tile in tiles_of(floor_map)]
    stretches = [(each.walk, each.content) for each in stretches_of(floor_map)]
    encoder = encoder_identity(floor_map)
    return map_of_parts(tiles, stretches, encoder=encoder, sources=floor_map.sources)


def tracks(heard: Features, nodes: Odometry, floor_map: FloorMap, seed: int) -> Fixes:
    """The tracker's fixes."""
    scores = footstep_likeness(heard, nodes, floor_map, PARAMETERS.locate)
    return locate_walk(nodes, scores, floor_map, PARAMETERS, mode=Mode.TRACK, seed=seed)


def apart_mm(one: Fixes, other: Fixes) -> Row:
    """How far fixes lie apart, and how many have another status."""
    away = np.linalg.norm(one.xy_m - other.xy_m, axis=1)
    away = 1000 * away[np.isfinite(away)]
    return {
        "fixes": len(away),
        "median": round(float(np.median(away)), 3),
        "largest": round(float(away.max()), 2),
        "other_status": int((one.status != other.status).sum()),
    }


def updates() -> Iterator[Row]:
    """Bytes of the parts that one more walk changes, against all of them.

    Two walks become a map; then a third is added to it, or all three are merged anew.
    """
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
