"""What changes between mapping and locating, and how much it costs: a curve for each change.

The map is made on an ordinary day; the stranger then comes with less sound, among people, weeks
later, in noise, between moved furniture, with a softer or another phone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.choices import Mode
from elfslam.line.locate import locate_one_shot
from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import PEOPLE, QUIET, Kind, kind_named
from elfslam.world.simulate import World, load_world
from studies.finding import Finding, Given
from studies.localization import shipped
from studies.located import (
    MAPPING_ROUNDS,
    Mapped,
    Stranger,
    fix_numbers,
    located,
    mapped_walk,
    stranger,
)
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import FeatureMap, feature_maps
from studies.repeats import Numbers, by_world, finished
from studies.sensitivity_table import sensitivity_page, sensitivity_rows

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
    given: Given,
    *,
    places: Mapping[str, str] = PLACES,
    seeds: Sequence[int] = SEEDS,
    mapping_rounds: int = MAPPING_ROUNDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> Finding:
    """Errors and answered shares for every amount of every change."""
    tasks = [
        Place(world, seed, changes, mapping_rounds, rounds, kind.name)
        for world, changes in places.items()
        for seed in seeds
    ]
    numbers = finished(_measured, tasks, given)
    rows = sensitivity_rows(by_world(tasks, numbers))
    return Finding(rows, sensitivity_page(rows))


def _measured(place: Place) -> Numbers:
    world, kind = with_some_moved(load_world(place.world)), kind_named(place.kind)
    mapped = mapped_walk(world, place.seed, place.mapping_rounds, shipped(), kind=kind)
    settings = walkers(place.seed, kind)[CALIBRATED]
    own = feature_maps(mapped.recording, mapped.run, settings)
    usual, numbers = kind.asking(world.room), Numbers()
    for change, amount, today in _circumstances(world, place.changes, usual):
        other = _stranger(world, place, today)
        numbers |= _numbers(change, amount, mapped, other)
        numbers |= _always(change, amount, mapped, other, own)
    if place.changes == "all":
        numbers |= _lengths(mapped, _stranger(world, place, usual))
    return numbers


def _circumstances(
    world: World, changes: str, usual: Circumstances
) -> Iterator[tuple[str, str, Circumstances]]:
    """Each change of the usual circumstances, and how much of it."""
    for volume in VOLUMES:
        yield "volume", f"{volume:g}", replace(usual, volume=volume)
    if changes != "all":
        return
    for people in OTHERS_ABOUT:
        yield "people", str(people), replace(usual, people=people)
    for day in DAYS:
        yield "day", str(day), replace(usual, day=day)
    for sound in SOUNDS:
        yield "sound", sound, replace(usual, sounds=() if sound == "none" else (sound,))
    for state in ["", *(name for name in world.states if name.startswith(f"{MOVED} "))]:
        yield "moved", state.removeprefix(f"{MOVED} ") or "0", replace(usual, state=state)
    for phone in dict.fromkeys((usual.device, *PHONES)):
        yield "phone", phone, replace(usual, device=phone)


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


def _stranger(world: World, place: Place, today: Circumstances) -> Stranger:
    kind = kind_named(place.kind)
    return stranger(
        world, place.seed, place.rounds, shipped(), circumstances=today, kind=kind
    )  # fmt: skip


def _numbers(change: str, amount: str, mapped: Mapped, other: Stranger) -> Numbers:
    numbers: Numbers = {}
    for mode in Mode:
        fixes = located(mapped, other, mode, Settings())
        found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
        numbers |= {f"{change}|{amount}|{mode.value}|{key}": value for key, value in found.items()}
    return numbers


def _always(
    change: str, amount: str, mapped: Mapped, other: Stranger, own: Mapping[str, FeatureMap]
) -> Numbers:
    """One shot by each feature in a map of its own making, however little alike."""
    numbers: Numbers = {}
    for feature, by_it in own.items():
        fixes = by_it.asked(other.echoes)
        found = fix_numbers(fixes, other.truth, by_it.run.trajectory, mapped.truth)
        numbers |= {f"{change}|{amount}|{feature}|{key}": value for key, value in found.items()}
    return numbers


def _lengths(mapped: Mapped, other: Stranger) -> Numbers:
    """One-shot fixes from more or less sound."""
    known, numbers = Settings().locate, Numbers()
    assert mapped.run.floor_map is not None
    for length_s in LENGTHS_S:
        longer = replace(known, window_s=length_s, fewest_echoes=2 if length_s < 0.5 else 3)
        fixes = locate_one_shot(other.features, mapped.run.floor_map, longer)
        found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
        key = f"seconds|{length_s:g}|{Mode.ONE_SHOT.value}"
        numbers |= {f"{key}|{name}": value for name, value in found.items()}
    return numbers
