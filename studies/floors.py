"""Simulated buildings: floors by barometer and by sound, maps floor by floor, ways between them.

Walks are mapped and located as `elfslam map` and `elfslam locate` do by default. Beside the ELF
stands the plain spectrogram: it tells floors and places of the map that was made by ELFs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64, I64
from elfslam.base.building import FloorsVisited
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import FloorMap, Levels, Recording, Run, Truth
from elfslam.data.tiles import stretches_of, tiles_of
from elfslam.scoring.errors import ScoreRow, alignment_of, fix_errors
from elfslam.scoring.levels import (
    fix_level_scores,
    floor_scores,
    level_shift,
    on_right_floor,
    score_levels,
)
from elfslam.slam.floor_location import locate_in_building
from elfslam.slam.floors import floor_runs, gathered_passages, passages_walked
from elfslam.slam.front_end import dead_reckoning_nodes
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.levels import find_levels, passages_of
from elfslam.stages.ways import LevelPosition, WayGraph, way, way_graph
from elfslam.world.building import MultiFloorWorld, load_place
from elfslam.world.kinds import PEOPLE, SURVEYOR, Kind, kind_named
from elfslam.world.room import standing_room
from elfslam.world.sensors import Sensor
from elfslam.world.simulate_building import simulate_place, usual_day
from elfslam.world.world_file import World, walked_room
from studies.cached import extract_features, record_of, simulate_building
from studies.located import MEDIAN_M, STRANGER
from studies.plain_features import ALWAYS, CLOSURE_THRESHOLDS, ELF, PLAIN, compared_encoders
from studies.results import Record, averaged
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, finished

BUILDINGS = ("mall_floors", "tower")
ROUNDS = {"mall": 2, "office": 6}
"""Of walks on one floor."""
SEEDS, HEARD_SEEDS = (320, 321, 322, 323, 324, 325), (320, 321)
BAROMETER, BY_SOUND = "barometer", "no barometer"
DEAD_RECKONING = "dead reckoning"
WALKED, WALKABLE = "along the walked lines", "shortest walkable"
WAYS, SHORTEST_M, GRID_M = 40, 10.0, 0.25
"""Between so many pairs of random footsteps; shorter ways are left out."""


@dataclass(frozen=True)
class FloorWalk:
    """A walk of a kind in a building, or on one floor: with sound, or by its motion alone."""

    world: str
    seed: int
    kind: str
    heard: bool = False
    one_floor: bool = False


def measure_floors(
    context: StudyContext,
    *,
    buildings: Sequence[str] = BUILDINGS,
    one_floor: Sequence[str] = tuple(ROUNDS),
    seeds: Sequence[int] = SEEDS,
    heard_seeds: Sequence[int] = HEARD_SEEDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Floors, changes, map errors, fixes and ways; what needs no sound on more walks."""
    silent = [FloorWalk(each, seed, kind.name, one_floor=True)
              for each in one_floor for seed in seeds]  # fmt: skip
    silent += [FloorWalk(each, seed, kind.name) for each in buildings for seed in seeds]
    heard = [FloorWalk(each, seed, kind.name, heard=True)
             for each in buildings for seed in heard_seeds]  # fmt: skip
    found = finished(_measured, [*silent, *heard], context)
    count = len(silent)
    of_heard = averaged(found[count:], heard_seeds)
    if len(heard_seeds) == 1:  # a single walk has no interval
        of_heard = [replace(each, low=None, high=None) for each in of_heard]
    return [*averaged(found[:count], seeds), *of_heard]


def _measured(walk: FloorWalk) -> list[Record]:
    if walk.heard:
        return list(_heard(walk))
    return _false_changes(walk) if walk.one_floor else _changes(walk)


def _in_silence(walk: FloorWalk) -> tuple[Levels, F64, Truth]:
    """Floors by the barometer, and when footsteps were taken."""
    kind, settings = kind_named(walk.kind), Settings()
    recording, truth = simulate_place(
        load_place(walk.world), walk.seed, rounds=ROUNDS[walk.world] if walk.one_floor else 1,
        sound=False, sensors=(Sensor.BAROMETER,), walker=kind.walker,
    )  # fmt: skip
    assert recording.barometer is not None
    footsteps_t_s = dead_reckoning_nodes(recording, settings).t_s
    found = find_levels(recording.barometer, footsteps_t_s, settings.levels)
    return found.levels, footsteps_t_s, truth


def _false_changes(walk: FloorWalk) -> list[Record]:
    found, _, truth = _in_silence(walk)
    hours = float(truth.t_s[-1] - truth.t_s[0]) / 3600
    numbers = {
        "false level changes an hour": len(list(passages_of(found))) / hours,
        "time walked (min)": 60 * hours,
    }
    return record_of(walk, BAROMETER, "one floor").each(numbers)


def _changes(walk: FloorWalk) -> list[Record]:
    found, footsteps_t_s, truth = _in_silence(walk)
    assert truth.levels is not None
    row = cast(Mapping[str, float], score_levels(found, truth.levels, footsteps_t_s))
    numbers = {
        **_shares(row),
        "level changes": row["changes"],
        "level changes found": row["found"],
        "false level changes": row["false"],
        "kind of passage right": row["kind_right"],
    }
    return record_of(walk, BAROMETER, "mapped walk").each(numbers)


def _shares(row: ScoreRow | Mapping[str, float]) -> dict[str, float]:
    shares = cast(Mapping[str, float], row)
    return {
        f"floor {each} (%)": 100 * shares[f"floor_{each}"] for each in ("right", "wrong", "unknown")
    }


def _heard(walk: FloorWalk) -> list[Record]:
    """A map of a walk, ways through it, and where another walk is in it, by each feature."""
    recording, truth = _walked(walk, asking=False)
    run = map_by_echoes(recording, compared_encoders()[ELF], Settings())
    if run.visited is None:
        return []
    maps = _maps(run, Settings())
    places = {level: each.xy_m for level, each in maps.items()}
    return [
        *_map_errors(walk, run, truth),
        *_way_lengths(walk, run, truth, places),
        replace(
            record_of(walk, ELF, "package of all floors, without encoder"),
            metric="size (kB)",
            value=sum(map(_package_bytes, maps.values())) / 1000,
        ),
        *_fixes(walk, run, truth),
    ]


def _package_bytes(floor_map: FloorMap) -> int:
    """What a phone fetches of a map, without encoder and manifest."""
    numbers = sum(len(tile.content) for tile in tiles_of(floor_map))
    return numbers + sum(len(stretch.content) for stretch in stretches_of(floor_map))


def _maps(run: Run, settings: Settings) -> dict[int, FloorMap]:
    found = {level: part.floor_map for level, part in floor_runs(run, settings).items()}
    return {level: each for level, each in found.items() if each is not None}


def _fixes(walk: FloorWalk, run: Run, truth: Truth) -> Iterator[Record]:
    """Floors and errors of a stranger's fixes by each feature of the same mapped walk."""
    assert run.echoes is not None
    query, true = _walked(walk, asking=True)
    shift, lies = level_shift(run, truth), alignment_of(run.trajectory, truth)
    for feature in (ELF, PLAIN):
        settings, encoder = _settings_for(feature), compared_encoders()[feature]
        maps = _maps(replace(run, features=extract_features(run.echoes, encoder)), settings)
        for told, asked in ((BAROMETER, query), (BY_SOUND, replace(query, barometer=None))):
            fixes = locate_in_building(asked, maps, encoder, settings)
            (row,) = fix_level_scores(fixes, true, shift)
            errors = fix_errors(on_right_floor(fixes, true, shift), true, lies)
            numbers = {**_shares(row), MEDIAN_M: errors.ok.median_m}
            yield from record_of(walk, feature, f"fixes, {told}").each(numbers)


def _walked(walk: FloorWalk, *, asking: bool) -> tuple[Recording, Truth]:
    """The walk that is mapped; or a stranger's on another day, on the two highest floors."""
    building, kind = load_place(walk.world), kind_named(walk.kind)
    assert isinstance(building, MultiFloorWorld)
    seed = walk.seed + STRANGER * asking
    plan = tuple(each.level for each in building.storeys[:-3:-1]) if asking else building.plan
    day, place = usual_day(building, kind, seed, asking=asking)
    assert isinstance(place, MultiFloorWorld)
    return simulate_building(
        place, seed, plan=plan, rounds=1, walker=kind.walker, circumstances=day
    )


def _settings_for(feature: str) -> Settings:
    """Floors lead by as much less as the feature's closure threshold is lower; all is answered."""
    usual = Settings()
    share = CLOSURE_THRESHOLDS[feature] / CLOSURE_THRESHOLDS[ELF]
    levels = replace(usual.levels, least_lead=share * usual.levels.least_lead)
    return replace(usual, levels=levels, locate=usual.locate if feature == ELF else ALWAYS)


def _map_errors(walk: FloorWalk, run: Run, truth: Truth) -> Iterator[Record]:
    """By floor, after the whole was aligned; dead reckoning beside the map."""
    shift = level_shift(run, truth)
    for method, poses in {
        DEAD_RECKONING: run.odometry.world_from_body,
        ELF: run.trajectory.world_from_body,
    }.items():
        laid = replace(run, trajectory=replace(run.trajectory, world_from_body=poses))
        for each in floor_scores(laid, truth):
            row = cast(Mapping[str, float], each)
            of = record_of(walk, method, f"map, floor {row['level'] + shift:.0f}")
            yield replace(of, metric=MEDIAN_ALIGNED, value=row["median_m"])


# --- ways ---


def _way_lengths(
    walk: FloorWalk, run: Run, truth: Truth, places: Mapping[int, F64]
) -> Iterator[Record]:
    """Ways in a map over those by the true passages, between random footsteps on known floors."""
    assert run.visited is not None
    assert truth.levels is not None
    t_s, poses = run.trajectory.t_s, run.trajectory.world_from_body
    true = interpolate_poses(truth.t_s, truth.world_from_body, t_s)
    level, true_level = run.visited.levels.at(t_s), truth.levels.at(t_s)
    rows = np.flatnonzero(np.isin(level, list(places)) & np.isfinite(true_level))
    pairs = np.random.default_rng([walk.seed, 52]).choice(rows, (WAYS, 2))
    graph = _graph(places, run, poses, run.visited)
    found_m = _lengths_m(graph, level, poses, pairs)
    for condition, ground in {
        WALKED: _walked_lines(truth),
        WALKABLE: _walkable(walk.world),
    }.items():
        known = _graph(ground, run, true, FloorsVisited(truth.levels, ()))
        true_m = _lengths_m(known, true_level, true, pairs)
        far = true_m >= SHORTEST_M
        share = found_m[far & np.isfinite(found_m)] / true_m[far & np.isfinite(found_m)]
        numbers = {"way found (%)": 100 * float(np.isfinite(found_m[far]).mean())}
        for name, quantile in {"median": 0.5, "5 %": 0.05, "95 %": 0.95}.items():
            has = np.quantile(share, quantile) if len(share) else np.nan
            numbers[f"way over truth, {name}"] = float(has)
        yield from record_of(walk, ELF, f"ways, {condition}").each(numbers)


def _walked_lines(truth: Truth) -> dict[int, F64]:
    """Where the walk truly went on each floor (n, 2)."""
    assert truth.levels is not None
    level = truth.levels.at(truth.t_s)
    floors = np.unique(level[np.isfinite(level)])
    return {int(each): truth.world_from_body[level == each, :2] for each in floors}


def _graph(ground: Mapping[int, F64], run: Run, poses: F64, visited: FloorsVisited) -> WayGraph:
    """Ways over ground (n, 2) by level, and the passages where the walk was by these poses."""
    there = replace(run.trajectory, world_from_body=poses)
    return way_graph(ground, gathered_passages(passages_walked(there, visited)))


def _lengths_m(graph: WayGraph, level: F64, poses: F64, pairs: I64) -> F64:
    """How long the ways between rows of poses are; NaN where none leads, or no map of a floor."""

    def length_m(*ends: int) -> float:
        spots = [LevelPosition(int(level[row]), (float(poses[row, 0]), float(poses[row, 1])))
                 for row in ends]  # fmt: skip
        try:
            route = way(graph, *spots)
        except InputError:
            return np.nan
        return np.nan if route is None else route.length_m

    return np.array([length_m(*pair) for pair in pairs.tolist()])


def _walkable(building: str) -> dict[int, F64]:
    """Where people can stand on each floor: points (n, 2) of a grid."""
    place = load_place(building)
    assert isinstance(place, MultiFloorWorld)
    return {each.level: _standing(each.world) for each in place.storeys}


def _standing(world: World) -> F64:
    room = walked_room(world)
    low_m, high_m = room.outline_m.min(axis=0), room.outline_m.max(axis=0)
    axes = (np.arange(a + GRID_M / 2, b, GRID_M) for a, b in zip(low_m, high_m, strict=True))
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return np.asarray(grid[standing_room(room, grid)])


STUDY = Study(
    "Is the floor right, are maps and ways through buildings?", measure_floors, minutes=10,
    scenarios=(PEOPLE.name, SURVEYOR.name), long=True,
    fast={"buildings": ("tower",), "one_floor": ("office",), "seeds": (100,),
          "heard_seeds": (100,)},
)  # fmt: skip
