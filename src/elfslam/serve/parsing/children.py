"""Starts the children that parse files from outside, in fair turns, and tells what they found.

A file from outside may make its reader slow, large or worse; the server must not suffer from it.
"""

import asyncio
import json
import multiprocessing
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from anyio import CapacityLimiter, to_thread

from elfslam.base.errors import InputError
from elfslam.serve.parsing.child import DISK_FULL, Bounds, Exceeded, main
from elfslam.serve.problems import Problem, disk_full

KNOWN = (
    "elfslam.serve.receiving.reader",
    "elfslam.serve.maps.plan_drawing",
    "elfslam.serve.parsing.child",
)
"""What children parse with is imported once, two seconds of work, and they are forked off that."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Threads of a pool that one file does not need count as its memory and processor time."""
CRASHES = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS, signal.SIGILL, signal.SIGTRAP)
"""How libraries end that get no more memory, or that a damaged file leads astray."""


class Children:
    """The children of one server; none outlives it."""

    def __init__(self) -> None:
        self._lock, self._alive, self._closed = threading.Lock(), set[BaseProcess](), False

    def parse(self, parser: str, bounds: Bounds, **given: Any) -> Any:
        """What MODULE:FUNCTION gives for what is given (JSON both), called in a child.

        Raises InputError for what it refuses and for what exceeds a bound, Problem 503 where the
        server stops or the child was killed, 507 where the disk is full.
        """
        with self._begun(parser, bounds, given) as (each, told):
            if not told.poll(bounds.wall_s):
                raise InputError(bounds.refusal(Exceeded.WALL))
            answer = _answer_of(told)
            if answer is None:
                each.join()
            if self._closed:
                raise _stopping()
            if answer is None:
                raise _failure(each.exitcode, bounds)
        if "fault" in answer:
            raise _unread(answer["fault"])
        if "refusal" in answer:
            refused = InputError(answer["refusal"])
            refused.choices = tuple(answer.get("choices", ()))
            raise refused
        return answer["found"]

    def close(self) -> None:
        """The server stops: kill those that are there, begin no more."""
        with self._lock:
            self._closed = True
            for each in self._alive:
                each.kill()

    @contextmanager
    def _begun(
        self, parser: str, bounds: Bounds, given: Mapping[str, Any]
    ) -> Iterator[tuple[BaseProcess, Connection]]:
        told, teller = multiprocessing.Pipe(duplex=False)
        with self._lock:
            if self._closed:
                raise _stopping()
            each = forks().Process(target=main, args=(teller, parser, bounds, given), daemon=True)
            each.start()
            teller.close()
            self._alive.add(each)
        try:
            yield each, told
        finally:
            with self._lock:
                self._alive.discard(each)
            each.kill()
            each.join()
            told.close()


def forks() -> ForkServerContext:
    """A process from which children are forked, begun where there is none yet."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(KNOWN))
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ |= ONE_THREAD
    forkserver.ensure_running()
    for name, value in before.items():
        del os.environ[name]
        if value is not None:
            os.environ[name] = value
    return context


def _answer_of(told: Connection) -> Any:
    """What a child told, None of one that ended without an answer."""
    with suppress(EOFError):
        return json.loads(told.recv_bytes())
    return None


def _stopping() -> Problem:
    return Problem(503, "the server stops; send it again", {"Retry-After": "5"})


def _failure(code: int | None, bounds: Bounds) -> Exception:
    """Why a child ended without an answer: a bound, a full disk, or a fault of the server."""
    if code == DISK_FULL:
        return disk_full()
    if code == -signal.SIGXCPU:
        return InputError(bounds.refusal(Exceeded.PROCESSOR))
    if code is not None and -code in CRASHES:
        return InputError(bounds.refusal(Exceeded.CRASH))
    return _unread(f"exit code {code}")


def _unread(why: str) -> Problem:
    return Problem(503, f"it could not be read now ({why:.200}); try again", {"Retry-After": "5"})


AT_ONCE, OF_ONE = 3, 2
"""Whoever takes all turns that one user has leaves one to others."""
WAITING, PATIENCE_S = 10, 60.0
"""So many of one user's requests wait, each for so long."""
T = TypeVar("T")


class Turns:
    """Turns of one kind of work, in threads of their own, so that no other answer waits for one.

    Of those who wait, the next is one of whoever has the fewest at work, the first who came.
    """

    def __init__(
        self, at_once: int = AT_ONCE, of_one: int = OF_ONE, patience_s: float = PATIENCE_S
    ) -> None:
        self._at_once, self._of_one, self._patience_s = at_once, of_one, patience_s
        self._threads = CapacityLimiter(at_once)
        self._working, self._present = Counter[str](), Counter[str]()
        self._queue: list[tuple[str, asyncio.Event]] = []

    @contextmanager
    def place(self, user: str) -> Iterator[None]:
        """A place in the queue, for what holds something while it waits. Raises Problem 429."""
        if self._present[user] >= self._of_one + WAITING:
            raise self._too_many()
        self._present[user] += 1
        try:
            yield
        finally:
            self._leave(self._present, user)

    async def run(self, user: str, work: Callable[[], T]) -> T:
        """What the work gives, once it is this user's turn. Raises Problem 429 after a while."""
        await self._turn(user)
        try:
            return await to_thread.run_sync(work, limiter=self._threads)
        finally:
            self._leave(self._working, user)
            self._admit()

    async def _turn(self, user: str) -> None:
        """Wait for a turn, which then is taken."""
        mine = (user, asyncio.Event())
        self._queue.append(mine)
        self._admit()
        try:
            async with asyncio.timeout(self._patience_s):
                await mine[1].wait()
        except BaseException as error:
            if mine in self._queue:
                self._queue.remove(mine)
            else:
                self._leave(self._working, user)
                self._admit()
            if isinstance(error, TimeoutError):
                raise self._too_many() from error
            raise

    def _admit(self) -> None:
        """Give the turns that are free to those who may have one."""
        while self._working.total() < self._at_once:
            waiting = [each for each in self._queue if self._working[each[0]] < self._of_one]
            if not waiting:
                return
            user, given = chosen = min(waiting, key=lambda each: self._working[each[0]])
            self._queue.remove(chosen)
            self._working[user] += 1
            given.set()

    def _leave(self, count: Counter[str], user: str) -> None:
        count[user] -= 1
        if not count[user]:
            del count[user]

    def _too_many(self) -> Problem:
        return Problem(
            429,
            f"{self._of_one} files of yours are being read and others wait; send it again later",
            {"Retry-After": "10"},
        )
