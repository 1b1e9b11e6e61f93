"""The same units by one process, several, and a Ray cluster of two nodes on this machine."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.line.feature import load_encoder
from elfslam.score.errors import Alignment, position_errors
from elfslam.slam import Parameters, map_by_echoes
from elfslam.studies.finding import Announce, Row
from elfslam.studies.repeats import Numbers
from elfslam.workers import Here, Workers, open_workers
from elfslam.workers.on_ray import cluster_here
from elfslam.world.simulate import load_world, simulate

SECONDS = "seconds"
"""Of a unit's numbers the one that may differ from run to run."""
NODES = 2
KILL_AFTER = 2
"""Units that are done before a worker is killed."""
TENTH_S = 0.1


@dataclass(frozen=True)
class Walk:
    """A simulated walk that is mapped."""

    world: str
    seed: int
    rounds: int


@dataclass
class Killer:
    """Kills one of the processes that work, once, after some units were done."""

    pids: set[int] = field(default_factory=set)
    killed: int | None = None

    def hear(self, pid: int, done: int) -> None:
        """A unit came from this process; the next one of it is never finished."""
        self.pids.add(pid)
        if done >= KILL_AFTER and self.killed is None:
            self.killed = pid
            threading.Timer(TENTH_S, os.kill, (pid, signal.SIGKILL)).start()


Opened = Callable[[], AbstractContextManager[Workers]]


def measure_scaling(
    data: Path | None,
    announce: Announce,
    *,
    worlds: Sequence[str] = ("studio", "lounge"),
    seeds: Sequence[int] = tuple(range(100, 110)),
    rounds: int = 3,
) -> list[Row]:
    """A row per kind of workers, undisturbed and with one of them killed: equal results, seconds.

    `overhead (s)`: the time that workers did not spend on units, per unit. `data` is not needed.
    """
    walks = [Walk(world, seed, rounds) for world in worlds for seed in seeds]
    kinds: dict[str, Opened] = {
        "this process": _here,
        "2 processes": partial(open_workers, "2"),
        f"Ray, {NODES} nodes": partial(cluster_here, nodes=NODES),
    }
    rows: list[Row] = []
    wanted: list[Numbers] | None = None
    for name, opened in kinds.items():
        for killer in (None, Killer()) if rows else (None,):
            announce(f"{name}{' and a kill' if killer else ''}", len(rows) / (2 * len(kinds) - 1))
            with opened() as workers:
                row, found = _timed(walks, workers, killer)
            wanted = wanted or found
            rows.append({"workers": name, **row, "same results": found == wanted})
    return rows


@contextmanager
def _here() -> Iterator[Workers]:
    yield Here()


def _timed(
    walks: Sequence[Walk], workers: Workers, killer: Killer | None
) -> tuple[Row, list[Numbers]]:
    found: dict[int, Numbers] = {}
    busy_s, start_s = 0.0, time.perf_counter()
    for index, (numbers, pid) in workers.each(measure_walk, walks):
        busy_s += numbers.pop(SECONDS)
        found[index] = numbers
        if killer is not None:
            killer.hear(pid, len(found))
    wall_s = time.perf_counter() - start_s
    row: Row = {
        "killed": 0 if killer is None or killer.killed is None else 1,
        "units": len(walks),
        "wall (s)": round(wall_s, 1),
        "units (s)": round(busy_s, 1),
        "overhead (s)": round((wall_s * workers.count - busy_s) / len(walks), 2),
    }
    return row, [found[index] for index in range(len(walks))]


def measure_walk(walk: Walk) -> tuple[Numbers, int]:
    """What mapping a walk gives, with the seconds it took; and which process did it."""
    start_s = time.perf_counter()
    recording, truth = simulate(load_world(walk.world), walk.seed, rounds=walk.rounds)
    run = map_by_echoes(recording, load_encoder("compact"), Parameters())
    errors_m = position_errors(
        run.trajectory.t_s, run.trajectory.world_from_body, truth, Alignment.ALIGNED
    )
    numbers = {
        "median error (m)": float(np.median(errors_m)),
        "closures": float(len(run.closures.i)),
        SECONDS: time.perf_counter() - start_s,
    }
    return numbers, os.getpid()
