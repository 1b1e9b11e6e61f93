"""The child that parses one file from outside: it keeps to its bounds and ends with the server."""

import errno
import json
import multiprocessing
import os
import resource
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from elfslam.app.workers.child import end_with_parent
from elfslam.base.errors import InputError
from elfslam.serve.store.blobs import FULL_ERRORS

DISK_FULL = 28
"""How a child exits where nothing more fits."""
MEBIBYTE = 2**20
STATM, DATA = Path("/proc/self/statm"), 5
"""Where Linux counts the pages of a process, and which of the numbers is that of its data."""


class Exceeded(StrEnum):
    """Bounds, in the words that refuse what exceeds them."""

    PROCESSOR = "needs more than {processor_s:g} s of processor time"
    WALL = "takes longer than {wall_s:g} s"
    MEMORY = "needs more than {memory_mb:g} MB of memory"
    CRASH = "needs more than {memory_mb:g} MB of memory, or is damaged"
    FILE = "becomes a file of more than {file_mb:g} MB"


@dataclass(frozen=True)
class Bounds:
    """What parsing one file may cost, and what its sender can do about one that costs more."""

    processor_s: float
    wall_s: float
    memory_bytes: int
    file_bytes: int
    """No file that it writes is larger."""
    advice: str
    niceness: int = 10
    """The server itself goes first."""

    def refusal(self, exceeded: Exceeded) -> str:
        """The line that names a bound."""
        words = exceeded.format(
            processor_s=self.processor_s,
            wall_s=self.wall_s,
            memory_mb=self.memory_bytes / MEBIBYTE,
            file_mb=self.file_bytes / MEBIBYTE,
        )
        return f"{words}; {self.advice}"


def main(told: Connection, parser: str, bounds: Bounds, given: Mapping[str, Any]) -> None:
    """Call a parser, MODULE:FUNCTION, with what is given, tell what comes of it as JSON, and exit.

    Told is `{"found": ...}`, `{"refusal": ..., "choices": [...]}`, or `{"fault": ...}` of ours.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None
    end_with_parent(parent.sentinel)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), sys.stderr.fileno())
    _limit_cost(bounds)
    name, _, function = parser.partition(":")
    parse = getattr(import_module(name), function)
    bound(resource.RLIMIT_DATA, bounds.memory_bytes + _inherited_bytes())
    try:
        answer = _answer(parse, bounds, given)
    except Exception as error:  # whatever a file makes a library raise
        if isinstance(error, OSError) and error.errno in FULL_ERRORS:
            sys.exit(DISK_FULL)
        answer = {"fault": f"{type(error).__name__}: {error}"}
    told.send_bytes(json.dumps(answer, allow_nan=False).encode())


def _inherited_bytes() -> int:
    """What this process had in memory when it was forked; 0 where the system does not tell."""
    with suppress(OSError):
        return int(STATM.read_text(encoding="utf-8").split()[DATA]) * resource.getpagesize()
    return 0


def _limit_cost(bounds: Bounds) -> None:
    os.nice(bounds.niceness)
    bound(resource.RLIMIT_CORE, 0)
    bound(resource.RLIMIT_FSIZE, bounds.file_bytes)
    bound(resource.RLIMIT_CPU, max(1, round(bounds.processor_s)), grace=1)


def bound(what: int, most: int, grace: int = 0) -> None:
    """Bound a resource; where it has a signal of its own, `grace` beyond that the kernel kills."""
    hard = resource.getrlimit(what)[1]
    if hard != resource.RLIM_INFINITY:
        most, grace = min(most, hard), 0
    resource.setrlimit(what, (most, most + grace))


def _answer(parse: Callable[..., Any], bounds: Bounds, given: Mapping[str, Any]) -> Any:
    """What is printed. Raises what is the fault of no file."""
    try:
        return {"found": parse(**given)}
    except InputError as error:
        places = (each for each in given.values() if isinstance(each, str) and each.startswith("/"))
        return {"refusal": without_places(str(error), *places), "choices": error.choices}
    except MemoryError:
        return {"refusal": bounds.refusal(Exceeded.MEMORY)}
    except OSError as error:
        if error.errno == errno.EFBIG:
            return {"refusal": bounds.refusal(Exceeded.FILE)}
        raise


def without_places(text: str, *places: str | Path) -> str:
    """The text without these places of this machine."""
    for place in places:
        text = text.replace(f"{place}/", "").replace(f"{place}: ", "")
    return text
