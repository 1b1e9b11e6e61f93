"""Walks mapped by one process, several, and a Ray cluster of two nodes on this machine.

Each walk is a unit; undisturbed and with a worker killed.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np

from elfslam.app.workers import Here, Workers, open_workers
from elfslam.app.workers.on_ray import cluster_here
from elfslam.line.feature import load_encoder
from elfslam.scoring.charts import seconds_figure
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.simulate import load_world, simulate
from studies.finding import Finding, Given, Row
from studies.repeats import Numbers, SimulatedWalk

SECONDS = "seconds"
"""Of a unit's numbers the one that may differ from run to run."""
PROCESSES = NODES = 2
ALONE = "this process"
"""Nobody would be left if its worker were killed."""
NOTE = "Seconds until all walks are mapped, without those that it took to start workers."
KILL_AFTER = 2
"""Units that are done before a worker is killed."""
TENTH_S = 0.1


@dataclass
class Killer:
    """Kills one of the processes that work, once, after some units were done."""

    killed: int | None = None

    def hear(self, pid: int, done: int) -> None:
        """A unit came from this process; the next one of it is never finished."""
        if done >= KILL_AFTER and self.killed is None:
            self.killed = pid
            threading.Timer(TENTH_S, os.kill, (pid, signal.SIGKILL)).start()


Opened = Callable[[], AbstractContextManager[Workers]]


def measure_scaling(
    given: Given,
    *,
    worlds: Sequence[str] = ("studio", "lounge"),
    seeds: Sequence[int] = tuple(range(100, 110)),
    rounds: int = 3,
) -> Finding:
    """A row per kind of workers, undisturbed and with one of them killed.

    `start (s)`: until there are workers. `overhead (s)`: what they did not spend on units, per
    unit. `lost (s)`: by the kill. `equal`: what came out, to the last bit, to what this process
    makes.
    """
    walks = [SimulatedWalk(world, seed, rounds) for world in worlds for seed in seeds]
    kinds: dict[str, Opened] = {
        ALONE: _here,
        f"{PROCESSES} processes": partial(open_workers, str(PROCESSES)),
        f"Ray, {NODES} nodes": partial(cluster_here, nodes=NODES),
    }
    rows: list[Row] = []
    wanted: list[Numbers] = []
    for done, (name, opened) in enumerate(kinds.items()):
        given.announce(name, done / len(kinds))
        begin_s = time.perf_counter()
        with opened() as workers:
            start_s: float | None = round(time.perf_counter() - begin_s, 1)
            undisturbed_s = None
            for killer in (None,) if name == ALONE else (None, Killer()):
                wall_s, overhead_s, found = _mapped(walks, workers, killer)
                wanted = wanted or found
                rows.append({
                    "workers": name,
                    "kills": int(killer is not None and killer.killed is not None),
                    "start (s)": start_s,
                    "wall (s)": round(wall_s, 1),
                    "overhead (s)": round(overhead_s, 2),
                    "lost (s)": None if undisturbed_s is None else round(wall_s - undisturbed_s, 1),
                    "equal": found == wanted,
                })  # fmt: skip
                start_s, undisturbed_s = None, wall_s
    return Finding(rows, scaling_page(rows, len(walks)))


def scaling_page(rows: Sequence[Row], units: int) -> Page:
    """Times of each kind of workers, and the table."""
    times_s = {
        f"{row['workers']}{', a kill' if row['kills'] else ''}": float(str(row["wall (s)"]))
        for row in rows
    }
    panels = [
        Panel(f"{units} walks mapped", seconds_figure(times_s), NOTE),
        Panel("All times", rows_table(rows), wide=True),
    ]
    equal = sum(row["equal"] is True for row in rows)
    tiles = {"equal results": f"{equal} of {len(rows)}"}
    return Page("The same work by others", "One machine, whoever works.", panels, tiles)


@contextmanager
def _here() -> Iterator[Workers]:
    yield Here()


def _mapped(
    walks: Sequence[SimulatedWalk], workers: Workers, killer: Killer | None
) -> tuple[float, float, list[Numbers]]:
    """Seconds until all walks are mapped, those not spent on units per unit, and what was found."""
    found: dict[int, Numbers] = {}
    busy_s, start_s = 0.0, time.perf_counter()
    for index, (numbers, pid) in workers.each(measure_walk, walks):
        busy_s += numbers.pop(SECONDS)
        found[index] = numbers
        if killer is not None:
            killer.hear(pid, len(found))
    wall_s = time.perf_counter() - start_s
    overhead_s = (wall_s * workers.count - busy_s) / len(walks)
    return wall_s, overhead_s, [found[index] for index in range(len(walks))]


def measure_walk(walk: SimulatedWalk) -> tuple[Numbers, int]:
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
