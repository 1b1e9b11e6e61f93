"""What changes between mapping and locating, and how much it costs (the paper's section 6.6).

The map is made in the scenario of mapping; the query walk then comes with less sound, among people,
weeks later, in noise, between moved furniture, with a softer or another phone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.enums import Mode
from elfslam.base.values import Fixes, Trajectory
from elfslam.stages.locate import locate_one_shot
from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import PEOPLE, QUIET, Kind, kind_named
from elfslam.world.simulate import World, load_world
from studies.cached import record_of
from studies.located import (
    MAPPING_ROUNDS,
    MEDIAN_M,
    OVER_1_M,
    Mapped,
    Stranger,
    fix_numbers,
    located,
    mapped_walk,
    stranger,
)
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import ELF, FeatureMap, feature_maps
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

PLACES: Mapping[str, str] = {"living_room": "all", "office": "volume", "mall": "volume"}
"""Which changes are measured where; the volume in all three, as in the paper."""
SEEDS = tuple(range(10))
ROUNDS = 2
LENGTHS_S = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.6)
OTHERS_ABOUT = (0, 2, 4, 6, 8)
DAYS = (0, 20, 30)
SOUNDS = ("none", "speech", "music", "clicks")
VOLUMES = (1.0, 0.8, 0.6, 0.4, 0.2)
PHONES = ("simulated phone", "flat", "cheap", "tablet", "bottom-fired", "rippled")
MOVED = "moved"
MEAN_M, ANSWERED = "mean error (m)", "answered"
METRICS = (MEDIAN_M, MEAN_M, ANSWERED, OVER_1_M)
METHODS = {mode: f"{ELF}, {mode.value}" for mode in Mode}
PAPER_M: Mapping[tuple[str, str, str, str], float] = {
    (world, METHODS[mode], metric, condition): error_m
    for world, mode, metric, condition, error_m in (
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "0 days", 0.10),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "20 days", 0.11),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "30 days", 0.12),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "6 people", 0.57),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "8 people", 0.6),
        ("living_room", Mode.ONE_SHOT, MEAN_M, "5 moved", 1.3),
        ("living_room", Mode.TRAJECTORY, MEAN_M, "5 moved", 0.3),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "100 % volume", 0.10),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "20 % volume", 0.18),
        ("office", Mode.ONE_SHOT, MEDIAN_M, "100 % volume", 0.54),
        ("office", Mode.ONE_SHOT, MEDIAN_M, "20 % volume", 0.68),
        ("mall", Mode.ONE_SHOT, MEDIAN_M, "100 % volume", 0.42),
        ("mall", Mode.ONE_SHOT, MEDIAN_M, "20 % volume", 0.56),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "0.6 s", 0.10),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "phone: rippled", 0.5),
        ("living_room", Mode.TRAJECTORY, MEDIAN_M, "phone: rippled", 0.2),
        ("living_room", Mode.ONE_SHOT, MEDIAN_M, "phone: cheap", 2.54),
        ("living_room", Mode.TRAJECTORY, MEDIAN_M, "phone: cheap", 0.5),
    )
}
"""By world, method, metric and condition what the paper has in its three real places."""


@dataclass(frozen=True)
class Place:
    """A world and a seed, and which changes are measured there."""

    world: str
    seed: int
    changes: str = "all"
    mapping_rounds: int = MAPPING_ROUNDS
    rounds: int = ROUNDS
    kind: str = QUIET.name


def measure_sensitivity(
    context: StudyContext,
    *,
    places: Mapping[str, str] = PLACES,
    seeds: Sequence[int] = SEEDS,
    mapping_rounds: int = MAPPING_ROUNDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Errors and answered shares for every amount of every change (the condition)."""
    tasks = [
        Place(world, seed, changes, mapping_rounds, rounds, kind.name)
        for world, changes in places.items()
        for seed in seeds
    ]
    walks = averaged(finished(_measured, tasks, context), seeds)
    return [replace(each, paper=paper_m(each)) for each in walks]


def paper_m(record: Record) -> float | None:
    """What the paper has for a record."""
    of = record.world, record.method, record.metric, record.condition
    return PAPER_M.get(of)


def _measured(place: Place) -> list[Record]:
    world, kind = with_some_moved(load_world(place.world)), kind_named(place.kind)
    mapped = mapped_walk(world, place.seed, place.mapping_rounds, kind=kind)
    settings = walkers(place.seed, kind)[CALIBRATED]
    own = feature_maps(mapped.recording, mapped.run, settings)
    usual = kind.asking(world.room)
    records: list[Record] = []
    for condition, today in circumstances(world, place.changes, usual):
        query = _query(world, place, today)
        for method, fixes, trajectory in _fixes(mapped, query, own):
            records += _records(place, method, condition, fixes, query, trajectory, mapped)
    if place.changes == "all":
        query = _query(world, place, usual)
        for condition, fixes in _lengths(mapped, query):
            trajectory, method = mapped.run.trajectory, METHODS[Mode.ONE_SHOT]
            records += _records(place, method, condition, fixes, query, trajectory, mapped)
    return records


def circumstances(
    world: World, changes: str, usual: Circumstances
) -> Iterator[tuple[str, Circumstances]]:
    """Each change of the usual circumstances and how much of it, as a condition."""
    for volume in VOLUMES:
        yield f"{100 * volume:g} % volume", replace(usual, volume=volume)
    if changes != "all":
        return
    for people in OTHERS_ABOUT:
        yield f"{people} people", replace(usual, people=people)
    for day in DAYS:
        yield f"{day} days", replace(usual, day=day)
    for sound in SOUNDS:
        yield f"noise: {sound}", replace(usual, sounds=() if sound == "none" else (sound,))
    for state in ["", *(name for name in world.states if name.startswith(f"{MOVED} "))]:
        count = state.removeprefix(f"{MOVED} ") or "0"
        yield f"{count} {MOVED}", replace(usual, state=state)
    for phone in dict.fromkeys((usual.device, *PHONES)):
        yield f"phone: {phone}", replace(usual, device=phone)


def with_some_moved(world: World) -> World:
    """The world with a state "moved K" for each number of pieces of furniture, in their order."""
    if MOVED not in world.states:
        return world
    usual, moved = world.room.blocks, world.states[MOVED].blocks
    changed = [k for k, block in enumerate(usual) if _differs(block, moved[k])]
    states = dict(world.states)
    for count in range(1, len(changed) + 1):
        blocks = tuple(moved[k] if k in changed[:count] else block for k, block in enumerate(usual))
        states[f"{MOVED} {count}"] = replace(world.room, blocks=blocks)
    return replace(world, states=states)


def _differs(block: object, other: object) -> bool:
    places = [(item.centre_m, item.turn_rad) for item in (block, other)]  # type: ignore[attr-defined]
    return not np.allclose(np.append(*places[0]), np.append(*places[1]))


def _query(world: World, place: Place, today: Circumstances) -> Stranger:
    kind = kind_named(place.kind)
    return stranger(world, place.seed, place.rounds, circumstances=today, kind=kind)


def _fixes(
    mapped: Mapped, query: Stranger, own: Mapping[str, FeatureMap]
) -> Iterator[tuple[str, Fixes, Trajectory]]:
    """By every mode; then one-shot by each feature in a map of its own making, always answered."""
    for mode in Mode:
        yield METHODS[mode], located(mapped, query, mode, Settings()), mapped.run.trajectory
    for feature, by_it in own.items():
        yield f"{feature}, always answered", by_it.asked(query.echoes), by_it.run.trajectory


def _lengths(mapped: Mapped, query: Stranger) -> Iterator[tuple[str, Fixes]]:
    """One-shot fixes from more or less sound."""
    known = Settings().locate
    assert mapped.run.floor_map is not None
    for length_s in LENGTHS_S:
        longer = replace(known, window_s=length_s, fewest_echoes=2 if length_s < 0.5 else 3)
        yield f"{length_s:g} s", locate_one_shot(query.features, mapped.run.floor_map, longer)


def _records(
    place: Place, method: str, condition: str, fixes: Fixes, query: Stranger,
    trajectory: Trajectory, mapped: Mapped,
) -> list[Record]:  # fmt: skip
    numbers = fix_numbers(fixes, query.truth, trajectory, mapped.truth)
    return record_of(place, method, condition).each({name: numbers[name] for name in METRICS})


STUDY = Study(
    "What does it cost when people, days, noise, furniture, volume or the phone change?",
    measure_sensitivity, minutes=25, scenarios=("people",), long=True,
    fast={"places": {"studio": "volume"}, "seeds": (100,), "mapping_rounds": 2, "rounds": 1},
)  # fmt: skip
