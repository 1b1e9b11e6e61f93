"""Our echoes beside those of pyroomacoustics: the same random rooms, order and paths."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world import pyroom
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, built_in_device
from elfslam.world.materials import Material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers, air_at, image_echoes, render_frames
from elfslam.world.pulses import C64, CARRIER_HZ, Air
from elfslam.world.room import Block, Room, box, check_outline, segments_cross, shoebox
from elfslam.world.scene import Scene, scene_of
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

ROOMS = 20
OURS = "ours beside pyroomacoustics"
REACH = Reach(longest_m=21.0, order=4, plan_order=4, block_order=4, beside_block=4)
RATE_HZ = 44_100
CARDIOID = 0.5
CLEARANCE_M = 0.3
NOBODY = np.zeros((1, 0, 2))
SAME_M = 5e-4
"""Paths closer than this in length are one to the comparison."""
SLOPE_BINS = slice(215, 416)
"""One kilohertz to either side of the carrier: over these an envelope's delay is measured."""


class Comparison(NamedTuple):
    """One room: correlation of the chirp's sound, and what sets single paths apart."""

    correlation: float
    paths: int
    only_one: int
    arrival_us: float
    level_db: float


def measure_fidelity(context: StudyContext, *, rooms: int = ROOMS) -> list[Record]:
    """How close two engines come, at worst and at the median, by room and lobe (the condition).

    Raises InputError without pyroomacoustics.
    """
    records = []
    for kind, draw in (("shoebox", random_shoebox), ("polygon with blocks", random_polygon)):
        for lobe, directivity in (("omnidirectional", 0.0), ("cardioid", CARDIOID)):
            found = []
            for seed in range(rooms):
                context.announce(f"{kind}, {lobe}", seed / rooms)
                found.append(compare_room(draw, directivity, seed))
            of = Record(OURS, world=kind, condition=lobe, seeds=seeds_text(range(rooms)))
            records += of.each(_summary(found))
    return records


def _summary(found: list[Comparison]) -> dict[str, float]:
    decorrelation = 100 * (1 - np.array([room.correlation for room in found]))
    return {
        "decorrelation, worst (%)": float(decorrelation.max()),
        "decorrelation, median (%)": float(np.median(decorrelation)),
        "paths compared": float(sum(room.paths for room in found)),
        "paths of one engine alone": float(sum(room.only_one for room in found)),
        "arrival error, worst (us)": max(room.arrival_us for room in found),
        "level error, worst (dB)": max(room.level_db for room in found),
    }


def compare_room(
    draw: Callable[[np.random.Generator], Room], directivity: float, seed: int
) -> Comparison:
    """Both engines in one random room; the same room and places for any directivity."""
    generator = np.random.default_rng([seed, 17])
    room = draw(generator)
    scene, ends = scene_of(room), random_ends(room, directivity, generator)
    air = air_at()
    ours = image_echoes(scene, ends, NOBODY, air, REACH)
    theirs = pyroom.image_echoes(scene, ends, NOBODY, air, REACH)
    return Comparison(correlation_of(ours, theirs), *_compare_paths(scene, ends, air))


def correlation_of(ours: C64, theirs: C64) -> float:
    """Normalised correlation, at no lag, of the chirp's sound in two rooms."""
    chirp, flat = make_chirp(ChirpParameters(), RATE_HZ), built_in_device("flat")
    a, b = (
        render_frames(responses, chirp, flat).astype(np.float64).ravel()
        for responses in (ours, theirs)
    )
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def _compare_paths(scene: Scene, ends: Transducers, air: Air) -> tuple[int, int, float, float]:
    """Paths in both, paths in one alone, and the largest differences in time (us) and level (dB).

    Ours are heard one by one, as what the response gains when the longest path passes theirs.
    """
    omni = ends._replace(speaker_directivity=0.0, microphone_directivity=0.0)
    length_m, gain, _ = pyroom.visible_images(scene, omni, 0, REACH)
    order = np.argsort(length_m)
    length_m, gain = length_m[order], gain[order]
    first = np.flatnonzero(np.diff(length_m, prepend=-1.0) > 2 * SAME_M)
    last = np.append(first[1:], len(length_m)) - 1
    limits = np.column_stack([length_m[first] - SAME_M, length_m[last] + SAME_M]).ravel()
    limits = np.append(limits, REACH.longest_m)
    total = [
        image_echoes(scene, omni, NOBODY, air, REACH._replace(longest_m=limit))[0]
        for limit in limits
    ]
    heard = np.diff(np.array(total, dtype=np.complex128), axis=0, prepend=0)
    extra, single = np.abs(heard[0::2]).max(axis=1) > 1e-5, first == last
    missing, late_us, louder_db = 0, [0.0], [0.0]
    for k in np.flatnonzero(single):
        response = heard[2 * k + 1]
        if np.abs(response).max() < 1e-6:
            missing += 1
            continue
        late, louder = _differences(response, length_m[first[k]], gain[first[k]], air)
        late_us.append(abs(late))
        louder_db.append(abs(louder))
    return len(late_us) - 1, missing + int(extra.sum()), max(late_us), max(louder_db)


def _differences(response: C64, length_m: float, gain: float, air: Air) -> tuple[float, float]:
    """How much later (us) and louder (dB) one path is than it should be.

    The later one of two: by the carrier's phase, and by the slope of the phase over the band.
    """
    hz = BAND_LOW_HZ + BIN_HZ * np.arange(BAND_BINS)
    transfer = np.fft.fftshift(np.fft.fft(response))
    transfer = transfer * np.exp(2j * np.pi * hz * length_m / air.speed_mps)
    by_phase = -np.angle(transfer[BAND_BINS // 2]) / (2 * np.pi * CARRIER_HZ)
    slope = np.polyfit(hz[SLOPE_BINS], np.unwrap(np.angle(transfer[SLOPE_BINS])), 1)[0]
    late_s = max(by_phase, -slope / (2 * np.pi), key=abs)
    expected = gain / length_m * np.exp(-air.attenuation_per_m * length_m)
    return late_s * 1e6, float(20 * np.log10(np.abs(transfer[BAND_BINS // 2]) / expected))


# --- random rooms ---


def random_shoebox(generator: np.random.Generator) -> Room:
    """An empty rectangle."""
    size_m = generator.uniform([3.0, 3.0, 2.3], [9.0, 7.0, 4.0])
    return shoebox(size_m, tuple(_surface(generator) for _ in range(6)))


def random_polygon(generator: np.random.Generator) -> Room:
    """Five to eight corners around a middle, mostly not convex, and up to three closed blocks."""
    corners = int(generator.integers(5, 9))
    turn = 2 * np.pi * (np.arange(corners) + generator.uniform(-0.3, 0.3, corners)) / corners
    radius_m = generator.uniform(2.0, 5.0, (corners, 1))
    outline_m = check_outline(radius_m * np.column_stack([np.cos(turn), np.sin(turn)]))
    height_m = generator.uniform(2.3, 4.0)
    blocks: tuple[Block, ...] = ()
    for k in range(int(generator.integers(1, 4))):
        blocks += (_free_block(f"block {k}", outline_m, height_m, blocks, generator),)
    walls = tuple(_surface(generator) for _ in range(corners))
    floor, ceiling = _surface(generator), _surface(generator)
    return Room(outline_m, height_m, walls, floor, ceiling, blocks)


def _surface(generator: np.random.Generator) -> Material:
    return Material("surface", generator.uniform(0.1, 0.6), 0.0, "drawn at random")


def _free_block(
    name: str,
    outline_m: F64,
    height_m: float,
    others: tuple[Block, ...],
    generator: np.random.Generator,
) -> Block:
    """A block from floor to ceiling that touches neither walls nor other blocks."""
    shapes = [outline_m, *(block.corners_m for block in others)]
    low_m, high_m = outline_m.min(axis=0), outline_m.max(axis=0)
    for _ in range(10_000):
        corner_m = np.append(generator.uniform(low_m, high_m), 0.0)
        size_m = np.append(generator.uniform(0.3, 1.5, 2), height_m)
        turn_rad = generator.uniform(0, np.pi)
        block = box(name, corner_m, size_m, _surface(generator), turn_rad, clutter_per_m2=0.0)
        within = Room(outline_m, height_m, (), block.surface, block.surface, others)
        corners_m = block.corners_m
        if within.is_free(corners_m, 1.0, 0.05).all() and not any(
            _cross(corners_m, shape) for shape in shapes
        ):
            return block
    raise InputError(f"found no room for {name!r}; draw another polygon")


def _cross(one_m: F64, other_m: F64) -> bool:
    return any(
        segments_cross(a, b, c, d)
        for a, b in zip(one_m, np.roll(one_m, -1, axis=0), strict=True)
        for c, d in zip(other_m, np.roll(other_m, -1, axis=0), strict=True)
    )


def random_ends(room: Room, directivity: float, generator: np.random.Generator) -> Transducers:
    """A still speaker and a microphone anywhere free in the room, held by nobody."""
    places_m: list[F64] = []
    while len(places_m) < 2:
        xy_m = room.corner_m + generator.uniform(0, 1, (1, 2)) * room.size_m[:2]
        z_m = generator.uniform(CLEARANCE_M, room.height_m - CLEARANCE_M)
        if room.is_free(xy_m, z_m, CLEARANCE_M).all():
            places_m.append(np.append(xy_m, z_m)[None])
    axes = generator.standard_normal((2, 1, 3))
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    ahead, still = np.array([[1.0, 0.0]]), np.zeros((1, 3))
    (speaker, microphone), (speaks, hears) = places_m, axes
    rows = (speaker, microphone, speaks, hears, ahead, still, still)
    return Transducers(*rows, directivity, directivity, False)


STUDY = Study(
    "Does our engine make the same echoes as pyroomacoustics?",
    measure_fidelity, minutes=4, needs=("pyroomacoustics",), fast={"rooms": 1},
)  # fmt: skip
