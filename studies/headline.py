"""The README's figures in small, against limits: a map twice as bad turns it red.

    python -m studies.headline [--on N] [--strict]

Surveys of the first evaluation seeds in the three places, mapped, and people's in the living room,
where others are located on another day with another phone. Each figure is a mean over walks and
stands beside what these walks gave when the limit was set. Exit code 1 where one is above it.
Then the studies whose results are older than their code, red as well; with --strict they count.
"""

import argparse
import sys
from argparse import RawTextHelpFormatter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.app.console import print_rows, progress_bar
from elfslam.app.settings import Settings, sense_of
from elfslam.app.workers import open_workers
from elfslam.base.enums import Modality, Mode
from elfslam.slam.pipeline import map_by
from elfslam.world.kinds import PEOPLE, SURVEYOR, Kind, kind_named
from elfslam.world.simulate import load_world
from studies.catalogue import STUDIES, Choice, stale_studies
from studies.located import (
    MAPPING_ROUNDS,
    MEDIAN_M,
    Mapped,
    fix_numbers,
    located,
    mapped_walk,
    stranger,
)
from studies.mapping import CALIBRATED, trajectory_errors, walkers
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext, finished

SLACK = 1.5
"""A limit is the expected figure times this: a figure twice as bad is above it."""
STRANGER_ROUNDS = 2
MAPPED, RECKONED = "mapping by ELF", "dead reckoning"
OK, RED = "ok", "RED"


@dataclass(frozen=True)
class Task:
    """A walk to be mapped, and how somebody of the same kind is located in the map."""

    world: str
    seed: int
    kind: str = SURVEYOR.name
    rounds: int = MAPPING_ROUNDS
    modes: tuple[Mode, ...] = ()


@dataclass(frozen=True)
class Figure:
    """A median error in metres: what is expected on the walks measured here."""

    world: str
    kind: str
    name: str
    expected_m: float

    @property
    def limit_m(self) -> float:
        """More than this is red."""
        return round(SLACK * self.expected_m, 3)


TASKS = (
    *(Task("living_room", seed, modes=(Mode.ONE_SHOT, Mode.TRACK)) for seed in range(5)),
    *(Task("living_room", seed, PEOPLE.name, modes=(Mode.TRACK,)) for seed in range(5)),
    *(Task("office", seed) for seed in range(4)),
    *(Task("mall", seed) for seed in range(4)),
)
FIGURES = (
    Figure("living_room", SURVEYOR.name, RECKONED, 0.30),
    Figure("living_room", SURVEYOR.name, MAPPED, 0.10),
    Figure("living_room", SURVEYOR.name, Mode.ONE_SHOT.value, 0.14),
    Figure("living_room", SURVEYOR.name, Mode.TRACK.value, 0.11),
    Figure("living_room", PEOPLE.name, RECKONED, 0.67),
    Figure("living_room", PEOPLE.name, MAPPED, 0.22),
    Figure("living_room", PEOPLE.name, Mode.TRACK.value, 0.20),
    Figure("office", SURVEYOR.name, RECKONED, 1.30),
    Figure("office", SURVEYOR.name, MAPPED, 0.20),
    Figure("mall", SURVEYOR.name, RECKONED, 7.32),
    Figure("mall", SURVEYOR.name, MAPPED, 0.33),
)


def measure_headline(
    context: StudyContext, *, tasks: Sequence[Task] = TASKS
) -> dict[tuple[str, str, str], float]:
    """Mean over walks of the median error (m), by world, kind of walk and figure."""
    found: dict[tuple[str, str, str], list[float]] = {}
    for task, walk in zip(tasks, finished(median_errors, tasks, context), strict=True):
        for each in walk:
            found.setdefault((task.world, task.kind, each.method), []).append(each.value)
    return {key: float(np.mean(values)) for key, values in found.items()}


def median_errors(task: Task) -> list[Record]:
    """Median errors (m) of one walk, aligned: its dead reckoning, its map, and who is in it."""
    world, kind = load_world(task.world), kind_named(task.kind)
    mapped = mapped_walk(world, task.seed, task.rounds, kind=kind)
    numbers = {
        RECKONED: reckoned_m(mapped, task.seed, kind),
        MAPPED: trajectory_errors(mapped.run.trajectory, mapped.truth)[MEDIAN_ALIGNED],
    }
    if task.modes:
        other = stranger(world, task.seed, STRANGER_ROUNDS, kind=kind)
        for mode in task.modes:
            fixes = located(mapped, other, mode, Settings())
            found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
            numbers[mode.value] = found[MEDIAN_M]
    return [Record(name, MEDIAN_M, value) for name, value in numbers.items()]


def reckoned_m(mapped: Mapped, seed: int, kind: Kind) -> float:
    """The same walk by steps and headings alone."""
    known = walkers(seed, kind)[CALIBRATED]
    run = map_by(mapped.recording, [sense_of(Modality.MOTION, known)], known)
    return trajectory_errors(run.trajectory, mapped.truth)[MEDIAN_ALIGNED]


def judged(
    found: Mapping[tuple[str, str, str], float], figures: Iterable[Figure]
) -> list[dict[str, object]]:
    """A row per figure; NaN, where nobody was located, is red like what is above its limit."""
    return [
        {
            "world": figure.world,
            "walks": figure.kind,
            "median error": figure.name,
            "expected (m)": figure.expected_m,
            "limit (m)": figure.limit_m,
            "measured (m)": round(value, 3),
            "verdict": OK if value <= figure.limit_m else RED,
        }
        for figure in figures
        for value in [found[figure.world, figure.kind, figure.name]]
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; the exit code says whether all is within its limit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=RawTextHelpFormatter)
    parser.add_argument("--on", default="2", help="who works: a number of processes")
    parser.add_argument("--strict", action="store_true", help="exit 1 where a result is stale")
    known = parser.parse_args(arguments)
    with progress_bar() as announce, open_workers(known.on) as workers:
        rows = judged(measure_headline(StudyContext(announce=announce, workers=workers)), FIGURES)
    print_rows(rows, title="Headline", as_json=False)
    stale: list[dict[str, object]] = [
        {"study": each.name, "walks": each.kind or "", "why": each.why, "verdict": RED}
        for each in stale_studies(STUDIES, Choice())
    ]
    print_rows(stale, title="Results older than their code: `python -m studies all`", as_json=False)
    is_red = any(row["verdict"] != OK for row in rows)
    return int(is_red or (known.strict and bool(stale)))


if __name__ == "__main__":
    sys.exit(main())
