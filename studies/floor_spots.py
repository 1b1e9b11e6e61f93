"""Thousands of spots in four directions: what superimposition is worth there (section 6.7)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import Announce
from elfslam.data.atomic_files import replaced_file
from elfslam.stages.feature import Encoder, OnnxEncoder, load_encoder
from elfslam.stages.floormap import SpotEchoes
from elfslam.world.phone import Poses, phone_axes
from elfslam.world.world_file import load_world
from studies.results import Record
from studies.still_phone import BODY_M, HAND_M, HEIGHT_M, PITCH_RAD, Listener, hear_at, listener_in

DIRECTIONS_RAD = np.arange(4) * np.pi / 2
TURN_RAD = np.deg2rad(5.0)
TILT_RAD = np.deg2rad(2.0)
"""How far off its direction a phone is held, from trace to trace, one standard deviation."""
BATCH = 256
SUPERVISED_BATCH = 64
TOGETHER = 6
"""Echoes of a fix of 0.6 s; fixes from one echo are measured beside."""
MAP_TRACES = 5
"""Of each spot and direction, for the map."""
TEMPERATURE, NEAR_M = 0.05, 0.3
"""A fix is the mean of the spots this near the best, weighted by their similarity."""
SPACING_M = 0.1
SPOT_A = 0.5
"""Which of the spots is drawn, as a share of all."""
SETS = ("new traces", "off the grid", "in between")
SAME, DIFFERENT = "same direction", "different direction"
ONE, ALL_APART, MEAN_OF_ALL = "one direction", "all directions kept apart", "mean of all directions"
SUPERIMPOSED, SUPERVISED = "superimposed", "supervised"
MEAN_M, MEDIAN_M = "mean error (m)", "median error (m)"
SIMILARITY = "similarity of four directions"
PAPER_M = {ONE: (DIFFERENT, 3.2), SUPERIMPOSED: (SETS[0], 0.24), SUPERVISED: (SETS[0], 0.56)}
"""What the paper's maps were asked, and their mean errors."""
PAPER_SIMILARITY = {"before": 0.34, "after": 0.76}


@dataclass(frozen=True)
class Spots:
    """A floor of `spots` of the world's marked ones, and so many traces in each direction."""

    world: str = "hall"
    spots: int = 4000
    traces: int = 100
    supervised_traces: int = 100
    queries: int = 2000
    seed: int = 0

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.world}-{self.spots}-{self.traces}-{self.seed}"

    @property
    def echoes(self) -> int:
        """How many are learnt from."""
        return self.spots * len(DIRECTIONS_RAD) * self.traces


@dataclass(frozen=True, eq=False)
class Floor:
    """Spots (m, 2), and who hears the chirp there."""

    spots_m: F64
    listener: Listener


def floor_of(task: Spots) -> Floor:
    """The spots of a task: the marked ones nearest to the middle one, where not all."""
    world = load_world(task.world)
    marked = world.spots_m
    off_m = np.linalg.norm(marked - marked[len(marked) // 2], axis=1)
    chosen = np.sort(np.argsort(off_m, kind="stable")[: task.spots])
    return Floor(marked[chosen], listener_in(world.room))


def heard(floor: Floor, xy_m: F64, heading_rad: F64, generator: np.random.Generator) -> F32:
    """A trace (n, 2352) at each place and heading of a phone that a hand holds still."""
    count = len(xy_m)
    position = np.column_stack([xy_m, np.full(count, HEIGHT_M)])
    tilt = generator.normal(0, TILT_RAD, (2, count))
    poses = Poses(
        position + generator.normal(0, HAND_M, (count, 3)),
        phone_axes(
            heading_rad + generator.normal(0, TURN_RAD, count), PITCH_RAD + tilt[0], tilt[1]
        ),
        np.zeros((count, 3)), np.full(count, BODY_M), np.zeros((count, 0, 2)),
    )  # fmt: skip
    return hear_at(floor.listener, poses, generator)


def measure_floor(task: Spots, folder: Path, announce: Announce) -> list[Record]:
    """Errors (m) of every map, and how similar the directions of spots are before and after.

    What is learnt is kept in `folder` as it goes.
    """
    floor, shipped = floor_of(task), load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    learnt = _learnt(task, floor, shipped, folder, announce)
    queries = dict(_queries(task, floor))
    announce("maps", None)
    records: list[Record] = []
    before, after = (_directions(task, floor, encoder) for encoder in (shipped, learnt))
    for name, xy_m, vectors, encoder, asked in _maps(floor, before, after, shipped, learnt):
        for kind in asked:
            places_m, samples = queries[kind]
            found = fixes_m(encoder.embed(samples), vectors, xy_m)
            records.append(_error(name, kind, found, places_m))
    records += [*_similarities("before", before), *_similarities("after", after)]
    if task.supervised_traces:
        records += _supervised(task, floor, queries, folder, announce)
    seed = str(task.seed)
    return [replace(each, world=task.world, seeds=seed) for each in records]


def fixes_m(vectors: F32, spots: F32, spots_m: F64) -> F64:
    """Where (n, 2) every six echoes (6 n, d) were heard, by map."""
    asked = vectors.reshape(-1, TOGETHER, vectors.shape[1]).mean(axis=1)
    scores = asked @ spots.T
    best = spots_m[scores.argmax(axis=1)]
    near = np.linalg.norm(spots_m[None] - best[:, None], axis=2) <= NEAR_M
    belief = np.exp((scores - scores.max(axis=1, keepdims=True)) / TEMPERATURE) * near
    return np.asarray(belief @ spots_m / belief.sum(axis=1, keepdims=True))


def _learnt(
    task: Spots, floor: Floor, shipped: OnnxEncoder, folder: Path, announce: Announce
) -> OnnxEncoder:
    """The encoder of the floor, learnt once and kept."""
    from elfslam.learn.floor_level import learn_floor
    from elfslam.learn.parameters import FloorLevelParameters

    file = folder / f"{task.name}.onnx"
    if file.exists():
        return OnnxEncoder(file.read_bytes(), file.name)

    def batch(step: int) -> SpotEchoes:
        generator = np.random.default_rng([task.seed, 1, step])
        spot, heading_rad = _drawn(floor, BATCH, generator)
        place_m = floor.spots_m[spot]
        return SpotEchoes(heard(floor, place_m, heading_rad, generator), place_m, heading_rad)

    parameters = FloorLevelParameters(steps=max(task.echoes // BATCH, 1))
    found = learn_floor(
        shipped, floor.spots_m, batch, parameters, seed=task.seed,
        checkpoint=file.with_suffix(".checkpoint"),
        report=lambda at: announce(
            f"floor level: step {at.step}, loss {at.loss:.2f}", at.step / parameters.steps
        ),
    )  # fmt: skip
    with replaced_file(file) as partial:
        partial.write_bytes(found.encoder.content)
    return found.encoder


def _drawn(floor: Floor, count: int, generator: np.random.Generator) -> tuple[I64, F64]:
    """Spots (count) and the directions in which a phone is held there."""
    spot = generator.integers(0, len(floor.spots_m), count)
    return spot, DIRECTIONS_RAD[generator.integers(0, len(DIRECTIONS_RAD), count)]


def _queries(task: Spots, floor: Floor) -> Iterator[tuple[str, tuple[F64, F32]]]:
    """Places (n, 2) and six traces (6 n, 2352) of each: by set, then one direction and others."""
    generator = np.random.default_rng([task.seed, 2])
    spot, heading_rad = _drawn(floor, task.queries, generator)
    on = floor.spots_m[spot]
    off = on + generator.uniform(-SPACING_M / 2, SPACING_M / 2, on.shape)
    other = DIRECTIONS_RAD[generator.integers(1, len(DIRECTIONS_RAD), task.queries)]
    asked = {
        SETS[0]: (on, heading_rad),
        SETS[1]: (off, heading_rad),
        SETS[2]: (off, heading_rad + np.pi / 4),
        SAME: (on, np.zeros(task.queries)),
        DIFFERENT: (on, other),
    }
    for name, (place_m, yaw_rad) in asked.items():
        every = np.repeat(place_m, TOGETHER, axis=0)
        yield name, (place_m, heard(floor, every, np.repeat(yaw_rad, TOGETHER), generator))


def _directions(task: Spots, floor: Floor, encoder: Encoder) -> F32:
    """Mean ELFs (m, 4, d) of every spot in each direction."""
    total = np.zeros(())
    for trace in range(MAP_TRACES):
        generator = np.random.default_rng([task.seed, 3, trace])
        rows = [
            encoder.embed(heard(floor, part, np.tile(DIRECTIONS_RAD, len(part) // 4), generator))
            for part in np.split(
                np.repeat(floor.spots_m, 4, axis=0), range(4096, 4 * len(floor.spots_m), 4096)
            )
        ]
        total = total + np.concatenate(rows)
    return np.asarray(total / MAP_TRACES, np.float32).reshape(len(floor.spots_m), 4, -1)


Map = tuple[str, F64, F32, Encoder, tuple[str, ...]]


def _maps(
    floor: Floor, before: F32, after: F32, shipped: Encoder, learnt: Encoder
) -> Iterator[Map]:
    """Name, spots, their ELFs, encoder and what is asked, of each map."""
    xy_m, every = floor.spots_m, np.repeat(floor.spots_m, 4, axis=0)
    one = before[:, 0]
    yield ONE, xy_m, one, shipped, (SAME, DIFFERENT)
    yield ALL_APART, every, before.reshape(len(every), -1), shipped, SETS
    yield MEAN_OF_ALL, xy_m, before.mean(axis=1), shipped, SETS
    yield SUPERIMPOSED, xy_m, after.mean(axis=1), learnt, SETS


def _supervised(
    task: Spots, floor: Floor, queries: dict[str, tuple[F64, F32]], folder: Path, announce: Announce
) -> Iterator[Record]:
    """Errors of the classifier of spots, from as many traces as the task gives it."""
    from studies.fingerprint import FingerprintParameters, named_spots, train_on_batches

    def batch_of(step: int) -> tuple[F32, I64]:
        generator = np.random.default_rng([task.seed, 4, step])
        spot, heading_rad = _drawn(floor, SUPERVISED_BATCH, generator)
        return heard(floor, floor.spots_m[spot], heading_rad, generator), spot

    network = train_on_batches(
        batch_of, len(floor.spots_m),
        task.spots * len(DIRECTIONS_RAD) * task.supervised_traces // SUPERVISED_BATCH,
        FingerprintParameters(threads=1), seed=task.seed,
        checkpoint=folder / f"{task.name}-supervised.checkpoint",
        report=lambda share: announce("supervised", share),
    )  # fmt: skip
    for kind in SETS:
        places_m, samples = queries[kind]
        named = named_spots(network, samples, together=TOGETHER)
        yield _error(SUPERVISED, kind, floor.spots_m[named], places_m)


def errors_m(found_m: F64, truth_m: F64) -> F64:
    """Distances (n) of fixes from where they were asked."""
    return np.asarray(np.linalg.norm(found_m - truth_m, axis=1))


def _error(name: str, kind: str, found_m: F64, truth_m: F64) -> Record:
    """Of a map, and what it was asked."""
    paper_kind, paper_m = PAPER_M.get(name, ("", None))
    return Record(
        name, MEAN_M, float(errors_m(found_m, truth_m).mean()),
        paper=paper_m if kind == paper_kind else None, condition=f"{kind}, from {TOGETHER}",
    )  # fmt: skip


def _similarities(when: str, directions: F32) -> Iterator[Record]:
    """Mean cosine between the directions of spot A."""
    unit = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    pairs = np.einsum("ska,sla->skl", unit, unit)[:, ~np.eye(4, dtype=bool)].mean(axis=1)
    spot, paper = int(SPOT_A * len(directions)), PAPER_SIMILARITY[when]
    yield Record(when, SIMILARITY, float(pairs[spot]), condition="spot A", paper=paper)
