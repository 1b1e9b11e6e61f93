"""The same work by one process, several, and a Ray cluster of two nodes on this machine.

Walks that are mapped, each a unit, undisturbed and with a worker killed; then a whole study.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from elfslam.app.workers import Here, Workers, open_workers
from elfslam.app.workers.on_ray import cluster_here
from elfslam.base.progress import Announce
from elfslam.learn.parameters import ScratchParameters
from elfslam.line.feature import load_encoder
from elfslam.scoring.charts import seconds_figure
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.simulate import load_world, simulate
from studies.finding import Finding, Given, Row
from studies.mapping_errors import measure_mapping
from studies.repeats import Numbers, SimulatedWalk

SECONDS = "seconds"
"""Of a unit's numbers the one that may differ from run to run."""
PROCESSES = NODES = 2
WALKS, STUDY = "walks", "study"
SMALL = ScratchParameters(threads=1, steps=100)
"""How the study's encoder learns that has heard one walk alone; the study itself takes longer."""
NOTE_WALKS = "Seconds until all walks are mapped, without those that it took to start workers."
NOTE_STUDY = "`study mapping` in the studio, in small: the same table from all."
KILL_AFTER = 2
"""Units that are done before a worker is killed."""
TENTH_S = 0.1


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
Work = Callable[[Workers], tuple[Row, object]]
"""Gives times that it knows, and what was found."""


def measure_scaling(
    given: Given,
    *,
    worlds: Sequence[str] = ("studio", "lounge"),
    seeds: Sequence[int] = tuple(range(100, 110)),
    rounds: int = 3,
    study_seeds: Sequence[int] = tuple(range(100, 104)),
    scratch: ScratchParameters = SMALL,
) -> Finding:
    """A row per kind of workers and work, undisturbed and with one of them killed.

    `start (s)`: until there are workers. `overhead (s)`: what they did not spend on units, per
    unit. `lost (s)`: by the kill. `equal`: what came out, to the last bit, to what this process
    makes. `study` is `study mapping` in the studio with `study_seeds`.
    """
    walks = [SimulatedWalk(world, seed, rounds) for world in worlds for seed in seeds]
    study = partial(_study_table, seeds=study_seeds, rounds=rounds, scratch=scratch)
    kinds: dict[str, Opened] = {
        "this process": _here,
        f"{PROCESSES} processes": partial(open_workers, str(PROCESSES)),
        f"Ray, {NODES} nodes": partial(cluster_here, nodes=NODES),
    }
    rows: list[Row] = []
    wanted: dict[str, object] = {}
    for name, opened in kinds.items():
        killer, undisturbed_s = Killer(), 0.0
        works: dict[tuple[str, int], Work] = {
            (WALKS, 0): partial(_timed, walks, killer=None),
            (WALKS, 1): partial(_timed, walks, killer=killer),
            (STUDY, 0): study,
        }
        if not rows:
            del works[WALKS, 1]  # there would be nobody left
        for (work, kills), start_s, wall_s, told, found in _done(
            opened, works, given.announce, name
        ):
            kind: Row = {"work": work, "workers": name, "kills": int(kills and bool(killer.killed))}
            times: Row = {"start (s)": start_s, "wall (s)": wall_s, "overhead (s)": None, **told}
            lost: Row = {"lost (s)": round(wall_s - undisturbed_s, 1) if kills else None}
            undisturbed_s = wall_s
            equal: Row = {"equal": found == wanted.setdefault(work, found)}
            rows.append({**kind, **times, **lost, **equal})
    rows.sort(key=lambda row: row["work"] == STUDY)
    return Finding(rows, scaling_page(rows, len(walks)))


def _done(
    opened: Opened, works: Mapping[tuple[str, int], Work], announce: Announce, name: str
) -> Iterator[tuple[tuple[str, int], float | None, float, Row, object]]:
    """Each work done by workers: when these were there (said once), how long it took, and found."""
    begin_s = time.perf_counter()
    with opened() as workers:
        start_s: float | None = round(time.perf_counter() - begin_s, 1)
        for k, (which, work) in enumerate(works.items()):
            announce(f"{name}: {which[0]}{' and a kill' * which[1]}", k / len(works))
            begin_s = time.perf_counter()
            told, found = work(workers)
            yield which, start_s, round(time.perf_counter() - begin_s, 1), told, found
            start_s = None


def _study_table(
    workers: Workers, *, seeds: Sequence[int], rounds: int, scratch: ScratchParameters
) -> tuple[Row, str]:
    """The table of a whole study as its file has it."""
    made = measure_mapping(
        Given(workers=workers), worlds=("studio",), seeds=seeds, rounds=rounds, scratch=scratch
    )
    return {}, json.dumps(made.rows, indent=2)


def scaling_page(rows: Sequence[Row], units: int) -> Page:
    """Times of each kind of workers, and the table."""
    shown = {
        work: {
            f"{row['workers']}{', a kill' if row['kills'] else ''}": float(str(row["wall (s)"]))
            for row in rows
            if row["work"] == work
        }
        for work in (WALKS, STUDY)
    }
    panels = [
        Panel(f"{units} walks mapped", seconds_figure(shown[WALKS]), NOTE_WALKS),
        Panel("A whole study", seconds_figure(shown[STUDY]), NOTE_STUDY),
        Panel("All times", rows_table(rows), wide=True),
    ]
    equal = sum(row["equal"] is True for row in rows)
    tiles = {"equal results": f"{equal} of {len(rows)}"}
    return Page("The same work by others", "One machine, whoever works.", panels, tiles)


@contextmanager
def _here() -> Iterator[Workers]:
    yield Here()


def _timed(
    walks: Sequence[SimulatedWalk], workers: Workers, *, killer: Killer | None
) -> tuple[Row, list[Numbers]]:
    found: dict[int, Numbers] = {}
    busy_s, start_s = 0.0, time.perf_counter()
    for index, (numbers, pid) in workers.each(measure_walk, walks):
        busy_s += numbers.pop(SECONDS)
        found[index] = numbers
        if killer is not None:
            killer.hear(pid, len(found))
    beyond_s = (time.perf_counter() - start_s) * workers.count - busy_s
    row: Row = {"overhead (s)": round(beyond_s / len(walks), 2)}
    return row, [found[index] for index in range(len(walks))]


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
