"""Who does the work: this process, several on this machine, or a Ray cluster.

Work is units that know nothing of each other: a function at the top of a module, and a task for
each call. Whoever has many of them asks for workers and takes results as they come:

    with open_workers("2") as workers:
        for index, result in workers.each(measure, tasks):
            ...

`on` says who: nothing for this process, a number of processes, `ray` or `ray://HOST:10001`.
"""

from elfslam.app.workers.choosing import open_watchers, open_workers
from elfslam.app.workers.interface import Watchers, WorkerDiedError, Workers, WorkersAwayError
from elfslam.app.workers.serial import SerialWorkers
from elfslam.app.workers.units import silent_elsewhere, unit_key

__all__ = [
    "SerialWorkers",
    "Watchers",
    "WorkerDiedError",
    "Workers",
    "WorkersAwayError",
    "open_watchers",
    "open_workers",
    "silent_elsewhere",
    "unit_key",
]
