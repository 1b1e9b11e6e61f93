"""How similar a place must be to be reported: fixes in development worlds by threshold.

A threshold too high leaves most queries of another phone on another day unanswered; one too low
answers where nobody has mapped. The three ways of locating have thresholds of their own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.enums import Mode
from elfslam.base.values import FixStatus
from elfslam.world.kinds import KINDS, kind_named
from elfslam.world.simulate import load_world
from studies.cached import SimulatedWalk, record_of
from studies.localization import ANSWERED_ELSEWHERE, ELSEWHERE, ROUNDS
from studies.located import (
    MAPPING_ROUNDS,
    MEDIAN_M,
    OVER_1_M,
    fix_numbers,
    located,
    mapped_walk,
    stranger,
)
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

WORLDS = ("studio", "lounge", "concourse")
SEEDS = (100, 101, 102)
UNKNOWN_BELOW = (0.3, 0.35, 0.4, 0.43, 0.45, 0.47, 0.5, 0.55, 0.6, 0.65, 0.7)
METRICS = ("answered", MEDIAN_M, OVER_1_M)


def measure_fix_thresholds(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = MAPPING_ROUNDS,
) -> list[Record]:
    """What is answered, how well, and how much elsewhere, by threshold (the condition)."""
    tasks = [
        SimulatedWalk(world, seed, rounds, kind)
        for kind in KINDS
        for world in worlds
        for seed in seeds
    ]
    return averaged(finished(_measured, tasks, context), seeds)


def _measured(walk: SimulatedWalk) -> list[Record]:
    world, kind = load_world(walk.world), kind_named(walk.kind)
    mapped = mapped_walk(world, walk.seed, walk.rounds, kind=kind)
    other = stranger(world, walk.seed, ROUNDS, kind=kind)
    strange = load_world(ELSEWHERE.get(walk.world, "studio"))
    lost = stranger(strange, walk.seed, 1, kind=kind)
    records: list[Record] = []
    for mode in Mode:
        for least in UNKNOWN_BELOW:
            settings = known_above(least)
            fixes = located(mapped, other, mode, settings)
            found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
            wrongly = located(mapped, lost, mode, settings).status == FixStatus.OK
            numbers = {metric: found[metric] for metric in METRICS}
            numbers[ANSWERED_ELSEWHERE] = float(np.mean(wrongly))
            records += record_of(walk, mode.value, f"{least:g}").each(numbers)
    return records


def known_above(least: float) -> Settings:
    """The settings with one least similarity for all three ways of locating."""
    usual = Settings()
    return replace(
        usual,
        locate=replace(usual.locate, unknown_below=least),
        segments=replace(usual.segments, unknown_below=least),
        track=replace(usual.track, unknown_below=least),
    )


STUDY = Study(
    "From what similarity on should a place be reported?",
    measure_fix_thresholds, minutes=4, long=True,
    fast={"worlds": ("studio",), "seeds": (100,), "rounds": 2},
)  # fmt: skip
