"""Query walks located in maps that many people's walks were merged into, by laps mapped."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.enums import Mode
from elfslam.base.values import Fixes, FixStatus, FloorMap, Trajectory, Truth
from elfslam.slam.merging import MappedWalk, MergeParameters, merge, walk_of
from elfslam.slam.merging.grow import map_of
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.locate import locate_one_shot
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from elfslam.world.simulate import load_world
from studies.cached import at_its_start, extract_features, record_of, shipped, simulated_in
from studies.localization import ALWAYS_ANSWERED, ANSWERED_ELSEWHERE, ELSEWHERE, ROUNDS, WORLDS
from studies.located import Stranger, fix_numbers, located_in, stranger
from studies.mapping import CALIBRATED, walkers
from studies.merging import MAP, WALKS, one_after_another
from studies.plain_features import ALWAYS, ELF, compared_encoders
from studies.results import Record, averaged
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, finished, median_aligned_m
from studies.taps import tapped

SEEDS = tuple(range(10))
"""Of those who map, and of the query walks."""
COUNTS = (1, 2, 5, 10)
"""Of those who map."""
TAPS = (0, 4)
"""Places that each of them taps on the plan; without any they declare their start."""
MAPPED_WAY = "on the mapped way"
"""Where query walks go, in lanes as those who map do."""
MODES = (Mode.TRACK, Mode.ONE_SHOT)
LAPS = 2
"""Of each who maps, every other one the opposite way round."""


@dataclass(frozen=True)
class Crowd:
    """People who map a world, so many places tapped by each on its plan, and who asks.

    Who taps nothing declares a start. Maps are of the first few of them, as `counts` has it.
    """

    world: str
    kind: str
    taps: int
    counts: tuple[int, ...]
    seeds: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Mapper:
    """A walk that was mapped by echoes, with the features of each encoder, and the truth."""

    by: Mapping[str, MappedWalk]
    truth: Truth


@dataclass(frozen=True, eq=False)
class Map:
    """The map of some walks, those of the walks by feature, and all walks as one with its truth."""

    floor_map: FloorMap
    by: Mapping[str, Sequence[FloorMap]]
    walked: Trajectory
    truth: Truth
    merged: int


def measure_many_mappers(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    counts: Sequence[int] = COUNTS,
    taps: Sequence[int] = TAPS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Errors of fixes and shares answered, by how many laps were mapped and what was tapped."""
    tasks = [
        Crowd(world, kind.name, tapped, tuple(counts), tuple(seeds))
        for world in worlds
        for tapped in taps
    ]
    return [each for found in finished(_measured, tasks, context) for each in found]


def _measured(crowd: Crowd) -> list[Record]:
    world, kind = load_world(crowd.world), kind_named(crowd.kind)
    elsewhere = load_world(ELSEWHERE.get(crowd.world, "studio"))
    walks = [_mapped(crowd, number) for number in range(max(crowd.counts))]
    maps = {count: _map(walks[:count]) for count in crowd.counts}
    records = [each for count, made in maps.items() for each in _map_records(crowd, count, made)]
    asked: list[list[Record]] = []
    for seed in crowd.seeds:
        lost = stranger(elsewhere, seed, 1, kind=kind)
        other = stranger(world, seed, ROUNDS, kind=kind, on_mapped_way=True)
        asked.append(
            [
                _record(crowd, f"{_condition(crowd, count)}, {MAPPED_WAY}", *found)
                for count, made in maps.items()
                for found in _asked(made, other, lost)
            ]
        )
    return records + averaged(asked, crowd.seeds)


def _map_records(crowd: Crowd, count: int, made: Map) -> Iterator[Record]:
    """The error of the map itself, and how many walks came into it."""
    condition = _condition(crowd, count)
    error_m = median_aligned_m(made.walked, made.truth)
    yield _record(crowd, condition, MAP, MEDIAN_ALIGNED, error_m)
    yield _record(crowd, condition, MAP, WALKS, float(made.merged))


def _record(crowd: Crowd, condition: str, method: str, metric: str, value: float) -> Record:
    return replace(record_of(crowd, method, condition), metric=metric, value=value)


def _condition(crowd: Crowd, count: int) -> str:
    known = f"{crowd.taps} taps" if crowd.taps else "declared starts"
    return f"{LAPS * count} laps, {known}"


def _asked(made: Map, other: Stranger, lost: Stranger) -> Iterator[tuple[str, str, float]]:
    """Method, metric and value of a query walk, and what is answered where nobody mapped."""
    for method, fixes in _fixes(made, other):
        found = fix_numbers(fixes, other.truth, made.walked, made.truth)
        yield from ((method, metric, value) for metric, value in found.items())
    for mode in MODES:
        status = located_in(made.floor_map, lost, mode, Settings()).status
        yield _method(mode), ANSWERED_ELSEWHERE, float(np.mean(status == FixStatus.OK))


def _method(mode: Mode) -> str:
    return f"{ELF}, {mode.value}"


def _mapped(crowd: Crowd, number: int) -> Mapper:
    """What one of those who map brings home."""
    world, kind, seed = load_world(crowd.world), kind_named(crowd.kind), crowd.seeds[number]
    recording, truth = simulated_in(world, seed, LAPS, kind, reverse=number % 2 == 1)
    if crowd.taps:
        recording = replace(recording, checkpoints=tapped(truth, crowd.taps, seed))
    else:
        recording = at_its_start(recording, truth)
    run = map_by_echoes(recording, shipped(), walkers(seed, kind)[CALIBRATED])
    assert run.echoes is not None
    walk = replace(walk_of(run), name=f"walk {seed}")
    by = {
        feature: replace(walk, features=extract_features(run.echoes, encoder))
        for feature, encoder in compared_encoders().items()
    }
    return Mapper(by, truth)


def _map(walks: Sequence[Mapper]) -> Map:
    """The walks as one map, by echoes as the pipeline has it, and by each feature walk by walk."""
    trajectories, floor_map = _merged([walk.by[ELF] for walk in walks])
    inside = [walk for walk in walks if walk.by[ELF].name in trajectories]
    walked, truth = one_after_another(
        [trajectories[walk.by[ELF].name] for walk in inside], [walk.truth for walk in inside]
    )
    single = {
        feature: [
            map_of(walk.by[feature], trajectories[walk.by[ELF].name], MergeParameters())
            for walk in inside
        ]
        for feature in compared_encoders()
    }
    return Map(floor_map, single, walked, truth, len(inside))


def _merged(walks: Sequence[MappedWalk]) -> tuple[dict[str, Trajectory], FloorMap]:
    """The walks in one frame by name, and their map."""
    known = MergeParameters()
    if len(walks) == 1:
        return {walks[0].name: walks[0].trajectory}, map_of(walks[0], walks[0].trajectory, known)
    made = merge(walks, known, known_starts=True).maps[0]
    return dict(zip(made.names, made.trajectories, strict=True)), made.floor_map


def _fixes(made: Map, other: Stranger) -> Iterator[tuple[str, Fixes]]:
    """By the pipeline in each mode; then by each feature, where the most similar spot is."""
    for mode in MODES:
        yield _method(mode), located_in(made.floor_map, other, mode, Settings())
    for feature, encoder in compared_encoders().items():
        features = extract_features(other.echoes, encoder)
        each = [locate_one_shot(features, single, ALWAYS) for single in made.by[feature]]
        yield ALWAYS_ANSWERED.format(feature), _most_similar(each)


def _most_similar(fixes: Sequence[Fixes]) -> Fixes:
    """Of fixes in several maps at the same times the one of the highest score, time by time."""
    best = np.nan_to_num(np.array([each.score for each in fixes]), nan=-np.inf).argmax(axis=0)
    rows = np.arange(len(best))
    columns = ("status", "xy_m", "heading_rad", "covariance_m2", "score")
    chosen = {
        name: np.array([getattr(each, name) for each in fixes])[best, rows] for name in columns
    }
    return replace(fixes[0], **chosen)


STUDY = Study(
    "How far off are fixes in a map of many people's walks, by laps mapped and places tapped?",
    measure_many_mappers, minutes=60, long=True,
    fast={"worlds": ("studio",), "seeds": (100, 101), "counts": (1, 2), "taps": (4,)},
)  # fmt: skip
