"""Processes that are killed at a step of theirs on the disk, not at a time."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

STEPS = ("fsync", "rename", "replace", "unlink", "rmdir", "mkdir", "open", "close")


def steps_of(do: Callable[[], object]) -> int:
    """How many steps on the disk it takes."""
    taken: list[str] = []
    with noticed(taken.append):
        do()
    return len(taken)


def survives(step: int, do: Callable[[], object]) -> bool:
    """Whether a process that is killed before that step, counted from 0, ends before."""
    left = iter(range(step))

    def kill(name: str) -> None:
        if next(left, None) is None:
            os.kill(os.getpid(), signal.SIGKILL)

    if (child := os.fork()) == 0:
        try:
            with noticed(kill):
                do()
            os._exit(0)
        finally:
            os._exit(1)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or status == 0, "it failed by itself"
    return status == 0


@contextmanager
def noticed(notice: Callable[[str], None]) -> Iterator[None]:
    """`notice` the name of each step on the disk before it is taken."""

    def noting(name: str, do: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **named: Any) -> Any:
            notice(name)
            return do(*arguments, **named)

        return run

    with pytest.MonkeyPatch.context() as patch:
        for name in STEPS:
            patch.setattr(os, name, noting(name, getattr(os, name)))
        yield
