"""Superimposition: one map for all orientations, after the paper's section on floor maps."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from elfslam.app.workers import silent_elsewhere
from elfslam.base.values import Announce
from elfslam.world.kinds import SURVEYOR, Kind
from studies.floor_spots import Spots, measure_floor
from studies.opposite_ways import Ways, measure_ways
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

SEEDS = tuple(range(10))

Task = Spots | Ways


def measure_superimposition(
    context: StudyContext,
    *,
    floors: Sequence[Spots] = (Spots(),),
    ways: Sequence[Ways] | None = None,
    kind: Kind = SURVEYOR,
) -> list[Record]:
    """Errors with and without superimposition: both ways round a room, and on thousands of spots.

    Trainings are kept beside `kept` and go on from there.
    """
    folder = (context.kept or Path("superimposition.partial")).parent / "superimposition"
    walked = ways if ways is not None else [Ways(seed=seed, kind=kind.name) for seed in SEEDS]
    tasks: list[Task] = [*walked, *floors]
    measure = partial(_measured, folder=folder, announce=silent_elsewhere(context.announce))
    found = finished(measure, tasks, context)
    walks, spots = found[: len(walked)], found[len(walked) :]
    means = averaged(walks, [way.seed for way in walked])
    return means + [record for floor in spots for record in floor]


def _measured(task: Task, folder: Path, announce: Announce) -> list[Record]:
    if isinstance(task, Spots):
        return measure_floor(task, folder, announce)
    return measure_ways(task, folder, announce)


STUDY = Study(
    "Does one map for all orientations locate a phone whichever way it points?",
    measure_superimposition, minutes=12, needs=("torch",), long=True,
    fast={"floors": (Spots(spots=9, traces=16, supervised_traces=8, queries=6),),
          "ways": (Ways(world="studio", seed=100, rounds=1, steps=1),)},
)  # fmt: skip
