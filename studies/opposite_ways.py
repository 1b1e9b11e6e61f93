"""A room mapped one way round, queried the other: what superimposing two walks is worth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.app.merge import drawn
from elfslam.base.arrays import F32, F64, I64
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Announce, Echoes, Truth
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import Encoder, OnnxEncoder, load_encoder, walk_vectors
from elfslam.stages.floormap import SpotEchoes, floor_spots
from elfslam.world.kinds import SURVEYOR, kind_named
from elfslam.world.simulate import load_world
from studies.cached import at_its_start, extract_echoes, record_of, shipped, simulate, simulated_in
from studies.floor_spots import (
    MEDIAN_M,
    SPACING_M,
    SUPERIMPOSED,
    TOGETHER,
    errors_m,
    fixes_m,
)
from studies.mapping import CALIBRATED, walkers
from studies.results import Record

STRANGER, ASKER = 500, 1000
"""Added to the seed for who walks the other way round, and for who is located."""
STEPS = 300
PLACED = MAPPED, TRUE = "placed by its map", "placed truly"
"""Where the echoes of a map are said to come from: what is left is the map's error, or is not."""
SAME_WAY, OPPOSITE_WAY = "same direction", "opposite direction"
PAPER_M = {SAME_WAY: 0.1, OPPOSITE_WAY: 3.8, SUPERIMPOSED: 0.1}
"""Medians in the paper's living room, whose maps had their own errors."""


@dataclass(frozen=True)
class Ways:
    """A room, walked one way round by one person and the other way by a second; a third asks."""

    world: str = "living_room"
    seed: int = 0
    rounds: int = 4
    steps: int = STEPS
    kind: str = SURVEYOR.name


@dataclass(frozen=True, eq=False)
class Mapped:
    """The echoes of a walk, the poses (n, 3) that its map gives them, and the true ones."""

    echoes: Echoes
    poses: F64
    truth: F64


def measure_ways(task: Ways, folder: Path, announce: Announce) -> list[Record]:
    """Errors (m) of fixes of 0.6 s the other way round, in each map."""
    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    walks = [
        mapped(task, task.seed, reverse=False),
        mapped(task, task.seed + STRANGER, reverse=True),
    ]
    places_m, samples = _asked(task)
    records: list[Record] = []
    for placed in PLACED:
        both = [replace(walk, poses=walk.truth) for walk in walks] if placed == TRUE else walks
        learnt = _learnt(task, both, shipped, folder / placed, announce)
        for name, xy_m, vectors, encoder in _maps(both, shipped, learnt):
            found = fixes_m(walk_vectors(samples, encoder), vectors, xy_m)
            median_m = float(np.median(errors_m(found, places_m)))
            paper_m = PAPER_M.get(name) if placed == MAPPED else None
            of = replace(record_of(task, name, placed), metric=MEDIAN_M, paper=paper_m)
            records.append(replace(of, value=median_m))
    off_m = [np.linalg.norm((walk.poses - walk.truth)[:, :2], axis=1) for walk in walks]
    map_m = float(np.median(np.concatenate(off_m)))
    return [*records, *record_of(task, "maps", MAPPED).each({MEDIAN_M: map_m})]


def mapped(task: Ways, seed: int, *, reverse: bool) -> Mapped:
    """A walk whose start is known, mapped: what superimposition has of it."""
    kind = kind_named(task.kind)
    recording, truth = simulated_in(
        load_world(task.world), seed, task.rounds, kind, reverse=reverse
    )
    known = walkers(seed, kind)[CALIBRATED]
    recording = at_its_start(recording, truth)
    run = map_by_echoes(recording, shipped(), known)
    assert run.echoes is not None
    t_s, heard = run.trajectory.t_s, run.echoes
    inside = (heard.t_s >= t_s[0]) & (heard.t_s <= t_s[-1])
    kept = {name: getattr(heard, name)[inside] for name in ("t_s", "samples")}
    at_s = heard.t_s[inside]
    poses = interpolate_poses(t_s, run.trajectory.world_from_body, at_s)
    true = interpolate_poses(truth.t_s, truth.world_from_body, at_s)
    return Mapped(replace(heard, **kept), poses, true)


def _learnt(
    task: Ways, walks: Sequence[Mapped], shipped: OnnxEncoder, folder: Path, announce: Announce
) -> OnnxEncoder:
    """The encoder of the room, learnt from the walks as their maps place them."""
    from elfslam.learn.floor_level import learn_floor
    from elfslam.learn.parameters import FloorLevelParameters

    parameters = FloorLevelParameters(steps=task.steps)
    heard = [_spot_echoes(walk) for walk in walks]
    spots_m = floor_spots(np.vstack([walk.poses[:, :2] for walk in walks]), SPACING_M)
    folder.mkdir(parents=True, exist_ok=True)
    checkpoint = folder / f"{task.world}-ways-{task.seed}.checkpoint"
    found = learn_floor(
        shipped, spots_m, lambda step: drawn(heard, parameters, task.seed, step), parameters,
        seed=task.seed, checkpoint=checkpoint,
        report=lambda at: announce(f"{task.world}, walk {task.seed}", at.step / task.steps),
    )  # fmt: skip
    checkpoint.unlink()
    return found.encoder


def _spot_echoes(walk: Mapped) -> SpotEchoes:
    return SpotEchoes(walk.echoes.samples, walk.poses[:, :2], walk.poses[:, 2])


def _asked(task: Ways) -> tuple[F64, F32]:
    """Where (n, 2) the third person was, who walks back too, and six echoes (6 n, 2352) each."""
    world, kind = load_world(task.world), kind_named(task.kind)
    recording, truth = simulate(
        world, task.seed + ASKER, rounds=1, reverse=True, walker=kind.walker,
        circumstances=kind.asking(world.room),
    )  # fmt: skip
    echoes = extract_echoes(recording, walkers(task.seed, kind)[CALIBRATED])
    moving = walking(truth, echoes.t_s)
    count = len(moving) // TOGETHER
    rows = moving[: count * TOGETHER]
    middle_s = echoes.t_s[rows].reshape(count, TOGETHER).mean(axis=1)
    poses = interpolate_poses(truth.t_s, truth.world_from_body, middle_s)
    return poses[:, :2], echoes.samples[rows]


def walking(truth: Truth, t_s: F64) -> I64:
    """Echoes between the first and the last movement."""
    from_start_m = np.linalg.norm(np.diff(truth.world_from_body[:, :2], axis=0), axis=1)
    moving_s = truth.t_s[1:][from_start_m > 0.25 * from_start_m.max()]
    return np.flatnonzero((t_s >= moving_s[0]) & (t_s <= moving_s[-1]))


Map = tuple[str, F64, F32, Encoder]


def _maps(both: Sequence[Mapped], shipped: Encoder, learnt: Encoder) -> Iterator[Map]:
    """Name, spots, their ELFs and encoder of each map."""
    from elfslam.learn.floor_level import floor_elfs

    there, back = both

    for name, walks, encoder in (
        (SAME_WAY, [back], shipped),
        (OPPOSITE_WAY, [there], shipped),
        ("both directions, not learnt", both, shipped),
        (SUPERIMPOSED, both, learnt),
        ("superimposed, map of one direction", [there], learnt),
    ):
        poses = np.vstack([walk.poses for walk in walks])
        spots_m = floor_spots(poses[:, :2], SPACING_M)
        yield name, spots_m, floor_elfs(encoder, spots_m, map(_spot_echoes, walks)), encoder
    vectors = np.vstack([walk_vectors(walk.echoes.samples, shipped) for walk in both])
    yield "all echoes kept apart", np.vstack([walk.poses[:, :2] for walk in both]), vectors, shipped
