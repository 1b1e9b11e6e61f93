"""What a fix costs: time per fix and memory of the map, by the number of its spots."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, FloorMap, Odometry, Payload
from elfslam.stages.locate import fixes_of, spot_similarity
from elfslam.stages.segments import locate_by_segments
from elfslam.stages.track import Tracker
from studies.cached import shipped
from studies.localization import ONE_SHOT, TRACK, TRAJECTORY
from studies.results import Record
from studies.study import Study, StudyContext

SPOTS = (4_000, 100_000)
ECHOES = 6
"""Of a sequence of 0.6 s."""
SPACING_M, STEP_M = 0.1, 0.7
REPEATS = 15
TIME, MEMORY = "processor time of a fix (ms)", "map in memory (MB)"


def measure_localization_cost(
    context: StudyContext, *, spots: Sequence[int] = SPOTS, repeats: int = REPEATS
) -> list[Record]:
    """Medians over repeats of the processor time of one fix, encoder included."""
    records: list[Record] = []
    for number, count in enumerate(spots):
        context.announce(f"{count} spots", number / len(spots))
        floor_map, of = grid_map(count, np.random.default_rng(0)), f"{count} spots"
        records += [
            Record(way, TIME, _median_ms(once, repeats), condition=of)
            for way, once in _ways(floor_map)
        ]
        records.append(Record("map", MEMORY, map_bytes(floor_map) / 1e6, condition=of))
    return records


def grid_map(count: int, generator: np.random.Generator) -> FloorMap:
    """A map of `count` spots, a walk up and down a square, that sounds like nothing."""
    side = int(np.ceil(np.sqrt(count)))
    row, column = np.divmod(np.arange(count), side)
    column = np.where(row % 2 == 0, column, side - 1 - column)
    vectors = generator.normal(size=(count, ELF_SIZE))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return FloorMap(
        SPACING_M * np.column_stack([column, row]).astype(float),
        np.where(row % 2 == 0, 0.0, np.pi),
        np.zeros(count, dtype=np.int64),
        np.arange(count),
        np.tile(0.01 * np.eye(2), (count, 1, 1)),
        (Payload("elf", shipped().identity, vectors.astype(np.float32)),),
        "",
        (),
    )


def map_bytes(floor_map: FloorMap) -> int:
    """Size of all arrays of a map."""
    own = (getattr(floor_map, item.name) for item in fields(floor_map))
    arrays = [item for item in own if isinstance(item, np.ndarray)]
    return sum(item.nbytes for item in [*arrays, *(load.vectors for load in floor_map.payloads)])


def _ways(floor_map: FloorMap) -> Iterator[tuple[str, Callable[[], object]]]:
    """What is done for one fix, from aligned echoes on."""
    generator, known, payload = np.random.default_rng(1), Settings(), floor_map.payloads[0]
    sound = generator.normal(size=(ECHOES, ECHO_SAMPLES)).astype(np.float32)
    nodes = _straight(known.segments.footsteps)
    same = np.tile(payload.vectors[len(payload.vectors) // 2], (len(nodes.t_s) - 1, 1))
    scores = spot_similarity(same, payload)
    live = Tracker(floor_map, known.track, generator)
    move, sigma = np.array([STEP_M, 0.0, 0.0]), np.array([0.2, 0.15, 0.01])
    live.step(move, sigma, scores[0])

    def heard() -> object:
        return spot_similarity(shipped().embed(sound).mean(axis=0, keepdims=True), payload)

    def one_shot() -> object:
        heard()
        return fixes_of(nodes.t_s[:1], scores[:1], floor_map, known.locate)

    def tracked() -> object:
        heard()
        return live.step(move, sigma, scores[0])

    def by_trajectory() -> object:
        heard()
        return locate_by_segments(nodes, scores, floor_map, known.segments)

    yield ONE_SHOT, one_shot
    yield TRACK, tracked
    yield TRAJECTORY, by_trajectory


def _straight(footsteps: int) -> Odometry:
    along: F64 = STEP_M * np.arange(footsteps + 1.0)
    poses = np.column_stack([along, np.zeros((footsteps + 1, 2))])
    return Odometry(0.5 * np.arange(footsteps + 1.0), poses, np.full((footsteps, 3), 0.1))


def _median_ms(once: Callable[[], object], repeats: int) -> float:
    once()
    taken = []
    for _ in range(repeats):
        start_s = time.process_time()
        once()
        taken.append(time.process_time() - start_s)
    return 1e3 * float(np.median(taken))


STUDY = Study(
    "What does a fix cost, by the number of spots of the map?",
    measure_localization_cost, minutes=1, fast={"spots": (400, 900), "repeats": 2},
)  # fmt: skip
