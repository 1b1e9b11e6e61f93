"""Processes that do one work together. Where one dies, all begin again from what was kept."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, TypeVar, cast

from elfslam.app.workers.processes import MOST_TRIES, end_with_the_driver
from elfslam.app.workers.versions import Version, check_version, own_version
from elfslam.base.errors import ElfslamError, WorkerError

Batch = TypeVar("Batch")
Part = TypeVar("Part")
GRACE_S = 2.0
"""What others raise when one of them dies may be heard before the death is."""


class Seat:
    """One process's place in the work: its number, of how many, and where all of them meet."""

    def __init__(
        self, number: int, count: int, meeting: str, asking: Connection, telling: Connection
    ) -> None:
        self.number, self.count, self.meeting = number, count, meeting
        self._asking, self._telling = asking, telling

    def part_of(self, step: int) -> Any:
        """This process's part of the batch of a step; steps are asked for in order."""
        self._asking.send(step)
        return self._asking.recv()

    def tell(self, message: object) -> None:
        """Say something to whoever hears of the work."""
        self._telling.send(Told(message))

    def keep(self) -> None:
        """Say that what was done so far will not be done again."""
        self._telling.send(Kept())


@dataclass(frozen=True)
class Told:
    """What a process says of the work."""

    message: object


@dataclass(frozen=True)
class Kept:
    """Whoever dies from now on costs only what comes after."""


@dataclass(frozen=True)
class Ended:
    """A process is done, with an error where something went wrong."""

    error: BaseException | None


@dataclass(frozen=True)
class Work(Generic[Batch, Part]):
    """What is done: `do` by each process, on its part of each batch.

    `do` lies at the top of a module; `batches(step)` gives those from a step on, in order, and
    `part(batch, number, count)` what one process has of it.
    """

    do: Callable[[Seat], None]
    batches: Callable[[int], Generator[Batch]]
    part: Callable[[Batch, int, int], Part]


class _DiedError(Exception):
    """A process ended without a word."""


def together(work: Work[Any, Any], count: int, *, hear: Callable[[Any], None]) -> None:
    """Have `count` processes of this machine do the work; `hear` is told what number 0 tells.

    Batches are made here and go to the processes as these ask for them. A process that dies ends
    the others, and all begin again; `do` has to go on from what it kept. Raises what `do` raises,
    and WorkerError where processes died three times and nothing was kept in between, or one is of
    another version.
    """
    tries = 0
    while True:
        kept: list[None] = []
        try:
            return _tried(work, count, hear, kept)
        except _DiedError as cause:
            tries = 1 if kept else tries + 1
            if tries == MOST_TRIES:
                raise WorkerError(
                    f"trainers: {cause}, {MOST_TRIES} deaths with no checkpoint in between, "
                    "wanted all to live; look for a lack of memory, or take fewer"
                ) from None


def _tried(work: Work[Any, Any], count: int, hear: Callable[[Any], None], kept: list[None]) -> None:
    with TemporaryDirectory() as folder, _started(work.do, count, Path(folder)) as seats:
        serving = _Serving(work, count)
        try:
            _attended(seats, serving, hear, kept)
        finally:
            serving.close()


@dataclass(frozen=True)
class _Taken:
    """A seat as the driver sees it."""

    process: BaseProcess
    asked: Connection
    told: Connection


@contextmanager
def _started(do: Callable[[Seat], None], count: int, folder: Path) -> Iterator[list[_Taken]]:
    """The processes, for as long as they are needed."""
    # A forked process would inherit threads of torch and locks that nobody opens again.
    context = multiprocessing.get_context("spawn")
    seats: list[_Taken] = []
    try:
        for number in range(count):
            asked, asking = context.Pipe()
            told, telling = context.Pipe(duplex=False)
            process = context.Process(
                target=sit,
                args=(do, own_version(), number, count, f"file://{folder}/all", asking, telling),
                name=f"trainer {number}",
                daemon=True,
            )
            process.start()
            asking.close()
            telling.close()
            seats.append(_Taken(process, asked, told))
        yield seats
    finally:
        for seat in seats:
            seat.process.kill()
        for seat in seats:
            seat.process.join()
            seat.asked.close()
            seat.told.close()


def sit(
    do: Callable[[Seat], None], wanted: Version, number: int, count: int, meeting: str,
    asking: Connection, telling: Connection,
) -> None:  # fmt: skip
    """What a process does: it refuses where it is of another version, and says how it ended."""
    end_with_the_driver()
    error: BaseException | None = None
    try:
        check_version(wanted, own_version())
        do(Seat(number, count, meeting, asking, telling))
    except BaseException as found:
        error = found
    with suppress(ConnectionError):
        try:
            telling.send(Ended(error))
        except ConnectionError:
            raise
        except Exception:  # not every error can travel
            telling.send(Ended(WorkerError(f"trainer {number}: {error!r}")))


class _Serving:
    """Batches on their way to the processes; each waits until all have taken their part."""

    def __init__(self, work: Work[Any, Any], count: int) -> None:
        self._work, self._count = work, count
        self._batches: Generator[Any] | None = None
        self._next = 0
        self._waiting: dict[int, tuple[Any, set[int]]] = {}

    def part(self, step: int, number: int) -> Any:
        if self._batches is None:
            self._batches, self._next = self._work.batches(step), step
        while self._next <= step:
            self._waiting[self._next] = next(self._batches), set()
            self._next += 1
        batch, taken = self._waiting[step]
        taken.add(number)
        if len(taken) == self._count:
            del self._waiting[step]
        return self._work.part(batch, number, self._count)

    def close(self) -> None:
        if self._batches is not None:
            self._batches.close()


def _attended(
    seats: list[_Taken], serving: _Serving, hear: Callable[[Any], None], kept: list[None]
) -> None:
    """Serve and hear the processes until all are done. Raises what they raise, or _DiedError."""
    asking = {seat.asked: number for number, seat in enumerate(seats)}
    telling = {seat.told: number for number, seat in enumerate(seats)}
    while telling:
        for connection in wait([*telling, *asking]):
            ready = cast("Connection", connection)
            if ready in asking:
                if not _served(ready, serving, asking[ready]):
                    del asking[ready]
                continue
            message = _heard(seats, telling[ready])
            if isinstance(message, Ended):
                del telling[ready]
                _judge(seats, telling, message.error)
            elif isinstance(message, Kept):
                kept.append(None)
            elif isinstance(message, Told) and telling[ready] == 0:
                hear(message.message)


def _served(asking: Connection, serving: _Serving, number: int) -> bool:
    """Whether a process that may ask for its part was there to take it."""
    try:
        step = asking.recv()
    except (EOFError, ConnectionError):
        return False  # how it ended it tells elsewhere, or not
    part = serving.part(step, number)
    with suppress(ConnectionError):
        asking.send(part)
    return True


def _heard(seats: list[_Taken], number: int) -> Any:
    """The next that a process tells. Raises _DiedError where it will tell nothing more."""
    try:
        return seats[number].told.recv()
    except (EOFError, ConnectionError):
        raise _DiedError(_death(seats, number)) from None


def _judge(
    seats: list[_Taken], others: Mapping[Connection, int], error: BaseException | None
) -> None:
    """Raise the error that a process ended with, or what befell another that it may come from."""
    silent, until = dict(others), time.monotonic() + GRACE_S
    while error is not None and not isinstance(error, ElfslamError) and silent:
        heard = wait(list(silent), max(until - time.monotonic(), 0.0))
        if not heard:
            break
        for connection in heard:
            message = _heard(seats, silent[cast("Connection", connection)])
            if isinstance(message, Ended):
                del silent[cast("Connection", connection)]
                error = message.error if isinstance(message.error, ElfslamError) else error
    if error is not None:
        raise error


def _death(seats: list[_Taken], number: int) -> str:
    process = seats[number].process
    process.join(GRACE_S)
    code = process.exitcode
    if code is None or code >= 0:
        return f"number {number} ended without a word"
    return f"number {number} was killed ({signal.Signals(-code).name})"
