"""Who does the work: this process, several on this machine, or a Ray cluster.

Work is units that know nothing of each other: a function at the top of a module, and a task for
each call. Whoever has many of them asks for workers and takes results as they come:

    with open_workers("2") as workers:
        for index, result in workers.each(measure, tasks):
            ...

`on` says who: nothing for this process, a number of processes, `ray` or `ray://HOST:10001`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from elfslam.app.workers.interface import (
    SerialWorkers,
    Watchers,
    WorkerDiedError,
    Workers,
    WorkersAwayError,
    silent_elsewhere,
    unit_key,
)
from elfslam.app.workers.processes import Processes
from elfslam.base.errors import InputError
from elfslam.base.extras import installing
from elfslam.base.urls import shown_url

if TYPE_CHECKING:
    from elfslam.app.workers.on_ray import Cluster

__all__ = [
    "SerialWorkers",
    "Watchers",
    "WorkerDiedError",
    "Workers",
    "WorkersAwayError",
    "check_on",
    "is_ray",
    "open_watchers",
    "open_workers",
    "silent_elsewhere",
    "unit_key",
    "why_away",
]

RAY = "ray"


@contextmanager
def open_workers(on: str | None = None) -> Iterator[Workers]:
    """Workers as long as they are needed.

    `on` is nothing (this process), a number of processes, `ray` (a cluster on this machine, or
    the one that RAY_ADDRESS names) or `ray://HOST:PORT`. Raises InputError for anything else, or
    where Ray is wanted and not there.
    """
    check_on(on)
    if on is None or on == "1":
        yield SerialWorkers()
    elif is_ray(on):
        with _cluster(on) as cluster:
            yield cluster
    else:
        yield Processes(int(on))


@contextmanager
def open_watchers(on: str | None = None) -> Iterator[Watchers]:
    """Who does one long thing at a time and is watched: a cluster, or else this process.

    Raises InputError as `open_workers` does.
    """
    check_on(on)
    if on is None or not is_ray(on):
        yield SerialWorkers()
    else:
        with _cluster(on) as cluster:
            yield cluster


def _cluster(on: str) -> AbstractContextManager[Cluster]:
    from elfslam.app.workers.on_ray import open_cluster

    return open_cluster(None if on == RAY else on)


def check_on(on: str | None) -> None:
    """Raise InputError where `on` means nobody, or Ray where that is not installed."""
    if on is None or (on.isdecimal() and int(on) > 0):
        return
    if not is_ray(on) or (on != RAY and not _has_host(on)):
        raise InputError(
            f"on {shown_url(on)}: wanted a number of processes, ray or ray://HOST:10001; "
            "choose one",
            argument="on",
        )
    if find_spec("ray") is None:
        raise InputError(
            f"on ray: Ray is not installed; {installing('scale')}, or name a number of processes",
            argument="on",
        )


def why_away(on: str | None) -> str | None:
    """Why nobody answers at the address of a cluster; None where there is no reason."""
    if on is None or not is_ray(on) or on == RAY:
        return None
    from elfslam.app.workers.on_ray import knock

    try:
        knock(on)
    except OSError as error:
        return str(error.strerror or error)
    return None


def _has_host(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return bool(parts.hostname) and parts.port != 0 and parts.username is None
    except ValueError:
        return False


def is_ray(on: str | None) -> bool:
    """Whether that is a Ray cluster."""
    return on is not None and (on == RAY or on.startswith(f"{RAY}://"))
