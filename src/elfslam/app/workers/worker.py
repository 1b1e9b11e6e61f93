"""The process of one worker: `MODULE DESCRIPTOR`, as `workers.child` runs it.

What it is asked and answers goes over a socket, pickled: first what it needs in order to import as
its parent does, then functions with their tasks, one after the other.
"""

from __future__ import annotations

import signal
import sys
import traceback
from contextlib import suppress
from multiprocessing import process, spawn
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from types import FrameType
from typing import Any

TERMINATED = 128 + signal.SIGTERM

Answer = tuple[Any, BaseException | None]


def preparation() -> dict[str, Any]:
    """What a worker needs in order to import as this process does. Raises RuntimeError in one."""
    told = spawn.get_preparation_data("worker")
    del told["authkey"]
    return told


def main() -> None:
    """Do one task after the other until nobody asks any more."""
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
    """Say what came of it; where that does not travel, why not."""
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
