"""How far off are fixes beside the mapped lane, and how many laps make up for it?

Each lap of the map is another person's, every other one the opposite way round; somebody else asks
from 0.6 s of sound for the most similar spot. Spots lie where they truly are, so that an error is
the feature's own. What another phone alone changes, and another day alone, is asked at ten laps.
A map of several laps is answered by the best of their answers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Payload
from elfslam.stages.feature import Encoder
from elfslam.stages.locate import spot_similarity
from elfslam.world.kinds import PEOPLE, QUIET, Kind
from studies.cached import record_of
from studies.elf import ELSEWHERE_M, SAME_RAD
from studies.lap_echoes import (
    CHANGES,
    PHONE_AND_DAY,
    Crowd,
    Places,
    footsteps_of,
    joined,
    mapped_lap,
    own_lane_m,
    spots_of,
    strange_laps,
    venue_of,
)
from studies.located import GROSS_M, MEDIAN_M, OVER_1_M
from studies.plain_features import ChanceEncoder, compared_encoders
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

WORLDS = ("living_room", "office", "mall")
MIRRORED = ("living_room",)
"""Simulated by mirror images, too, beside the mapped lane."""
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
OFFSETS_M = (0.0, 0.15, 0.4, 0.8)
FALSE_POSITIVES = 0.01
EVERY = 8
"""Of so many spots one is compared with places elsewhere: neighbours hold the same echoes."""
CELLS = np.round(np.linspace(-1.0, 1.0, 4001), 6)
"""Edges of the cells in which similarities are counted."""
NEAR, FOUND = "near", "found"
RECALL = "recall at 1 %"
Numbers = dict[str, float]


@dataclass(frozen=True)
class Feature:
    """What spots are compared by; shown by name and by what must be equal to compare it."""

    name: str
    identity: str
    encoder: Encoder = field(repr=False)


class Answers(NamedTuple):
    """Similarity of the most similar spot to each place asked for (n), and how far off it is."""

    likeness: F32
    error_m: F64


class Beside(NamedTuple):
    """The nearest spot of like heading to each place (n): how far, and how similar.

    `elsewhere` counts similarities of spots that are far from the place, in cells of 0.0005.
    """

    offset_m: F64
    likeness: F32
    elsewhere: F64


class Found(NamedTuple):
    """What each mapped lap answers, and what the first few have beside the places asked for."""

    answers: list[Answers]
    beside: list[Beside]


def measure_laps(
    context: StudyContext,
    *,
    encoders: Mapping[str, Encoder] | None = None,
    kind: Kind = PEOPLE,
    worlds: Sequence[str] = WORLDS,
    mirrored: Sequence[str] = MIRRORED,
    lanes_m: Sequence[float] = LANES_M,
    laps: Sequence[int] = LAPS,
    lane_seeds: Sequence[int] = LANE_SEEDS,
    lap_seeds: Sequence[int] = LAP_SEEDS,
    asked_laps: int = ASKED_LAPS,
) -> list[Record]:
    """Errors by feature; the condition is how many laps, how wide the lanes, or who asks.

    `encoders` are measured by name beside the shipped one and the spectrograms. `mirrored` worlds
    are simulated by mirror images, too.
    """
    tasks = crowds(worlds, kind.name, lanes_m, lane_seeds, laps, lap_seeds)
    tasks += one_change(worlds, kind.name, lap_seeds, asked_laps)
    tasks += crowds(mirrored, QUIET.name, lanes_m, lane_seeds, (), ()) if kind is not QUIET else []
    measure = partial(measure_crowd, features=features_of(encoders or {}))
    return _means(tasks, finished(measure, tasks, context))


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


def measure_crowd(crowd: Crowd, *, features: Sequence[Feature]) -> list[Record]:
    """Errors in the maps of the first so many laps, by feature, and recall beside a few of them."""
    records: list[Record] = []
    for name, found in hear_crowd(crowd, features=features).items():
        for count in crowd.laps:
            numbers = numbers_of(best_answers(found.answers[:count]))
            numbers |= recalls(found.beside) if count == FEW else {}
            records += record_of(crowd, name, condition_of(crowd, count)).each(numbers)
    return records


def condition_of(crowd: Crowd, laps: int) -> str:
    """What is varied: who asks, how wide the lanes are where few laps are mapped, or the laps."""
    if crowd.asked_by != PHONE_AND_DAY:
        return crowd.asked_by
    return f"{crowd.lane_m:g} m lanes" if laps == FEW else f"{laps} laps"


def _means(tasks: Sequence[Crowd], numbers: Sequence[Sequence[Record]]) -> list[Record]:
    """Means over the seeds of each condition, and the recall of all their places together."""
    seeds: dict[tuple[str, str, str], dict[int, list[Record]]] = {}
    for task, records in zip(tasks, numbers, strict=True):
        for each in records:
            group = (each.world, each.scenario, each.condition)
            seeds.setdefault(group, {}).setdefault(task.seed, []).append(each)
    found = [each for walks in seeds.values() for each in averaged(walks.values(), list(walks))]
    counts = {replace(each, value=0.0, low=None, high=None): each.value for each in found}
    recalled: list[Record] = []
    for low_m, high_m in pairwise(OFFSETS_M):
        for key, near in counts.items():
            if key.metric == f"{NEAR} {high_m:g}" and near:
                share = counts[replace(key, metric=f"{FOUND} {high_m:g}")] / near
                metric = f"{RECALL}, {low_m:g} to {high_m:g} m"
                recalled.append(replace(key, metric=metric, value=share))
    counted = (f"{NEAR} ", f"{FOUND} ")
    return [each for each in found if not each.metric.startswith(counted)] + recalled


def hear_crowd(crowd: Crowd, *, features: Sequence[Feature]) -> dict[str, Found]:
    """What every feature answers by each lap of the map; a lap is heard once and let go."""
    venue = venue_of(crowd.world, crowd.kind, crowd.asked_by)
    strange = strange_laps(venue, crowd.lane_m, crowd.seed)
    asked = {
        each.name: joined([footsteps_of(lap, each.encoder) for lap in strange]) for each in features
    }
    found = {each.name: Found([], []) for each in features}
    for number in range(max(crowd.laps)):
        lap = mapped_lap(venue, crowd.lane_m, crowd.seed, number)
        for each in features:
            spots = spots_of(lap, each.encoder)
            found[each.name].answers.append(answers_by(asked[each.name], spots))
            if number < FEW and FEW in crowd.laps:
                found[each.name].beside.append(beside(asked[each.name], spots))
    return found


def answers_by(asked: Places, spots: Places) -> Answers:
    """The most similar spots; the first of equals."""
    scores = _alike(asked, spots)
    best = scores.argmax(axis=1)
    far_m = np.linalg.norm(asked.xy_m - spots.xy_m[best], axis=1)
    return Answers(np.take_along_axis(scores, best[:, None], axis=1)[:, 0], far_m)


def best_answers(laps: Sequence[Answers]) -> Answers:
    """What the map of all these laps answers; the first lap of equals."""
    likeness, error_m = (np.stack(column) for column in zip(*laps, strict=True))
    best = likeness.argmax(axis=0)[None]
    return Answers(*(np.take_along_axis(each, best, axis=0)[0] for each in (likeness, error_m)))


def numbers_of(answers: Answers) -> Numbers:
    """Median error and the share over a metre off."""
    error_m = answers.error_m
    return {MEDIAN_M: float(np.median(error_m)), OVER_1_M: float(np.mean(error_m > GROSS_M))}


def beside(asked: Places, spots: Places) -> Beside:
    """The nearest spots that were passed within 35 degrees of the same way, and those elsewhere.

    Infinitely far and not similar where there is none.
    """
    scores = _alike(asked, spots)
    far_m = np.linalg.norm(asked.xy_m[:, None] - spots.xy_m[None], axis=2)
    turn_rad = np.abs(wrap_angle(asked.heading_rad[:, None] - spots.heading_rad[None]))
    same_way_m = np.where(turn_rad < SAME_RAD, far_m, np.inf)
    nearest = same_way_m.argmin(axis=1)[:, None]
    elsewhere = scores[:, ::EVERY][(far_m > ELSEWHERE_M)[:, ::EVERY]]
    return Beside(
        np.take_along_axis(same_way_m, nearest, axis=1)[:, 0],
        np.take_along_axis(scores, nearest, axis=1)[:, 0],
        _counts(elsewhere),
    )


def recalls(laps: Sequence[Beside]) -> Numbers:
    """How many places were near a spot of these laps, by offset, and how many were found there.

    Found is one that is more similar to that spot than all but so many of what is elsewhere.
    """
    offsets_m = np.stack([lap.offset_m for lap in laps])
    nearest, columns = offsets_m.argmin(axis=0), np.arange(offsets_m.shape[1])
    offset_m = offsets_m[nearest, columns]
    alike = np.stack([lap.likeness for lap in laps])[nearest, columns]
    least = _least_cell(np.sum([lap.elsewhere for lap in laps], axis=0))
    numbers: Numbers = {}
    for low_m, high_m in pairwise(OFFSETS_M):
        near = (offset_m >= low_m) & (offset_m < high_m)
        numbers[f"{NEAR} {high_m:g}"] = float(near.sum())
        numbers[f"{FOUND} {high_m:g}"] = float(_counts(alike[near])[least:].sum())
    return numbers


def _least_cell(elsewhere: F64) -> int:
    """The first cell of similarity at or above which one in a hundred of those elsewhere is."""
    from_cell = np.append(np.cumsum(elsewhere[::-1])[::-1], 0.0) / elsewhere.sum()
    return int(np.argmax(from_cell <= FALSE_POSITIVES))


def _counts(likeness: F32) -> F64:
    """How many similarities are in each cell of 0.0005."""
    return np.histogram(np.clip(likeness, -1.0, 1.0), CELLS)[0].astype(np.float64)


def _alike(asked: Places, spots: Places) -> F32:
    return spot_similarity(asked.vectors, Payload("elf", "", spots.vectors))


STUDY = Study(
    "How far off are fixes beside the mapped lane, by lanes, laps mapped and who asks?",
    measure_laps, minutes=30, long=True, encoders=True,
    fast={"worlds": ("lounge",), "mirrored": (), "lanes_m": (0.1,),
          "laps": (1, 2), "lane_seeds": (0,), "lap_seeds": (0,), "asked_laps": 2},
)  # fmt: skip
