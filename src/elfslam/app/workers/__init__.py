"""Who does the work: this process, several on this machine, or a Ray cluster.

Work is units that know nothing of each other: a function at the top of a module, and a task for
each call. Whoever has many of them asks for workers and takes results as they come:

    with open_workers("2") as workers:
        for index, result in workers.each(measure, tasks):
            ...

`on` says who: nothing for this process, a number of processes, `ray` or `ray://HOST:10001`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Protocol, TypeVar
from urllib.parse import urlsplit

from elfslam.base.errors import InputError, WorkerError
from elfslam.base.extras import installing
from elfslam.base.urls import shown_url
from elfslam.base.values import Announce, silent

if TYPE_CHECKING:
    from elfslam.app.workers.on_ray import Cluster

Task = TypeVar("Task")
Result = TypeVar("Result")
News = TypeVar("News")


class Workers(Protocol):
    """They do the same to many tasks."""

    @property
    def count(self) -> int:
        """How many tasks are worked on at once."""

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """The number of each task and what `do` makes of it, as they get done.

        Tasks are taken as they are needed, a few ahead, and results are not kept, so memory does
        not grow with their number. Where the work is done elsewhere, `do`, tasks and results are
        pickled. What `do` raises is raised here, once what is under way has been given up.
        Raises WorkerError where workers die again and again over one task, or are of another
        version.
        """

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """What `do` makes of the tasks, in their order, whoever of the workers is done first.

        A few are made ahead of whoever takes them, and no more, however slowly they are taken.
        Otherwise as `each`; the tasks must come to an end where the workers are a cluster.
        """


class Watchers(Protocol):
    """They do one long thing at a time, and say how it goes."""

    @property
    def count(self) -> int:
        """How many may be watched at once, each by a thread of its own."""

    def watch(self, do: Callable[[Task], Iterator[News]], task: Task) -> Iterator[News | None]:
        """What `do` says of a task as it comes, and nothing every while.

        Whoever closes it ends the work. Where that is done elsewhere, `do`, the task and what is
        said are pickled. Raises WorkerDiedError where the worker died in the middle,
        WorkersAwayError where all of them are gone, WorkerError where it is of another version,
        and what `do` raises.
        """


class WorkerDiedError(WorkerError):
    """A worker died in the middle of its work, which can be done again."""


class WorkersAwayError(WorkerError):
    """Whoever had the workers is gone; they have to be opened again."""


def unit_key(do: Callable[..., Any], task: object) -> str:
    """The digest of a unit's inputs: which function, what it is given besides, and the task.

    Inputs count as they are shown (`repr`): frozen dataclasses and plain values show all of
    themselves; functions by their names. What only says how it goes (`silent_elsewhere`) does
    not count.
    """
    return hashlib.sha256(f"{_shown(do)}: {task!r}".encode()).hexdigest()[:24]


def _shown(value: object) -> str:
    if isinstance(value, partial):
        named = sorted(value.keywords.items())
        given = [*value.args, *(each for each in named if not isinstance(each[1], Announcement))]
        return f"{_shown(value.func)}({', '.join(_shown(each) for each in given)})"
    if isinstance(value, Mapping):
        return f"{{{', '.join(_shown(each) for each in value.items())}}}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_shown(each) for each in value)}]"
    if callable(value) and hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


def by_one_thread(do: Callable[[Task], Result], task: Task) -> Result:
    """What `do` makes of the task with one thread for its sums.

    How many threads share a sum decides its last bits, and workers of different kinds would differ.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        return do(task)


class Announcement:
    """Says how far the work is, where the driver runs, and nothing anywhere else."""

    def __init__(self, announce: Announce) -> None:
        self._announce = announce

    def __call__(self, text: str, share: float | None) -> None:
        """Say what is being done and how much of it is."""
        self._announce(text, share)

    def __reduce__(self) -> tuple[Callable[[Announce], Announcement], tuple[Announce]]:
        return Announcement, (silent,)


def silent_elsewhere(announce: Announce) -> Announcement:
    """`announce` for a unit's function: it may travel to another process, and is silent there."""
    return announce if isinstance(announce, Announcement) else Announcement(announce)


class SerialWorkers:
    """This process."""

    count = 1

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """As `Workers` says; in the order of the tasks."""
        for index, task in enumerate(tasks):
            yield index, by_one_thread(do, task)

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """As `Workers` says; each when it is asked for."""
        for task in tasks:
            yield do(task)

    def watch(self, do: Callable[[Task], Iterator[News]], task: Task) -> Iterator[News]:
        """As `Watchers` says; `do` itself says nothing every while."""
        return do(task)


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
        from elfslam.app.workers.processes import Processes

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
