"""Laps that people walk in a world, heard where their phones chirp: no recording is made of them.

Echoes are rendered chirp by chirp and cut as the line cuts them, so that forty laps take seconds.
Where a phone was is the truth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64, Value, array
from elfslam.base.values import ECHO_RATE_HZ, ECHO_SAMPLES, Features
from elfslam.stages.chirp import ChirpParameters
from elfslam.stages.feature import Encoder, walk_vectors
from elfslam.stages.floormap import FloorMapParameters, window_means
from elfslam.world.circumstances import Circumstances
from elfslam.world.echo_pairs import cut_frames
from elfslam.world.kinds import Kind, kind_named
from elfslam.world.phone import render_frames, room_responses
from elfslam.world.recorder import Stage, phone_poses, stage_of
from elfslam.world.room import Room
from elfslam.world.stroll import Way, lane_of, random_person, stroll_on, way_through
from elfslam.world.walker import Motion, Walker
from elfslam.world.world_file import World, load_world

FOOTSTEP_S = 0.6
ECHOES = 6
"""To a footstep."""
MOVED_M = 0.3
"""Who has not come so far within a footstep stands; who stands is left out."""
STRANGER_ALONE, PHONE, DAY, PHONE_AND_DAY = (
    "another person", "another phone", "another day", "another phone, another day"
)  # fmt: skip
CHANGES: Mapping[str, tuple[str, ...]] = {
    PHONE_AND_DAY: ("device", "day"), PHONE: ("device",), DAY: ("day",), STRANGER_ALONE: (),
}  # fmt: skip
"""What of the circumstances is not as it was mapped, by who asks; a person who does not map."""
MAPPER, STRANGER = 31, 32
"""Streams of random numbers: those of each who maps, and those of who is to be located."""


class Venue(NamedTuple):
    """Where laps are walked: the world, what those who map and who ask hear alike, both ways."""

    world: World
    mapping: Stage
    asking: Stage
    people: int
    ways: tuple[Way, Way]


@dataclass(frozen=True)
class Crowd:
    """People who map a world in lanes of this standard deviation, as many as the most of `laps`."""

    world: str
    kind: str
    lane_m: float
    seed: int
    laps: tuple[int, ...]
    asked_by: str = PHONE_AND_DAY


@dataclass(frozen=True, eq=False)
class Lap(Value):
    """The echoes (n) of a lap while the phone moved, and where it was at each of them."""

    t_s: F64 = array("n", increasing=True)
    xy_m: F64 = array("n", 2)
    heading_rad: F64 = array("n")
    samples: F32 = array("n", ECHO_SAMPLES, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Places(Value):
    """A feature of each of some places (n), where they are, and which way the walker went."""

    vectors: F32 = array("n", "d", dtype=np.float32)
    xy_m: F64 = array("n", 2)
    heading_rad: F64 = array("n")


def venue_of(world: str, kind: str, asked_by: str = PHONE_AND_DAY) -> Venue:
    """A world in the life of a kind, by names. Raises InputError and ParameterError for others."""
    there, life = load_world(world), kind_named(kind)
    visits = life.mapping(there.room), _asking(life, there.room, asked_by)
    mapping, asking = (stage_of(there, today, ECHO_RATE_HZ, threads=1) for today in visits)
    return Venue(there, mapping, asking, visits[0].people, _both_ways(world))


def _asking(life: Kind, room: Room, asked_by: str) -> Circumstances:
    """The circumstances of the mapping, but for what the one who asks changes."""
    later = life.asking(room)
    changed = {name: getattr(later, name) for name in CHANGES[asked_by]}
    return replace(life.mapping(room), **changed)


@cache
def _both_ways(world: str) -> tuple[Way, Way]:
    """The route of a world and back; how far one can go beside it takes seconds to look up."""
    there = load_world(world)
    return way_through(there.room, there.route_m), way_through(there.room, there.route_m[::-1])


def own_lane_m(world: str) -> float:
    """The lanes that people keep to in a world of this size (standard deviation)."""
    return lane_of(load_world(world).room)


def mapped_lap(venue: Venue, lane_m: float, seed: int, number: int) -> Lap:
    """The lap of one of those who map; every other of them goes the opposite way round."""
    generator = np.random.default_rng([seed, MAPPER, number])
    person = random_person(generator, lane_m)
    return _lap(venue, venue.mapping, person, venue.ways[number % 2], seed, generator)


def strange_laps(venue: Venue, lane_m: float, seed: int) -> tuple[Lap, Lap]:
    """The laps of somebody who does not map, one each way round."""
    generator = np.random.default_rng([seed, STRANGER])
    person = random_person(generator, lane_m)
    first, second = (_lap(venue, venue.asking, person, way, seed, generator) for way in venue.ways)
    return first, second


def spots_of(lap: Lap, encoder: Encoder) -> Places:
    """The spots that a lap gives a map, as the line makes them: one at each echo."""
    window_s = FloorMapParameters().window_s
    vectors = window_means(_features(lap, encoder), lap.t_s, window_s)
    return Places(vectors, lap.xy_m, lap.heading_rad)


def footsteps_of(lap: Lap, encoder: Encoder) -> Places:
    """The mean features of six echoes each, one set after the other, as the line asks by them."""
    features, period_s = _features(lap, encoder), ChirpParameters().period_s
    count = int((lap.t_s[-1] - lap.t_s[0]) / FOOTSTEP_S) + 1
    edges_s = lap.t_s[0] - period_s / 2 + FOOTSTEP_S * np.arange(count + 1)
    means = features.means_between(edges_s, ECHOES)
    whole = np.isfinite(means).all(axis=1)
    middle_s = (edges_s[:-1] + edges_s[1:])[whole] / 2
    xy_m = np.column_stack([np.interp(middle_s, lap.t_s, lap.xy_m[:, k]) for k in range(2)])
    heading_rad = np.interp(middle_s, lap.t_s, lap.heading_rad)
    return Places(means[whole], xy_m, heading_rad)


def joined(parts: Sequence[Places]) -> Places:
    """The places of several laps as one."""
    names = ("vectors", "xy_m", "heading_rad")
    return Places(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _lap(
    venue: Venue, stage: Stage, person: Walker, way: Way, seed: int, generator: np.random.Generator
) -> Lap:
    motion = stroll_on(person, way, 1, generator)
    t_s = _while_moving(motion)
    poses = phone_poses(person, motion, venue.world, venue.people, seed, t_s)
    heard = room_responses(stage.scene, stage.device, poses, stage.air, stage.reach, stage.engine)
    frames = render_frames(heard, stage.chirp, stage.device)
    heading_rad = np.interp(t_s, motion.t_s, motion.heading_rad)
    echoes = cut_frames(generator, frames, stage.device)
    return Lap(t_s, poses.position_m[:, :2], heading_rad, echoes)


def _while_moving(motion: Motion) -> F64:
    """The times of the chirps (n) within a footstep of which the phone comes on."""
    half_s = FOOTSTEP_S / 2
    t_s = np.arange(half_s, motion.t_s[-1] - half_s, ChirpParameters().period_s)
    before, after = (
        np.column_stack(
            [np.interp(t_s + side_s, motion.t_s, motion.position_m[:, k]) for k in range(2)]
        )
        for side_s in (-half_s, half_s)
    )
    return np.asarray(t_s[np.linalg.norm(after - before, axis=1) >= MOVED_M])


def _features(lap: Lap, encoder: Encoder) -> Features:
    return Features(lap.t_s, walk_vectors(lap.samples, encoder), encoder.identity)
