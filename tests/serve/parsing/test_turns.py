"""Two at a time of one user, whatever else they send; whoever else comes has a turn."""

from __future__ import annotations

import asyncio
import threading
from functools import partial

import pytest

from elfslam.serve.parsing.turns import OF_ONE, WAITING, Turns
from elfslam.serve.problems import Problem
from tests.waiting import PATIENCE_S


class Work:
    """Work that lasts until it is told to end, and notes who is at it."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.at_it = self.most = 0
        self.begins, self._ends = threading.Semaphore(0), threading.Event()
        self._lock = threading.Lock()

    def do(self, what: str) -> str:
        with self._lock:
            self.begun.append(what)
            self.at_it += 1
            self.most = max(self.most, self.at_it)
        self.begins.release()
        self._ends.wait(PATIENCE_S)
        with self._lock:
            self.at_it -= 1
        return what

    def end(self) -> None:
        self._ends.set()

    async def begun_by(self, count: int) -> None:
        for _ in range(count):
            await asyncio.to_thread(self.begins.acquire)


def test_two_of_one_user_at_a_time_and_another_is_not_kept_waiting() -> None:
    async def scenario() -> tuple[list[str], Work]:
        turns, work = Turns(), Work()
        names = [f"eve {k}" for k in range(6)]
        runs = [asyncio.create_task(turns.run("eve", partial(work.do, each))) for each in names]
        await work.begun_by(OF_ONE)
        assert await turns.run("ada", lambda: "ada") == "ada", "while all of eve's wait"
        assert len(work.begun) == OF_ONE
        work.end()
        return await asyncio.gather(*runs), work

    done, work = asyncio.run(scenario())
    assert done == [f"eve {k}" for k in range(6)]
    assert work.most == OF_ONE
    assert set(work.begun[:2]) == {"eve 0", "eve 1"}


def test_the_next_turn_is_of_whoever_has_the_fewest() -> None:
    async def scenario() -> list[str]:
        turns, short, long = Turns(at_once=2), Work(), Work()
        begun = [
            asyncio.create_task(turns.run("eve", partial(each.do, ""))) for each in (short, long)
        ]
        await short.begun_by(1)
        await long.begun_by(1)
        order: list[str] = []
        runs = [
            asyncio.create_task(turns.run(user, partial(order.append, user)))
            for user in ("eve", "eve", "ada")
        ]
        await asyncio.sleep(0)
        short.end()
        await asyncio.gather(*runs)
        long.end()
        await asyncio.gather(*begun)
        return order

    assert asyncio.run(scenario()) == ["ada", "eve", "eve"]


def test_who_waits_too_long_is_refused_and_keeps_no_turn() -> None:
    async def scenario() -> None:
        turns, work = Turns(at_once=1, patience_s=0.0), Work()
        first = asyncio.create_task(turns.run("eve", partial(work.do, "first")))
        await work.begun_by(1)
        with pytest.raises(Problem) as refused:
            await turns.run("ada", lambda: "never")
        assert refused.value.status_code == 429
        assert refused.value.headers == {"Retry-After": "10"}
        work.end()
        await first
        assert await turns.run("ada", lambda: "now") == "now"

    asyncio.run(scenario())


def test_who_gives_up_leaves_the_turn_to_others() -> None:
    async def scenario() -> None:
        turns, work = Turns(at_once=1), Work()
        first = asyncio.create_task(turns.run("eve", partial(work.do, "first")))
        await work.begun_by(1)
        gone = asyncio.create_task(turns.run("ada", lambda: "never"))
        await asyncio.sleep(0)
        gone.cancel()
        with pytest.raises(asyncio.CancelledError):
            await gone
        work.end()
        assert await turns.run("bob", lambda: "now") == "now"
        await first

    asyncio.run(scenario())


def test_work_that_fails_gives_its_turn_back() -> None:
    async def scenario() -> None:
        turns = Turns(at_once=1)
        with pytest.raises(ZeroDivisionError):
            await turns.run("eve", lambda: 1 // 0)
        assert await turns.run("eve", lambda: "now") == "now"

    asyncio.run(scenario())


def test_the_places_of_one_user_have_an_end() -> None:
    turns, held = Turns(), []
    for _ in range(OF_ONE + WAITING):
        held.append(turns.place("eve"))
        held[-1].__enter__()
    with pytest.raises(Problem, match="others wait") as refused, turns.place("eve"):
        pass
    assert refused.value.status_code == 429
    with turns.place("ada"):
        pass
    held.pop().__exit__(None, None, None)
    with turns.place("eve"):
        pass
