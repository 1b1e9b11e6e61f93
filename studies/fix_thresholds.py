"""How alike a place must be to be told: fixes of strangers in development worlds by threshold.

A threshold too high leaves most queries unanswered on another phone's day; one too low answers
where nobody has mapped. Both are counted for people, surveyors and a quiet day, for one shot, eight
footsteps and the tracker, which have thresholds of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.choices import Mode
from elfslam.base.values import FixStatus
from elfslam.world.kinds import KINDS, kind_named
from elfslam.world.simulate import load_world
from studies.finding import Finding, Given, Row
from studies.localization import ELSEWHERE, shipped
from studies.located import MAPPING_ROUNDS, fix_numbers, located, mapped_walk, stranger
from studies.repeats import Numbers, finished
from studies.simulated_walk import SimulatedWalk
from studies.thresholds import SEEDS, WORLDS

ROUNDS = 2
UNKNOWN_BELOW = (0.3, 0.35, 0.4, 0.43, 0.45, 0.47, 0.5, 0.55, 0.6, 0.65, 0.7)


def measure_fix_thresholds(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = MAPPING_ROUNDS,
) -> Finding:
    """A row per kind and threshold: what is answered, rightly and elsewhere."""
    tasks = [
        SimulatedWalk(world, seed, rounds, kind)
        for kind in KINDS
        for world in worlds
        for seed in seeds
    ]
    numbers = finished(_measured, tasks, given)
    return Finding(_rows(tasks, numbers))


def _measured(walk: SimulatedWalk) -> Numbers:
    world, kind = load_world(walk.world), kind_named(walk.kind)
    mapped = mapped_walk(world, walk.seed, walk.rounds, shipped(), kind=kind)
    other = stranger(world, walk.seed, ROUNDS, shipped(), kind=kind)
    strange = load_world(ELSEWHERE.get(walk.world, "studio"))
    lost = stranger(strange, walk.seed, 1, shipped(), kind=kind)
    numbers: Numbers = {}
    for mode in Mode:
        for least in UNKNOWN_BELOW:
            settings = known_above(least)
            fixes = located(mapped, other, mode, settings)
            found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
            wrongly = located(mapped, lost, mode, settings).status == FixStatus.OK
            key = f"{mode.value}|{least:g}"
            numbers[f"{key}|answered"] = found["answered"]
            numbers[f"{key}|median (m)"] = found["median"]
            numbers[f"{key}|over 1 m off"] = found["gross"]
            numbers[f"{key}|elsewhere"] = float(np.mean(wrongly))
    return numbers


def known_above(least: float) -> Settings:
    """The settings with one least likeness for all three ways of locating."""
    usual = Settings()
    return replace(
        usual,
        locate=replace(usual.locate, unknown_below=least),
        segments=replace(usual.segments, unknown_below=least),
        track=replace(usual.track, unknown_below=least),
    )


def _rows(tasks: Sequence[SimulatedWalk], numbers: Sequence[Numbers]) -> list[Row]:
    rows: list[Row] = []
    for kind in dict.fromkeys(task.kind for task in tasks):
        some = [n for task, n in zip(tasks, numbers, strict=True) if task.kind == kind]
        for key in dict.fromkeys(name.rsplit("|", 1)[0] for name in some[0]):
            mode, least = key.split("|")
            rows.append(
                {
                    "kind": kind,
                    "mode": mode,
                    "unknown below": float(least),
                    **{what: _mean(some, f"{key}|{what}") for what in WHAT},
                }
            )
    return rows


WHAT = ("answered", "median (m)", "over 1 m off", "elsewhere")


def _mean(numbers: Sequence[Numbers], key: str) -> float | None:
    """Over the walks in which there was an answer."""
    known = [each[key] for each in numbers if np.isfinite(each[key])]
    return round(float(np.mean(known)), 3) if known else None
