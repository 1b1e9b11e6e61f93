"""Work in processes of this machine. One that dies costs the task that it was working on.

What a worker (`main`) is asked and answers goes over a socket, pickled: first what it needs in
order to import as its parent does, then functions with their tasks, one after the other.
"""

from __future__ import annotations

import queue
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import Pipe, process, spawn
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from types import FrameType
from typing import Any

from elfslam.app.workers import Result, Task, by_one_thread
from elfslam.app.workers.child import Child, end_children
from elfslam.base.errors import WorkerError

WORKER, TERMINATED = __name__, 128 + signal.SIGTERM
"""The module that a worker runs, and how it exits where it is told to."""
Answer = tuple[Any, BaseException | None]


def preparation() -> dict[str, Any]:
    """What a worker needs in order to import as this process does. Raises RuntimeError in one."""
    told = spawn.get_preparation_data("worker")
    del told["authkey"]
    return told


def main() -> None:
    """Be a worker: do one task after the other until nobody asks any more."""
    signal.signal(signal.SIGTERM, _unwind)
    line: Connection[Answer, Any] = Connection(int(sys.argv[1]))
    with suppress(EOFError, ConnectionError):
        _prepare(line.recv())
        while True:
            _say(line, _answer_to(line.recv_bytes()))


def _prepare(told: dict[str, Any]) -> None:
    """Import as the parent does; a main module that begins workers when imported is refused."""
    current: Any = process.current_process()
    current._inheriting = True
    spawn.prepare(told)
    current._inheriting = False


def _answer_to(asked: bytes) -> Answer:
    """What came of a task, or how that failed, with where."""
    try:
        do, task = ForkingPickler.loads(asked)
        return do(task), None
    except Exception as error:
        error.add_note(f"In a worker:\n{traceback.format_exc()}")
        return None, error


def _say(line: Connection[Answer, Any], answer: Answer) -> None:
    try:
        line.send(answer)
    except ConnectionError:
        raise
    except Exception as error:
        line.send((None, error))


def _unwind(number: int, frame: FrameType | None) -> None:
    """Tidy up on the way out, and say nothing of what breaks there."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.unraisablehook = lambda hidden: None
    raise SystemExit(TERMINATED)


GRACE_S = 5.0
"""How long a worker may take to tidy up."""
MOST_TRIES = 3
"""A task over which so many processes died is given up."""
AHEAD = 2
"""Results in order that may wait for each process: none idles, and few are held."""
Outcome = tuple[int, Result | None, BaseException | None]


class Processes:
    """So many processes of this machine, each fed by a thread of its own.

    A pool of several breaks as a whole when one of its processes is killed; these are pools of
    one.
    """

    def __init__(self, count: int) -> None:
        self.count = count

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """As `Workers` says."""
        numbered, turn = iter(enumerate(tasks)), threading.Lock()
        found: queue.Queue[Outcome[Result] | None] = queue.Queue(maxsize=2 * self.count)
        stopping, alone = threading.Event(), partial(by_one_thread, do)

        def next_task() -> tuple[int, Task] | None:
            with turn:
                return None if stopping.is_set() else next(numbered, None)

        def put(outcome: Outcome[Result] | None) -> None:
            while not stopping.is_set():
                with suppress(queue.Full):
                    return found.put(outcome, timeout=0.1)

        def work(process: _Process) -> None:
            while (given := next_task()) is not None:
                try:
                    put((given[0], process.result(alone, given[1]), None))
                except BaseException as error:
                    put((given[0], None, error))
            put(None)

        with _begun(self.count) as processes, ExitStack() as stack:
            stack.callback(stopping.set)
            for process in processes:
                threading.Thread(target=work, args=(process,), daemon=True).start()
            yield from _taken(found, self.count)

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """As `Workers` says."""
        idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()

        def done(task: Task) -> Result:
            process = idle.get()
            try:
                return process.result(do, task)
            finally:
                idle.put(process)

        waiting: deque[Future[Result]] = deque()
        threads = ThreadPoolExecutor(self.count)
        with ExitStack() as stack:
            stack.callback(threads.shutdown, cancel_futures=True)
            for process in stack.enter_context(_begun(self.count)):
                idle.put(process)
            stack.callback(threads.shutdown, wait=False, cancel_futures=True)
            for task in tasks:
                waiting.append(threads.submit(done, task))
                if len(waiting) > AHEAD * self.count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()


def _taken(
    found: queue.Queue[Outcome[Result] | None], workers: int
) -> Iterator[tuple[int, Result]]:
    while workers:
        outcome = found.get()
        if outcome is None:
            workers -= 1
            continue
        index, result, error = outcome
        if error is not None:
            raise error
        yield index, result  # type: ignore[misc]


class _Process:
    """One process, begun when it is first needed, and made anew where it dies."""

    def __init__(self) -> None:
        self._turn, self._closed = threading.Lock(), False
        self._child: Child | None = None
        self._line: Connection[Any, Answer] | None = None

    def close(self) -> Child | None:
        """Begin no more; the child that is there, for whoever ends it."""
        with self._turn:
            self._closed = True
            return self._child

    def result(self, do: Callable[[Task], Result], task: Task) -> Result:
        """What `do` makes of the task. Raises WorkerError where processes die over it."""
        for _ in range(MOST_TRIES):
            line = self._begun()
            try:
                line.send((do, task))
                result, error = line.recv()
            except (EOFError, ConnectionError):
                self._line = None
                continue
            if error is not None:
                raise error
            return result  # type: ignore[no-any-return]
        raise WorkerError(
            f"worker: {MOST_TRIES} processes died over {task!r}, wanted a result; "
            "look for a lack of memory, or do it in this process to see why"
        )

    def _begun(self) -> Connection[Any, Answer]:
        with self._turn:
            if self._closed:
                raise WorkerError("worker: was ended in the middle; do it again")
            if self._line is None:
                if self._child is not None:
                    end_children([self._child])
                self._line, theirs = Pipe()
                with theirs:
                    end = theirs.fileno()
                    self._child = Child(WORKER, str(end), pass_fds=(end,))
                self._line.send(preparation())
            return self._line


@contextmanager
def _begun(count: int) -> Iterator[list[_Process]]:
    """So many processes for the block, ended with it, whatever they are doing."""
    processes = [_Process() for _ in range(count)]
    try:
        yield processes
    finally:
        left = [each.close() for each in processes]
        end_children([child for child in left if child is not None], GRACE_S)
