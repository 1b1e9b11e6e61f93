"""Pre-training by one process, several, and a Ray cluster, and what a kill in the middle costs."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from elfslam.app.workers import Workers
from elfslam.app.workers.on_ray import cluster_here
from elfslam.app.workers.processes import end_with_the_driver
from elfslam.base.errors import InputError, WorkerError
from elfslam.base.progress import Announce
from elfslam.base.values import EchoPairs
from elfslam.learn.parameters import PretrainParameters
from studies.finding import Row
from studies.repeats import Numbers, finished

SEED = 100
NODES = 2
WARM_STEPS = 5
"""Steps that do not count for the rate: the first wait for whoever makes the echoes."""
NOBODY, DRIVER, STREAM, TRAINER = "nobody", "driver", "echoes", "trainer"
MOST_STARTS = 3
STUDY_PARAMETERS = PretrainParameters(steps=30, pairs=64, checkpoint_steps=10, warmup_steps=5)
KILL_STEP = 16
"""Six steps after a checkpoint."""
TIMED_PARAMETERS = PretrainParameters(steps=20, checkpoint_steps=10, warmup_steps=5)
"""The usual batch; nobody is killed."""


@dataclass(frozen=True)
class Way:
    """Who makes the echoes and how many train; `killed` says which of them are killed in turn."""

    name: str
    on: str | None
    trainers: int
    killed: tuple[str, ...]


WAYS = (
    Way("1 process", None, 1, (NOBODY, DRIVER)),
    Way("1, echoes by 2", "2", 1, (NOBODY, STREAM, DRIVER)),
    Way("2 trainers", "2", 2, (NOBODY, STREAM, TRAINER, DRIVER)),
    Way("2 trainers, Ray", "ray", 2, (NOBODY, STREAM, TRAINER, DRIVER)),
)


@dataclass(frozen=True)
class Task:
    """A pre-training, in which whoever is named is killed once, when `kill_step` is done."""

    way: Way
    killed: str
    parameters: PretrainParameters
    kill_step: int


@dataclass(frozen=True)
class Run:
    """A task in a folder."""

    task: Task
    folder: Path

    @property
    def steps(self) -> Path:
        """A line for each step that was done: its number and when."""
        return self.folder / "steps"

    @property
    def digest(self) -> Path:
        """The digest of the weights, once they are final."""
        return self.folder / "digest"

    @property
    def dead(self) -> Path:
        """Is there once somebody was killed."""
        return self.folder / "dead"

    @property
    def checkpoint(self) -> Path:
        """Where the training goes on from."""
        return self.folder / "training.checkpoint"


def measure_pretraining_kills(
    data: Path | None,
    announce: Announce,
    kept: Path | None = None,
    *,
    workers: Workers | None = None,
    ways: Sequence[Way] = WAYS,
    parameters: PretrainParameters = STUDY_PARAMETERS,
    kill_step: int = KILL_STEP,
    timed: PretrainParameters | None = TIMED_PARAMETERS,
) -> list[Row]:
    """A row per way of training and per victim: seconds, steps done again, and the same weights.

    `lost (s)` is against nobody killed, `pairs/s` once training runs, `rate` that over the first
    row's of such batches. Weights must be the same bit for bit within as many trainers. Every way
    but those by a cluster is `timed` with other parameters, too. `data` is not needed.
    Raises InputError for `workers`: who works is what is compared.
    """
    if workers is not None and workers.count > 1:
        raise InputError(
            "study pretraining-kills: compares who works, wanted no --on; leave it out"
        )
    tasks = [Task(way, killed, parameters, kill_step) for way in ways for killed in way.killed]
    if timed is not None:
        tasks += [Task(way, NOBODY, timed, kill_step) for way in ways if way.on != "ray"]
    numbers = finished(measure_task, tasks, announce, kept=kept)
    rows: list[Row] = []
    for task, found in zip(tasks, numbers, strict=True):
        rows.append(_row(task, found, dict(zip(tasks, numbers, strict=True))))
    return rows


def _row(task: Task, found: Numbers, every: Mapping[Task, Numbers]) -> Row:
    calm = task.killed == NOBODY
    undisturbed = every[replace(task, killed=NOBODY)]
    similar = {other: every[other] for other in every if other.parameters == task.parameters}
    first = next(iter(similar.values()))
    alike = {
        numbers["weights"]
        for other, numbers in similar.items()
        if other.way.trainers == task.way.trainers
    }
    return {
        "way": task.way.name,
        "pairs": task.parameters.pairs,
        "killed": task.killed if calm or found["killed"] else "missed",
        "wall (s)": round(found["wall"], 1),
        "lost (s)": None if calm else round(found["wall"] - undisturbed["wall"], 1),
        "again": int(found["again"]),
        "pairs/s": round(found["rate"]) if calm else None,
        "rate": round(found["rate"] / first["rate"], 2) if calm else None,
        "kept (kB)": round(found["bytes"] / 1000),
        "weights": f"{int(found['weights']):08x}",
        "same": len(alike) == 1,
    }


def measure_task(task: Task) -> Numbers:
    """Seconds, steps done again, pairs a second, bytes of the checkpoint, digest of the weights."""
    with _cluster_for(task.way), TemporaryDirectory() as folder:
        run = Run(task, Path(folder))
        _compiled(task.parameters)
        start_s = time.perf_counter()
        _done(run)
        wall_s = time.perf_counter() - start_s
        seconds = [float(line.split()[1]) for line in run.steps.read_text().splitlines()]
        return {
            "wall": wall_s,
            "again": float(len(seconds) - task.parameters.steps),
            "rate": _rate(seconds, task.parameters),
            "bytes": float(run.checkpoint.stat().st_size),
            "killed": float(run.dead.exists()),
            "weights": float(int(run.digest.read_text(), 16)),
        }


def _compiled(parameters: PretrainParameters) -> None:
    """Make a batch, so that no way of training is charged for compiling the kernels."""
    from elfslam.app.simulated_training import pairs_in

    pairs_in(replace(parameters, pairs=1, rooms=1), SEED)(0)


@contextmanager
def _cluster_for(way: Way) -> Iterator[None]:
    """A cluster of two nodes where the way wants one, which its runs then find."""
    if way.on != "ray":
        yield
        return
    before = os.environ.get("RAY_ADDRESS")
    with cluster_here(nodes=NODES) as cluster:
        os.environ["RAY_ADDRESS"] = cluster.address
        try:
            yield
        finally:
            os.environ.pop("RAY_ADDRESS")
            if before is not None:
                os.environ["RAY_ADDRESS"] = before


def _rate(seconds: Sequence[float], parameters: PretrainParameters) -> float:
    """Pairs that were learnt from in a second."""
    skipped = min(WARM_STEPS, len(seconds) - 2)
    steps = len(seconds) - 1 - skipped
    return parameters.pairs * steps / max(seconds[-1] - seconds[skipped], 1e-9)


def _done(run: Run) -> None:
    """Start the command, and again where it was killed. Raises WorkerError where it fails."""
    context = multiprocessing.get_context("spawn")
    for _ in range(MOST_STARTS):
        driver = context.Process(target=drive, args=(run,), name="driver")
        driver.start()
        driver.join()
        if run.digest.exists():
            return
        if driver.exitcode != -signal.SIGKILL:
            break
    way = run.task.way.name
    raise WorkerError(f"pre-training: {way} ended with {driver.exitcode}, wanted weights")


def drive(run: Run) -> None:
    """What the command does, with whoever is to be killed killed once."""
    from elfslam.app.simulated_training import pairs_in, train_on_stream
    from elfslam.learn.pretrain import PairsOf, Progress
    from elfslam.learn.resumable import weights_digest

    end_with_the_driver()
    task = run.task

    def report(progress: Progress) -> None:
        with run.steps.open("a") as lines:
            lines.write(f"{progress.step} {time.time()}\n")
        if progress.step == task.kill_step and not run.dead.exists():
            _kill(run)

    pairs_of: PairsOf = pairs_in(task.parameters, SEED)
    if task.killed == STREAM:
        pairs_of = partial(pairs_or_death, pairs_of=pairs_of, step=task.kill_step, dead=run.dead)
    made = train_on_stream(
        pairs_of, task.parameters, seed=SEED, checkpoint=run.checkpoint, report=report,
        on=task.way.on, trainers=task.way.trainers,
    )  # fmt: skip
    run.digest.write_text(weights_digest(made.network)[:8])


def _kill(run: Run) -> None:
    """Kill the driver, which this is, or the last of the trainers."""
    task = run.task
    if task.killed == DRIVER:
        run.dead.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if task.killed == TRAINER:
        run.dead.touch()
        (victim,) = [
            child
            for child in multiprocessing.active_children()
            if child.name == f"trainer {task.way.trainers - 1}"
        ]
        victim.kill()


def pairs_or_death(
    given: int, /, *, pairs_of: Callable[[int], EchoPairs], step: int, dead: Path
) -> EchoPairs:
    """The batch of a step; whoever makes that of `step` first is killed over it."""
    if given == step and not dead.exists():
        dead.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return pairs_of(given)
