"""What a study is, what it is given, and how its repeats are done: a walk each, a file for all.

A study measures a task (a walk of a world, a seed, a kind) at a time; `finished` gives the tasks to
whoever works and keeps what is done, so that a run that was cut off goes on.
"""

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from statistics import mean, median
from typing import Any, TypeVar

from elfslam.app.workers import SerialWorkers, Workers, unit_key
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import Announce, Trajectory, Truth, silent
from elfslam.data.atomic_files import replaced_file
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.world.kinds import Kind
from studies.cached import SimulatedWalk
from studies.results import Record, averaged

EXTRAS: Mapping[str, str] = {
    "torch": "learn", "sklearn": "studies", "pyroomacoustics": "acoustics", "pystoi": "speech",
    "ray": "scale",
}  # fmt: skip
"""By module that a study may need what brings it."""
MEDIAN_ALIGNED = "median error, aligned (m)"


@dataclass(frozen=True)
class StudyContext:
    """The folder of real recordings, who hears of progress, and who works.

    A long study keeps what is finished in the file `kept`, and gives its repeats to `workers`;
    where `sample` is a number, it times so many and ends.
    """

    data: Path | None = None
    announce: Announce = silent
    kept: Path | None = None
    workers: Workers | None = None
    sample: int | None = None


Measure = Callable[..., Iterable[Record]]
"""Makes records of a context, and of what else a study is told by name."""


@dataclass(frozen=True)
class Study:
    """A question with a table or figure: who measures it, and what that takes.

    `scenarios` are kinds of walk, each a run of its own; `fast` are the arguments of a variant that
    takes seconds. `needs` are modules to be installed; `data` the files of other people's that it
    reads, below the folder of recordings. A study that is `long` goes on from what is kept, and
    shares its repeats out.
    """

    question: str
    measure: Measure
    minutes: float
    """On two cores, with simulated walks in the cache."""
    fast: Mapping[str, Any] = field(default_factory=dict)
    scenarios: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    long: bool = False
    encoders: bool = False
    """Whether it compares encoders that it is given."""
    recordings: bool = False
    """Whether it can be made of a recording of one's own."""
    counts: bool = False
    """Whether it counts what others measured: it runs after them, whenever one of them ran."""

    def check(self, name: str, data: Path | None) -> None:
        """Raise InputError where something is missing that the study would ask for later."""
        for module in self.needs:
            if find_spec(module) is None:
                extra = EXTRAS[module]
                raise InputError(f"study {name}: needs {module}; `make studies` installs [{extra}]")
        if not self.data:
            return
        if data is None:
            raise InputError(
                f"study {name}: reads recordings of other people; name their folder "
                "with --data or in ELFSLAM_DATA"
            )
        missing = [each for each in self.data if not (data / each).exists()]
        if missing:
            raise InputError(f"study {name}: {data} has no {', '.join(missing)}; it needs them")


Task = TypeVar("Task")
Units = dict[str, dict[str, Any]]
"""By key: the `task` as it is shown, and its `records`."""


@dataclass
class SampledError(Exception):
    """Processor seconds of a repeat of a long study, of its repetition, and how many it has."""

    first_s: float
    again_s: float
    repeats: int


def finished(
    measure: Callable[[Task], Sequence[Record]], tasks: Sequence[Task], context: StudyContext
) -> list[list[Record]]:
    """What `measure` makes of every task, by the workers given (this process where there are none).

    A unit is known by the digest of its inputs; what the kept file has of a run that was cut off
    is not made again. Raises StoreError where the file is damaged or of other tasks, SampledError
    where the context asks for no more than the time of some.
    """
    if context.sample is not None:
        raise _sampled(measure, tasks, context.sample)
    keys = [unit_key(measure, task) for task in tasks]
    found = _read(context.kept, keys)
    waiting = {key: task for key, task in zip(keys, tasks, strict=True) if key not in found}
    left = list(waiting)
    _announce(context, len(found), len(set(keys)))
    for index, records in (context.workers or SerialWorkers()).each(measure, waiting.values()):
        units = [asdict(record) for record in records]
        found[left[index]] = {"task": repr(waiting[left[index]]), "records": units}
        _write(context.kept, found)
        _announce(context, len(found), len(set(keys)))
    return [[Record(**each) for each in found[key]["records"]] for key in keys]


def _sampled(
    measure: Callable[[Task], Sequence[Record]], tasks: Sequence[Task], count: int
) -> SampledError:
    """Of tasks spread over all: with the cache as it was, and with what that left there."""
    chosen = [tasks[(2 * k + 1) * len(tasks) // (2 * count)] for k in range(count)]
    first_s, again_s = _mean_s(measure, chosen), _mean_s(measure, chosen)
    return SampledError(first_s, again_s, len(tasks))


def _mean_s(measure: Callable[[Task], Sequence[Record]], tasks: Sequence[Task]) -> float:
    def seconds(task: Task) -> float:
        begun_s = time.process_time()
        measure(task)
        return time.process_time() - begun_s

    return mean(seconds(task) for task in tasks)


def _announce(context: StudyContext, done: int, of: int) -> None:
    context.announce(f"{done} of {of} repeats", done / of)


def _write(kept: Path | None, found: Units) -> None:
    if kept is not None:
        with replaced_file(kept) as partial:
            partial.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _read(kept: Path | None, keys: Sequence[str]) -> Units:
    if kept is None or not kept.exists():
        return {}
    try:
        found: Units = dict(json.loads(kept.read_text(encoding="utf-8")))
        strange = sorted(found[key]["task"] for key in set(found) - set(keys))
    except (OSError, ValueError, TypeError, KeyError) as cause:
        raise StoreError(f"{kept}: cannot be read ({cause}); delete it to start over") from cause
    if strange:
        raise StoreError(f"{kept}: has {strange[0]} of another run; delete it to start over")
    return found


def per_walk(
    measure: Callable[[SimulatedWalk], Sequence[Record]],
    context: StudyContext,
    worlds: Sequence[str],
    seeds: Sequence[int],
    rounds: int,
    kind: Kind,
) -> list[Record]:
    """The means over seeds of what `measure` makes of a walk in each world."""
    walks = [SimulatedWalk(world, seed, rounds, kind.name) for world in worlds for seed in seeds]
    return averaged(finished(measure, walks, context), seeds)


def median_aligned_m(mapped: Trajectory, truth: Truth) -> float:
    """The median error of a map that is laid on the truth as well as it can be."""
    poses = mapped.world_from_body
    return float(median(position_errors(mapped.t_s, poses, truth, Alignment.ALIGNED)))
