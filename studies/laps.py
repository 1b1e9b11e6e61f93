"""How far off are places found when people leave the line, and how many laps make up for it?

Each lap of the map is another person's, every other one the opposite way round, and somebody else
asks from 0.6 s of sound for the most alike spot. Spots lie where they truly are, so that an error
is the feature's own. What another phone alone changes, and another day alone, is asked at ten laps.
A feature's threshold is the least likeness at which at most one kept answer in twenty is over a
metre off, at ten laps in the development worlds, which count alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from elfslam.app.workers import Here, Workers
from elfslam.base.progress import Announce
from elfslam.line.feature import Encoder
from elfslam.world.kinds import PEOPLE, QUIET, Kind
from studies.finding import Finding, Given
from studies.lap_answers import (
    TOGETHER_FALSE_POSITIVES,
    Answers,
    Beside,
    answers_by,
    beside,
    best_answers,
    least_likeness,
    numbers_of,
    recalls,
    walks_beside,
)
from studies.lap_echoes import (
    CHANGES,
    PHONE_AND_DAY,
    Crowd,
    footsteps_of,
    joined,
    mapped_lap,
    own_lane_m,
    spots_of,
    strange_laps,
    venue_of,
)
from studies.laps_table import laps_page, laps_rows
from studies.plain_features import ChanceEncoder, compared_encoders
from studies.repeats import Numbers, finished

WORLDS = ("living_room", "office", "mall")
MIRRORED = ("living_room",)
"""Heard by mirror images, too, off the line."""
DEVELOPMENT = ("studio", "lounge", "concourse")
"""Where thresholds are chosen, seeds from 100 on."""
LANES_M = (0.1, 0.2, 0.3, 0.5)
"""And the world's own."""
FEW = 4
"""Laps mapped where lanes are compared."""
ASKED_LAPS = 10
"""Laps mapped where phone and day change one by one."""
LAPS = (2, 5, 10, 20, 40)
LANE_SEEDS, LAP_SEEDS = tuple(range(5)), tuple(range(10))
FEWER: Mapping[str, int] = {"mall": 3}
"""Where a lap takes ten times as long, so many of the seeds by laps."""
THRESHOLD_LAPS = 10
THRESHOLD_SEEDS = (100, 101, 102)


@dataclass(frozen=True)
class Feature:
    """What spots are compared by; shown by name and by what must be equal to compare it."""

    name: str
    identity: str
    encoder: Encoder = field(repr=False)


class Found(NamedTuple):
    """What each mapped lap answers, and what the first few have beside the places asked for.

    `walks_beside` are of several footsteps together.
    """

    answers: list[Answers]
    beside: list[Beside]
    walks_beside: list[Beside]


Thresholds = Mapping[str, Mapping[str, float]]
"""By kind and name of the feature."""


def measure_laps(
    given: Given,
    *,
    encoders: Mapping[str, Encoder] | None = None,
    kind: Kind = PEOPLE,
    worlds: Sequence[str] = WORLDS,
    mirrored: Sequence[str] = MIRRORED,
    development: Sequence[str] = DEVELOPMENT,
    lanes_m: Sequence[float] = LANES_M,
    laps: Sequence[int] = LAPS,
    lane_seeds: Sequence[int] = LANE_SEEDS,
    lap_seeds: Sequence[int] = LAP_SEEDS,
    threshold_seeds: Sequence[int] = THRESHOLD_SEEDS,
    threshold_laps: int = THRESHOLD_LAPS,
    asked_laps: int = ASKED_LAPS,
) -> Finding:
    """A row per world, sound, lane, laps mapped and feature; curves of errors against both.

    `encoders` are measured by name beside the shipped one and the spectrograms. `mirrored` worlds
    are heard by mirror images, too.
    """
    tasks = crowds(worlds, kind.name, lanes_m, lane_seeds, laps, lap_seeds)
    tasks += one_change(worlds, kind.name, lap_seeds, asked_laps)
    tasks += crowds(mirrored, QUIET.name, lanes_m, lane_seeds, (), ()) if kind is not QUIET else []
    features = features_of(encoders or {})
    thresholds = _thresholds(
        [
            Crowd(world, each, own_lane_m(world), seed, (threshold_laps,))
            for each in dict.fromkeys(task.kind for task in tasks)
            for world in development
            for seed in threshold_seeds
        ],
        features,
        given.announce,
        given.workers or Here(),
    )
    measure = partial(measure_crowd, features=features, thresholds=thresholds)
    numbers = finished(measure, tasks, given)
    rows = laps_rows(tasks, numbers, thresholds)
    return Finding(rows, laps_page(rows))


def features_of(encoders: Mapping[str, Encoder]) -> tuple[Feature, ...]:
    """The shipped ELF, the spectrograms, chance, and the features that are given."""
    named = {**compared_encoders(), "chance": ChanceEncoder(), **encoders}.items()
    return tuple(Feature(name, encoder.identity, encoder) for name, encoder in named)


def crowds(
    worlds: Sequence[str],
    kind: str,
    lanes_m: Sequence[float],
    lane_seeds: Sequence[int],
    laps: Sequence[int],
    lap_seeds: Sequence[int],
) -> list[Crowd]:
    """Few laps in every lane, and all of `laps` in the world's own; each crowd walks once."""
    found: dict[tuple[str, float, int], set[int]] = {}
    for world in worlds:
        own_m = own_lane_m(world)
        for lane_m in sorted({*lanes_m, own_m}):
            for seed in lane_seeds:
                found.setdefault((world, lane_m, seed), set()).add(FEW)
        for seed in _seeds_in(world, lap_seeds):
            found.setdefault((world, own_m, seed), set()).update(laps)
    return [
        Crowd(world, kind, lane_m, seed, tuple(sorted(counts)))
        for (world, lane_m, seed), counts in found.items()
        if counts
    ]


def one_change(worlds: Sequence[str], kind: str, seeds: Sequence[int], laps: int) -> list[Crowd]:
    """The world's own lanes, asked by who changes only the phone, only the day, and neither."""
    return [
        Crowd(world, kind, own_lane_m(world), seed, (laps,), asked_by)
        for world in worlds
        for asked_by in CHANGES
        if asked_by != PHONE_AND_DAY
        for seed in _seeds_in(world, seeds)
    ]


def _seeds_in(world: str, seeds: Sequence[int]) -> Sequence[int]:
    return seeds[: FEWER.get(world, len(seeds))]


def measure_crowd(crowd: Crowd, *, features: Sequence[Feature], thresholds: Thresholds) -> Numbers:
    """Errors in the maps of the first so many laps, by feature, and recall beside a few of them."""
    numbers: Numbers = {}
    for name, found in hear_crowd(crowd, features=features).items():
        for count in crowd.laps:
            best = best_answers(found.answers[:count])
            made = numbers_of(best, thresholds[crowd.kind][name])
            made |= _recalls(found) if count == FEW else {}
            numbers |= {f"{count}|{name}|{key}": value for key, value in made.items()}
    return numbers


def _recalls(found: Found) -> Numbers:
    eight = recalls(found.walks_beside, TOGETHER_FALSE_POSITIVES)
    return recalls(found.beside) | {f"eight|{key}": value for key, value in eight.items()}


def hear_crowd(crowd: Crowd, *, features: Sequence[Feature]) -> dict[str, Found]:
    """What every feature answers by each lap of the map; a lap is heard once and let go."""
    venue = venue_of(crowd.world, crowd.kind, crowd.asked_by)
    strange = strange_laps(venue, crowd.lane_m, crowd.seed)
    walks = {each.name: [footsteps_of(lap, each.encoder) for lap in strange] for each in features}
    asked = {name: joined(each) for name, each in walks.items()}
    found = {each.name: Found([], [], []) for each in features}
    for number in range(max(crowd.laps)):
        lap = mapped_lap(venue, crowd.lane_m, crowd.seed, number)
        for each in features:
            spots = spots_of(lap, each.encoder)
            found[each.name].answers.append(answers_by(asked[each.name], spots))
            if number < FEW and FEW in crowd.laps:
                found[each.name].beside.append(beside(asked[each.name], spots))
                found[each.name].walks_beside.append(walks_beside(walks[each.name], spots))
    return found


def answered_by(crowd: Crowd, *, features: Sequence[Feature]) -> dict[str, Answers]:
    """What every feature answers in the map of all laps."""
    heard = hear_crowd(crowd, features=features)
    return {name: best_answers(found.answers) for name, found in heard.items()}


def _thresholds(
    tasks: Sequence[Crowd], features: Sequence[Feature], announce: Announce, workers: Workers
) -> Thresholds:
    """Each feature's threshold for each kind, by what the tasks answer at their most laps."""
    found: dict[int, dict[str, Answers]] = {}
    for index, each in workers.each(partial(answered_by, features=features), tasks):
        found[index] = each
        announce(f"{len(found)} of {len(tasks)} crowds for thresholds", None)
    answers: dict[str, dict[str, list[Answers]]] = {}
    for index, task in enumerate(tasks):
        for name, best in found[index].items():
            answers.setdefault(task.kind, {}).setdefault(name, []).append(best)
    return {
        kind: {name: least_likeness(each) for name, each in by_name.items()}
        for kind, by_name in answers.items()
    }
