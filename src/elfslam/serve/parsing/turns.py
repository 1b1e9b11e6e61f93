"""Fair turns at what is costly: so many at once in all, so many of one user, the others wait."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from anyio import CapacityLimiter, to_thread

from elfslam.serve.problems import Problem

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
