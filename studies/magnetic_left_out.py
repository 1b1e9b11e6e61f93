"""Magnetic closures chosen without the walk they are judged on: each set left out once.

Thresholds and sigmas are chosen on the other sets, with drifts of their own, and judged on the
drifts of the set that was left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.data.magnetic import read_magnetic
from studies.magnetic_walks import (
    CLOSURES,
    PAPER_RMSE_M,
    PAPERS_DRIFT,
    RECKONED,
    RMSE,
    SEEDS,
    AlignmentParameters,
    Seen,
    mapped,
    median_of,
    rmse_m,
    see,
)
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext, finished

Choice = tuple[float, float, float]
SETS = tuple(PAPER_RMSE_M)
CHOICE_SEEDS = (101, 102, 103, 104, 105)
"""Drifts that parameters are chosen on."""
THRESHOLDS, SIGMAS_M, WORST = (0.45, 0.55, 0.65, 0.75), (0.5, 0.7, 1.0, 1.5, 3.0), (0.25, 0.35, 0.5)
CHOSEN = ("threshold", "sigma (m)", "worst difference")
CHOICES = tuple(product(THRESHOLDS, SIGMAS_M, WORST))
"""Least score of a closure, its sigma (m), and the difference of fields that drops it."""
LEFT_OUT, BEST = "magnetic, chosen on the others", "magnetic, best choice in hindsight"
Errors = Mapping[str, float]
"""RMSE (m) of one walk, drifted and by choice."""


@dataclass(frozen=True)
class DriftedWalk:
    """A walk and the drift that its odometry is given."""

    name: str
    seed: int


def measure_magnetic_left_out(
    context: StudyContext, *, sets: Sequence[str] = SETS, choices: Sequence[Choice] = CHOICES
) -> list[Record]:
    """Errors of each set by the parameters that the others chose, and which these are.

    The others choose on drifts of their own, by the least mean logarithm of error over drift.
    """
    assert context.data is not None
    tasks = [DriftedWalk(name, seed) for name in sets for seed in (*CHOICE_SEEDS, *SEEDS)]
    measure = partial(measure_walk, data=context.data, choices=choices)
    walks = finished(measure, tasks, context)
    errors = {
        task: {each.method: each.value for each in walk}
        for task, walk in zip(tasks, walks, strict=True)
    }
    return [record for name in sets for record in _records(name, sets, choices, errors)]


def measure_walk(task: DriftedWalk, data: Path, choices: Sequence[Choice]) -> list[Record]:
    """Errors of a walk: drifted, and mapped with each of the choices (the method)."""
    generator = np.random.default_rng(task.seed)
    recording, truth = read_magnetic(
        data / "magnetic" / f"{task.name}.mat", generator, PAPERS_DRIFT
    )
    seen = see(recording, truth, recording.orientation)
    drifted_m = rmse_m(seen.odometry.t_s, seen.odometry.world_from_body, seen.truth)
    return [Record(RECKONED, RMSE, drifted_m)] + [
        Record(str(choice), RMSE, rmse_m(seen.nodes.t_s, _mapped(seen, choice), seen.truth))
        for choice in choices
    ]


def _mapped(seen: Seen, choice: Choice) -> F64:
    """The walk (n, 3) corrected by the closures of one choice."""
    threshold, sigma_m, worst = choice
    closing = replace(CLOSURES, threshold=threshold, along_sigma_m=sigma_m, across_sigma_m=sigma_m)
    return mapped(seen, closing, replace(AlignmentParameters(), worst=worst))


def _records(
    name: str, sets: Sequence[str], choices: Sequence[Choice], errors: Mapping[DriftedWalk, Errors]
) -> list[Record]:
    chosen = best_choice([other for other in sets if other != name], choices, errors)
    walks = [errors[DriftedWalk(name, seed)] for seed in SEEDS]
    of = Record("", RMSE, 0.0, paper=PAPER_RMSE_M.get(name), world=name, seeds=seeds_text(SEEDS))
    best = min(float(np.median([walk[str(choice)] for walk in walks])) for choice in choices)
    return [
        median_of(replace(of, method=RECKONED, paper=None), [walk[RECKONED] for walk in walks]),
        median_of(replace(of, method=LEFT_OUT), [walk[str(chosen)] for walk in walks]),
        replace(of, method=BEST, value=best, paper=None),
        *(replace(of, method=LEFT_OUT, metric=metric, value=value, paper=None)
          for metric, value in zip(CHOSEN, chosen, strict=True)),
    ]  # fmt: skip


def best_choice(
    others: Sequence[str], choices: Sequence[Choice], errors: Mapping[DriftedWalk, Errors]
) -> Choice:
    """The choice with the least mean logarithm of error over drifted error on these sets."""

    def cost(choice: Choice) -> float:
        walks = [errors[DriftedWalk(name, seed)] for name in others for seed in CHOICE_SEEDS]
        return float(np.mean([np.log(walk[str(choice)] / walk[RECKONED]) for walk in walks]))

    return min(choices, key=cost)


STUDY = Study(
    "How well does the field close loops by parameters that were chosen on other walks?",
    measure_magnetic_left_out, minutes=20, long=True, data=("magnetic",),
    fast={"sets": ("square", "eight"), "choices": ((0.45, 0.5, 0.35), (1.0, 1.0, 0.25))},
)  # fmt: skip
