"""Which workers somebody means."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from elfslam.base.errors import InputError
from elfslam.workers.here import Here
from elfslam.workers.interface import Workers
from elfslam.workers.processes import Processes

RAY = "ray"


@contextmanager
def open_workers(on: str | None = None) -> Iterator[Workers]:
    """Workers as long as they are needed.

    `on` is nothing (this process), a number of processes, `ray` (a cluster on this machine, or
    the one that RAY_ADDRESS names) or `ray://HOST:PORT`. Raises InputError for anything else, or
    where Ray is wanted and not there.
    """
    if on is None or on == "1":
        yield Here()
    elif on.isdecimal() and int(on) > 0:
        yield Processes(int(on))
    elif on == RAY or on.startswith(f"{RAY}://"):
        from elfslam.workers.on_ray import open_cluster

        with open_cluster(None if on == RAY else on) as cluster:
            yield cluster
    else:
        raise InputError(
            f"--on {on!r}: wanted a number of processes, ray or ray://HOST:10001; choose one"
        )
