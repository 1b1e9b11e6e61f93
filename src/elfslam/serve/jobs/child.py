"""The process that does a job's work, watched: what it says, and that it ends when it should."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

from elfslam.app.workers.child import Child

LOG = "log.txt"
PATIENCE_S = 0.3
"""How soon a cancel is noticed."""
READ_BYTES = 65_536
WORK = "elfslam.serve.jobs.work"
DIED = "the work ended in the middle ({why}); retry it, and look into the server's log if it recurs"
OVERDUE = "the work took longer than {hours:g} h and was stopped; cut the recording up"


@dataclass(frozen=True)
class Progress:
    """What is being done and how much of it is; nothing where that is as before."""

    what: str | None = None
    share: float | None = None


@dataclass(frozen=True)
class Result:
    """What came of the work: facts where something was made, the problem where something failed.

    `died`: its process did, in the middle.
    """

    facts: dict[str, Any] | None
    problem: str | None = None
    died: bool = False


class Worked(Protocol):
    """A process that does a job's work, and is ended with the block."""

    @property
    def stdout(self) -> IO[bytes] | None:
        """Where it says what it does."""

    def wait(self) -> int:
        """Its exit status, once it has ended; -N where signal N ended it."""


Begin = Callable[[Path, IO[bytes], int], AbstractContextManager[Worked]]
"""Begins the work in a folder, given the file for what libraries print and the lock it keeps."""


def begin_anew(folder: Path, log: IO[bytes], lock: int) -> Child:
    """A new interpreter for the work in a folder."""
    return Child(WORK, str(folder), stdout=subprocess.PIPE, stderr=log, pass_fds=(lock,))


def child_news(
    folder: Path, *, longest_s: float, lock: int, begin: Begin = begin_anew
) -> Iterator[Progress | Result]:
    """Do the task of a folder in a process of its own: what it does, what came of it at last.

    Says something every while, be it nothing; whoever closes this ends the process. That keeps the
    file `lock` open: it is free again when whoever began it and the process both are gone.
    """
    with contextlib.ExitStack() as stack:
        with (folder / LOG).open("wb") as log:
            process = stack.enter_context(begin(folder, log, lock))
        yield from _watched(process, longest_s)


def _watched(process: Worked, longest_s: float) -> Iterator[Progress | Result]:
    began_s = time.monotonic()
    for news in _news(process):
        if news is not None and "problem" in news:
            yield Result(news["facts"], news["problem"])
            return
        yield Progress() if news is None else Progress(news["doing"], news["share"])
        if time.monotonic() - began_s > longest_s:
            yield Result(None, OVERDUE.format(hours=longest_s / 3600))
            return
    yield Result(None, DIED.format(why=_why(process.wait())), died=True)


def _news(process: Worked) -> Iterator[dict[str, Any] | None]:
    """The latest line of a process every while, nothing where none came, and its last at once."""
    assert process.stdout is not None
    pipe, rest = process.stdout.fileno(), b""
    latest, due_s = None, time.monotonic()
    with selectors.DefaultSelector() as ready:
        ready.register(pipe, selectors.EVENT_READ)
        while True:
            if ready.select(PATIENCE_S):
                came = os.read(pipe, READ_BYTES)
                if not came:
                    return
                *lines, rest = (rest + came).split(b"\n")
                latest = _read(lines[-1]) if lines else latest
            ended = latest is not None and "problem" in latest
            if ended or time.monotonic() >= due_s:
                yield latest
                latest, due_s = None, time.monotonic() + PATIENCE_S


def _read(line: bytes) -> dict[str, Any]:
    """A line of JSON; numbers that are none are nothing, for neither browsers nor SQL know them."""
    read: dict[str, Any] = json.loads(line, parse_constant=lambda name: None)
    return read


def _why(code: int) -> str:
    """An exit status in words."""
    if code == -signal.SIGKILL:
        return "it was killed, perhaps for want of memory"
    if code < 0:
        return f"signal {-code}"
    return f"exit status {code}"
