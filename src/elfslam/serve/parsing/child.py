"""The child that parses one file from outside: it keeps to its bounds and ends with the server.

`python -m elfslam.serve.parsing.child PARENT BOUNDS MODULE GIVEN` calls `parse` of a module with
what is given, and prints `{"found": ...}` or `{"refusal": ...}` as JSON. Nothing is imported here
that a parser may not need: a child costs the start of an interpreter each time.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import resource
import signal
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from elfslam.base.errors import InputError
from elfslam.serve.store.disk_room import FULL_ERRORS

DISK_FULL = 28
"""How a child exits where nothing more fits."""
PR_SET_PDEATHSIG = 1
"""Of Linux's prctl: the signal that a process gets when its parent ends."""
MEBIBYTE = 2**20


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

    def exceeded(self, what: str) -> str:
        """The refusal that names a bound."""
        return f"{what}; {self.advice}"

    @property
    def too_much_processor(self) -> str:
        """The refusal of what computes for too long."""
        return self.exceeded(f"needs more than {self.processor_s:g} s of processor time")

    @property
    def too_much_memory(self) -> str:
        """The refusal of what is too large."""
        return self.exceeded(f"needs more than {self.memory_bytes / MEBIBYTE:g} MB of memory")

    @property
    def too_late(self) -> str:
        """The refusal of what does not end."""
        return self.exceeded(f"takes longer than {self.wall_s:g} s")

    @property
    def too_large(self) -> str:
        """The refusal of what becomes too large a file."""
        return self.exceeded(f"becomes a file of more than {self.file_bytes / MEBIBYTE:g} MB")


def main() -> int:
    """Parse as the command line says; gives the exit code."""
    parent, told_bounds, module, told = sys.argv[1:]
    end_with(int(parent))
    bounds = Bounds(**json.loads(told_bounds))
    _limit_cost(bounds)
    parse = import_module(module).parse
    _limit(resource.RLIMIT_DATA, bounds.memory_bytes)
    try:
        answer = _answer(parse, bounds, json.loads(told))
    except OSError as error:
        if error.errno in FULL_ERRORS:
            return DISK_FULL
        raise
    print(json.dumps(answer, allow_nan=False))
    return 0


def end_with(parent: int) -> None:
    """Be killed when the process `parent` ends, or end now where it has ended already."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


def _limit_cost(bounds: Bounds) -> None:
    os.nice(bounds.niceness)
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_FSIZE, bounds.file_bytes)
    _limit(resource.RLIMIT_CPU, max(1, round(bounds.processor_s)), grace=1)


def _limit(what: int, most: int, grace: int = 0) -> None:
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
        return {"refusal": without_places(str(error), *places)}
    except MemoryError:
        return {"refusal": bounds.too_much_memory}
    except OSError as error:
        if error.errno == errno.EFBIG:
            return {"refusal": bounds.too_large}
        raise


def without_places(text: str, *places: str | Path) -> str:
    """The text without these places of this machine."""
    for place in places:
        text = text.replace(f"{place}/", "").replace(f"{place}: ", "")
    return text


if __name__ == "__main__":
    sys.exit(main())
