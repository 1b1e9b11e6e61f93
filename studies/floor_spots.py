"""Thousands of spots heard in four directions: what superimposition is worth there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.progress import Announce
from elfslam.data.folders import replaced_file
from elfslam.line.feature import Encoder, OnnxEncoder, load_encoder
from elfslam.line.superimposition import SpotEchoes
from elfslam.world.phone import Poses, phone_axes
from elfslam.world.world_file import load_world
from studies.repeats import Numbers
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
"""A fix is the mean of the spots this near the best, weighted by how alike they sound."""
SPACING_M = 0.1
SPOT_A = 0.5
"""Which of the spots is drawn, as a share of all."""
SETS = ("new traces", "off the grid", "in between")
SHARES = np.linspace(0.02, 0.98, 49)


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


def measure_floor(task: Spots, folder: Path, announce: Announce) -> Numbers:
    """Errors (m) of every map, its quantiles, and what spot A sounds like before and after.

    What is learnt is kept in `folder` as it goes.
    """
    floor, shipped = floor_of(task), load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    learnt = _learnt(task, floor, shipped, folder, announce)
    queries = dict(_queries(task, floor))
    announce("maps", None)
    numbers: Numbers = {"echoes": float(task.echoes)}
    before, after = (_directions(task, floor, encoder) for encoder in (shipped, learnt))
    for name, xy_m, vectors, encoder, asked in _maps(floor, before, after, shipped, learnt):
        for kind in asked:
            places_m, samples = queries[kind]
            for together in (1, TOGETHER):
                found = fixes_m(encoder.embed(samples), together, vectors, xy_m)
                numbers |= errors(f"{name}|{kind}|{together}", found, places_m)
    numbers |= _likeness("before", before) | _likeness("after", after)
    if task.supervised_traces:
        numbers |= _supervised(task, floor, queries, announce)
    return numbers


def fixes_m(vectors: F32, together: int, spots: F32, spots_m: F64) -> F64:
    """Where (n, 2) the first `together` of every six echoes (6 n, d) were heard, by map."""
    asked = vectors.reshape(-1, TOGETHER, vectors.shape[1])[:, :together].mean(axis=1)
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

    file = folder / f"{task.world}-{task.spots}-{task.traces}-{task.seed}.onnx"
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
        "same direction": (on, np.zeros(task.queries)),
        "different direction": (on, other),
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
    yield "one direction", xy_m, one, shipped, ("same direction", "different direction")
    yield "all directions kept apart", every, before.reshape(len(every), -1), shipped, SETS
    yield "mean of all directions", xy_m, before.mean(axis=1), shipped, SETS
    yield "superimposed", xy_m, after.mean(axis=1), learnt, SETS


def _supervised(
    task: Spots, floor: Floor, queries: dict[str, tuple[F64, F32]], announce: Announce
) -> Numbers:
    """Errors of the classifier of spots, from as many traces as the task gives it."""
    from studies.fingerprint import FingerprintParameters, named_spots, train_on_batches

    steps = task.spots * len(DIRECTIONS_RAD) * task.supervised_traces // SUPERVISED_BATCH

    def batches() -> Iterator[tuple[F32, I64]]:
        for step in range(steps):
            generator = np.random.default_rng([task.seed, 4, step])
            spot, heading_rad = _drawn(floor, SUPERVISED_BATCH, generator)
            yield heard(floor, floor.spots_m[spot], heading_rad, generator), spot

    network = train_on_batches(
        batches(), len(floor.spots_m), steps, FingerprintParameters(threads=1), seed=task.seed,
        report=lambda share: announce("supervised", share),
    )  # fmt: skip
    numbers: Numbers = {"supervised echoes": float(steps * SUPERVISED_BATCH)}
    for kind in SETS:
        places_m, samples = queries[kind]
        first = samples[::TOGETHER]
        for together, part in ((1, first), (TOGETHER, samples)):
            named = named_spots(network, part, together=together)
            numbers |= errors(f"supervised|{kind}|{together}", floor.spots_m[named], places_m)
    return numbers


def errors(name: str, found_m: F64, truth_m: F64) -> Numbers:
    """Mean, median, Q3, share beyond 1 m, and the quantiles at SHARES."""
    error_m = np.linalg.norm(found_m - truth_m, axis=1)
    quantiles = np.quantile(error_m, SHARES)
    found: dict[str, float] = {
        "mean": float(error_m.mean()),
        "median": float(np.median(error_m)),
        "Q3": float(np.quantile(error_m, 0.75)),
        "over 1 m": float((error_m > 1.0).mean()),
    }
    found |= {f"q{k}": float(value) for k, value in enumerate(quantiles)}
    return {f"{name}|{measure}": value for measure, value in found.items()}


def _likeness(when: str, directions: F32) -> Numbers:
    """Mean cosine between directions, of spot A and of all, and spot A's ELFs."""
    unit = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    pairs = np.einsum("ska,sla->skl", unit, unit)[:, ~np.eye(4, dtype=bool)].mean(axis=1)
    spot = int(SPOT_A * len(directions))
    drawn = {f"A|{when}|{k}|{i}": float(v) for (k, i), v in np.ndenumerate(unit[spot])}
    return {
        f"likeness|{when}|A": float(pairs[spot]),
        f"likeness|{when}|all": float(pairs.mean()),
        **drawn,
    }
