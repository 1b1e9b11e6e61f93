"""Spots of many simulated maps on disk, in shards, and walks of others who look them up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from elfslam.app.workers import Here, Workers
from elfslam.base.arrays import F32, F64, I64
from elfslam.base.progress import Announce
from elfslam.base.values import Features
from elfslam.data.folders import new_file
from elfslam.line.feature import Encoder
from elfslam.line.floormap import window_means
from studies.simulated_buildings import (
    FIRST_SEED,
    FLOORS,
    STEP_S,
    BuildingWalk,
    OneThread,
    beside,
    floor_rooms,
    floor_walks,
    heard,
    random_visit,
)

SPOTS = 4000
"""Of a map: the echoes of 7 minutes of walking."""
SHARD_MAPS = 50
WINDOW_S = 0.6
"""Echoes of one footstep, whose mean a spot is, as in a floor map."""
FOOTSTEPS = 16
ECHOES = 6
"""Of a footstep, in a query."""
F16 = npt.NDArray[np.float16]


class MadeMap(NamedTuple):
    """Spots (n, 128) of one map, unit rows; their x, y, heading and room (n, 4)."""

    vectors: F16
    places: F32


@dataclass(frozen=True)
class Shard:
    """Some maps that lie in one file."""

    file: Path
    maps: tuple[int, ...]
    spots: int


def make_spots(
    folder: Path,
    maps: int,
    announce: Announce,
    *,
    spots: int = SPOTS,
    shard_maps: int = SHARD_MAPS,
    workers: Workers | None = None,
) -> list[Path]:
    """The shards `spots-00000.npy` ... of so many maps, those that lie there left as they are.

    A shard holds unit rows (shard_maps x spots, 128) in half precision; beside it lie the
    `places`, x, y, heading and room of each.
    """
    numbers = [range(maps)[k : k + shard_maps] for k in range(0, maps, shard_maps)]
    shards = [
        Shard(folder / f"spots-{k:05d}.npy", tuple(each), spots) for k, each in enumerate(numbers)
    ]
    waiting = [shard for shard in shards if not shard.file.exists()]
    done = len(shards) - len(waiting)
    announce(f"{done} of {len(shards)} shards", done / len(shards))
    for _ in (workers or Here()).each(make_shard, waiting):
        done += 1
        announce(f"{done} of {len(shards)} shards", done / len(shards))
    return [shard.file for shard in shards]


def make_shard(shard: Shard) -> None:
    """The files of a shard, the one that says that it is whole last."""
    encoder = OneThread()
    made = [make_map(number, shard.spots, encoder) for number in shard.maps]
    _write(places_of(shard.file), np.concatenate([each.places for each in made]))
    _write(shard.file, np.concatenate([each.vectors for each in made]))


def places_of(shard: Path) -> Path:
    """Where the places of a shard's spots lie."""
    return shard.with_name(shard.name.replace("spots", "places"))


def make_map(number: int, spots: int, encoder: Encoder) -> MadeMap:
    """Map `number`, one floor of one building, walked by one person with one phone."""
    generator = _generator(number, 0)
    rooms = floor_rooms(*divmod(number, FLOORS))
    walks, visit = floor_walks(generator, rooms, spots), random_visit(generator)
    parts = [
        MadeMap(
            unit(leg_means(heard(generator, room, visit, walk, encoder), walk)).astype(np.float16),
            np.column_stack([walk.xy_m, walk.yaw_rad, np.full(len(walk.leg), k)]).astype("f4"),
        )
        for k, (room, walk) in enumerate(zip(rooms, walks, strict=True))
        if len(walk.leg)
    ]
    return MadeMap(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _generator(number: int, purpose: int) -> np.random.Generator:
    return np.random.default_rng([FIRST_SEED, number, 7, purpose])


def leg_means(vectors: F32, walk: BuildingWalk) -> F32:
    """For each echo the mean over those within the window about it, of the same leg."""
    starts = np.flatnonzero(np.diff(walk.leg, prepend=-1))
    parts = []
    for a, b in zip(starts, [*starts[1:], len(walk.leg)], strict=True):
        t_s = STEP_S * np.arange(b - a)
        parts.append(window_means(Features(t_s, vectors[a:b], ""), t_s, WINDOW_S))
    return np.concatenate(parts)


def unit(vectors: F32) -> F32:
    """The rows at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), dtype=np.float32)


def _write(file: Path, rows: npt.NDArray[np.floating]) -> None:
    with new_file(file) as partial, partial.open("wb") as stream:
        np.save(stream, rows)


class Lookups(NamedTuple):
    """Walks that ask where they are: footsteps (w, 16, 128), the map of each (w), where (w, 16, 4).

    The map of a walk through a building that has none is given by its number all the same.
    """

    vectors: F32
    map_number: I64
    places: F32


def make_lookups(maps: list[int], purpose: int, *, other_phone: bool, spots: int) -> Lookups:
    """A walk of 16 footsteps in each map, a few centimetres off, on another day.

    Another holder, air and people each time; the phone is that of the map, or another.
    """
    encoder = OneThread()
    made = [
        _lookup(number, purpose, other_phone=other_phone, spots=spots, encoder=encoder)
        for number in maps
    ]
    vectors, places = (np.stack(column) for column in zip(*made, strict=True))
    return Lookups(vectors, np.array(maps), places)


def _lookup(
    number: int, purpose: int, *, other_phone: bool, spots: int, encoder: Encoder
) -> tuple[F32, F32]:
    again, generator = _generator(number, 0), _generator(number, purpose)
    rooms = floor_rooms(*divmod(number, FLOORS))
    walks, visit = floor_walks(again, rooms, spots), random_visit(again)
    now = random_visit(generator)
    if not other_phone:
        now = type(now)(visit.device, now.holder, now.air, now.people)
    size = np.array([len(walk.leg) for walk in walks])
    room = int(generator.choice(len(rooms), p=size / size.sum()))
    first = int(generator.integers(max(size[room] - FOOTSTEPS * ECHOES, 1)))
    walk = beside(generator, walks[room], first, FOOTSTEPS * ECHOES)
    elf = heard(generator, rooms[room], now, walk, encoder)
    where = np.column_stack([walk.xy_m, walk.yaw_rad, np.full(len(walk.leg), room)])
    return unit(_by_footstep(elf)), _by_footstep(where).astype(np.float32)


def _by_footstep(rows: F32 | F64) -> F32:
    return np.asarray(rows.reshape(FOOTSTEPS, ECHOES, -1).mean(axis=1), dtype=np.float32)
