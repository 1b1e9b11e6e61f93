"""A child keeps to each of its bounds, says which it was, and ends with its server."""

import asyncio
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.parsing.child import Bounds
from elfslam.serve.parsing.children import OF_ONE, WAITING, Children, Turns
from elfslam.serve.problems import Problem
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).resolve().parents[3]
PARSER = "tests.serve.parsing.costly_parser:parse"
BOUNDS = Bounds(
    processor_s=1, wall_s=300, memory_bytes=2**27, file_bytes=2**20, advice="make it less"
)
SERVER = """
import sys
from elfslam.serve.parsing.children import Children
from tests.serve.parsing.test_children import BOUNDS, PARSER
Children().parse(PARSER, BOUNDS, what="wait", place=sys.argv[1])
"""


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    """A named pipe that a child writes its number to."""
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def has_ended(process: int) -> bool:
    """Whether a process ends, waited for; what is there no more has."""
    try:
        descriptor = os.pidfd_open(process)
    except ProcessLookupError:
        return True
    try:
        return select.select([descriptor], [], [], 120)[0] != []
    finally:
        os.close(descriptor)


def test_what_is_found_is_told() -> None:
    assert Children().parse(PARSER, BOUNDS, what="this") == "this"


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("compute", "needs more than 1 s of processor time; make it less"),
        ("grow", "needs more than 128 MB of memory; make it less"),
        ("crash", "needs more than 128 MB of memory, or is damaged; make it less"),
        ("write", "becomes a file of more than 1 MB; make it less"),
    ],
)
def test_each_bound_is_a_refusal_that_names_it(what: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        Children().parse(PARSER, BOUNDS, what=what)
    assert str(refused.value).startswith(words)


def test_what_waits_for_nothing_is_ended() -> None:
    with pytest.raises(InputError, match=r"takes longer than 0.5 s; make it less"):
        Children().parse(PARSER, replace(BOUNDS, wall_s=0.5), what="wait")


def test_a_refusal_names_no_place_of_this_machine(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        Children().parse(PARSER, BOUNDS, what="refuse", place=str(tmp_path / "plan"))
    assert str(refused.value) == "is no plan"


def test_a_mistake_of_ours_is_no_refusal() -> None:
    with pytest.raises(Problem) as failed:
        Children().parse(PARSER, BOUNDS, what="mistake")
    assert (failed.value.status_code, "a bug of ours" in failed.value.detail) == (503, True)


@pytest.fixture
def waiting(pipe: Path) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A process that had a child parse, and the number of that child, which waits."""
    with subprocess.Popen([sys.executable, "-c", SERVER, str(pipe)]) as server:
        try:
            yield server, int(pipe.read_text())
        finally:
            server.kill()


def test_a_child_ends_with_a_server_that_was_killed(
    waiting: tuple[subprocess.Popen[bytes], int],
) -> None:
    server, child = waiting
    server.send_signal(signal.SIGKILL)
    assert has_ended(child)


def test_a_server_that_stops_waits_for_no_child(pipe: Path) -> None:
    children = Children()
    with ThreadPoolExecutor() as threads:
        parsed = threads.submit(children.parse, PARSER, BOUNDS, what="wait", place=str(pipe))
        child = int(pipe.read_text())
        children.close()
        with pytest.raises(Problem, match="the server stops") as stopped:
            parsed.result()
    assert stopped.value.status_code == 503
    assert has_ended(child)
    with pytest.raises(Problem, match="the server stops"):
        children.parse(PARSER, BOUNDS, what="this")


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


@pytest.mark.anyio
async def test_two_of_one_user_at_a_time_and_another_is_not_kept_waiting() -> None:
    turns, work = Turns(), Work()
    names = [f"eve {k}" for k in range(6)]
    runs = [asyncio.create_task(turns.run("eve", partial(work.do, each))) for each in names]
    await work.begun_by(OF_ONE)
    assert await turns.run("ada", lambda: "ada") == "ada", "while all of eve's wait"
    assert len(work.begun) == OF_ONE
    work.end()
    assert await asyncio.gather(*runs) == names
    assert work.most == OF_ONE
    assert set(work.begun[:2]) == {"eve 0", "eve 1"}


@pytest.mark.anyio
async def test_the_next_turn_is_of_whoever_has_the_fewest() -> None:
    turns, short, long, order = Turns(at_once=2), Work(), Work(), list[str]()
    begun = [asyncio.create_task(turns.run("eve", partial(each.do, ""))) for each in (short, long)]
    await short.begun_by(1)
    await long.begun_by(1)
    runs = [
        asyncio.create_task(turns.run(user, partial(order.append, user)))
        for user in ("eve", "eve", "ada")
    ]
    await asyncio.sleep(0)
    short.end()
    await asyncio.gather(*runs)
    long.end()
    await asyncio.gather(*begun)
    assert order == ["ada", "eve", "eve"]


@pytest.mark.anyio
async def test_who_waits_too_long_is_refused_and_keeps_no_turn() -> None:
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


@pytest.mark.anyio
async def test_who_gives_up_leaves_the_turn_to_others() -> None:
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


@pytest.mark.anyio
async def test_work_that_fails_gives_its_turn_back() -> None:
    turns = Turns(at_once=1)
    with pytest.raises(ZeroDivisionError):
        await turns.run("eve", lambda: 1 // 0)
    assert await turns.run("eve", lambda: "now") == "now"


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
