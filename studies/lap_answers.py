"""Places asked for in a map of many laps: the most alike spot, how far off it is, and when to ask.

Laps are answered one by one, and a map of several of them by the best of their answers: maps of
more laps are had from those of fewer.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Payload
from elfslam.line.locate import likeness
from studies.elf import ELSEWHERE_M, SAME_RAD
from studies.figures.separation import histograms, shares_above
from studies.lap_echoes import Places
from studies.located import GROSS_M
from studies.repeats import Numbers

MOST_WRONG = 0.05
LIKENESSES = np.round(np.arange(-1.0, 1.0015, 0.001), 3)
"""Thresholds that are tried; at the last one nothing is answered."""
OFFSETS_M = (0.0, 0.15, 0.4, 0.8)
FALSE_POSITIVES = 0.01
TOGETHER = 8
EVENLY_M = 0.1
TOGETHER_FALSE_POSITIVES = 0.001
"""Eight footsteps one after the other, as closures compare them, are wrong more seldom than one."""
EVERY = 8
"""Of so many spots one is compared with places elsewhere: neighbours hold the same echoes."""


class Answers(NamedTuple):
    """How alike the most alike spot is to each place that is asked for (n), and how far off it."""

    likeness: F32
    error_m: F64


class Beside(NamedTuple):
    """The nearest spot of like heading to each place (n): how far, and how alike.

    `elsewhere` counts likenesses of spots that are far from the place, in cells of 0.0005.
    """

    offset_m: F64
    likeness: F32
    elsewhere: F64


def answers_by(asked: Places, spots: Places) -> Answers:
    """The most alike spots; the first of equals."""
    scores = _alike(asked, spots)
    best = scores.argmax(axis=1)
    far_m = np.linalg.norm(asked.xy_m - spots.xy_m[best], axis=1)
    return Answers(np.take_along_axis(scores, best[:, None], axis=1)[:, 0], far_m)


def best_answers(laps: Sequence[Answers]) -> Answers:
    """What the map of all these laps answers; the first lap of equals."""
    likeness, error_m = (np.stack(column) for column in zip(*laps, strict=True))
    best = likeness.argmax(axis=0)[None]
    return Answers(*(np.take_along_axis(each, best, axis=0)[0] for each in (likeness, error_m)))


def least_likeness(worlds: Sequence[Answers]) -> float:
    """The least likeness at which at most one kept answer in twenty is more than a metre off.

    Worlds count alike, however many answers there are in each.
    """
    wrong, kept = np.zeros(len(LIKENESSES)), np.zeros(len(LIKENESSES))
    for answers in worlds:
        far = answers.error_m > GROSS_M
        kept += _share_from(answers.likeness, len(far))
        wrong += _share_from(answers.likeness[far], len(far))
    return float(LIKENESSES[np.argmax(wrong <= MOST_WRONG * kept)])


def _share_from(likeness: F32, of: int) -> F64:
    """How many of so many are at least as alike as each threshold."""
    below = np.searchsorted(np.sort(likeness.astype(np.float64)), LIKENESSES)
    return np.asarray((len(likeness) - below) / of)


def numbers_of(answers: Answers, threshold: float) -> Numbers:
    """Median error and the share over a metre off, of all answers and of those kept.

    NaN where none is kept.
    """
    kept = answers.likeness.astype(np.float64) >= threshold
    return {
        "answered": float(kept.mean()),
        **_errors("", answers.error_m),
        **_errors("answered|", answers.error_m[kept]),
    }


def _errors(name: str, error_m: F64) -> Numbers:
    if not len(error_m):
        return {f"{name}median": np.nan, f"{name}gross": np.nan}
    gross = float(np.mean(error_m > GROSS_M))
    return {f"{name}median": float(np.median(error_m)), f"{name}gross": gross}


def beside(asked: Places, spots: Places) -> Beside:
    """The nearest spots that were passed within 35 degrees of the same way, and those elsewhere.

    Infinitely far and not alike where there is none.
    """
    return _beside(asked, spots, _alike(asked, spots))


def walks_beside(walks: Sequence[Places], spots: Places) -> Beside:
    """The same of TOGETHER footsteps (n of all walks) and spots as far apart along their lap.

    They count as being where the middle one is.
    """
    found, even, middle = [], _evenly(spots), TOGETHER // 2
    for walk in walks:
        alike, ahead = _alike(walk, even), np.round(_along_m(walk) / EVENLY_M).astype(np.int64)
        begins = range(len(alike) - TOGETHER + 1)
        steps = [ahead[k : k + TOGETHER] - ahead[k] for k in begins]
        means = np.stack([_in_step(alike[k : k + TOGETHER], steps[k], middle) for k in begins])
        found.append(_beside(_cut(walk, middle, len(means)), even, means))
    offset_m, likeness, elsewhere = zip(*found, strict=True)
    return Beside(np.concatenate(offset_m), np.concatenate(likeness), np.sum(elsewhere, axis=0))


def _in_step(alike: F32, steps: I64, middle: int) -> F32:
    """The mean likeness (m) of footsteps, of which the middle one is at each spot.

    Minus infinity where they would begin before the lap or end after it.
    """
    means = np.full(alike.shape[1], -np.inf, dtype=np.float32)
    count = max(len(means) - int(steps[-1]), 0)
    parts = [row[step : step + count] for row, step in zip(alike, steps, strict=True)]
    means[steps[middle] : steps[middle] + count] = np.mean(parts, axis=0)
    return means


def _evenly(places: Places) -> Places:
    """The nearest of the places at each EVENLY_M of the way."""
    along_m = _along_m(places)
    at_m = np.arange(0.0, along_m[-1], EVENLY_M)
    nearest = np.round(np.interp(at_m, along_m, np.arange(len(along_m)))).astype(np.int64)
    return Places(places.vectors[nearest], places.xy_m[nearest], places.heading_rad[nearest])


def _along_m(places: Places) -> F64:
    steps_m = np.linalg.norm(np.diff(places.xy_m, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def _cut(places: Places, first: int, count: int) -> Places:
    some = slice(first, first + count)
    return Places(places.vectors[some], places.xy_m[some], places.heading_rad[some])


def _beside(asked: Places, spots: Places, scores: F32) -> Beside:
    far_m = np.linalg.norm(asked.xy_m[:, None] - spots.xy_m[None], axis=2)
    turn_rad = np.abs(wrap_angle(asked.heading_rad[:, None] - spots.heading_rad[None]))
    fits = np.isfinite(scores)
    same_way_m = np.where(fits & (turn_rad < SAME_RAD), far_m, np.inf)
    nearest = same_way_m.argmin(axis=1)[:, None]
    elsewhere = scores[:, ::EVERY][(fits & (far_m > ELSEWHERE_M))[:, ::EVERY]]
    return Beside(
        np.take_along_axis(same_way_m, nearest, axis=1)[:, 0],
        np.take_along_axis(scores, nearest, axis=1)[:, 0],
        _counts(elsewhere),
    )


def recalls(laps: Sequence[Beside], false_positives: float = FALSE_POSITIVES) -> Numbers:
    """How many places were near a spot of these laps, by offset, and how many were found there.

    Found is one that is more alike to that spot than all but so many of what is elsewhere.
    """
    offsets_m = np.stack([lap.offset_m for lap in laps])
    nearest, columns = offsets_m.argmin(axis=0), np.arange(offsets_m.shape[1])
    offset_m = offsets_m[nearest, columns]
    alike = np.stack([lap.likeness for lap in laps])[nearest, columns]
    least = _least_cell(np.sum([lap.elsewhere for lap in laps], axis=0), false_positives)
    numbers: Numbers = {}
    for low_m, high_m in pairwise(OFFSETS_M):
        near = (offset_m >= low_m) & (offset_m < high_m)
        numbers[f"near|{high_m:g}"] = float(near.sum())
        numbers[f"found|{high_m:g}"] = float(_counts(alike[near])[least:].sum())
    return numbers


def _least_cell(elsewhere: F64, false_positives: float) -> int:
    """The first cell of likeness at or above which at most so many of those elsewhere are."""
    false = shares_above(np.stack([elsewhere, elsewhere]))[1]
    return int(np.argmax(false <= false_positives))


def _counts(likeness: F32) -> F64:
    """How many likenesses are in each cell of 0.0005."""
    return np.asarray(histograms(likeness, np.zeros(0))[0])


def _alike(asked: Places, spots: Places) -> F32:
    return likeness(asked.vectors, Payload("elf", "", spots.vectors))
