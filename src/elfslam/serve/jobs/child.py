"""The process that does a job's work, watched: what it says, and that it ends when it should."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LOG = "log.txt"
PATIENCE_S = 0.3
"""How soon a cancel is noticed."""
READ_BYTES = 65_536
COMMAND = (sys.executable, "-m", "elfslam.serve.jobs.work")
DIED = "the work ended in the middle ({why}); retry it, and look into the server's log if it recurs"
OVERDUE = "the work took longer than {hours:g} h and was stopped; cut the recording up"

Told = Callable[[str | None, float | None], bool]
"""Hears what is being done, nothing where that is as before; whether to go on."""


@dataclass(frozen=True)
class Result:
    """What came of the work: facts where something was made, the problem where something failed."""

    facts: dict[str, Any] | None
    problem: str | None = None


def run_child(folder: Path, *, longest_s: float, told: Told, lock: int) -> Result | None:
    """Do the task of a folder in a process of its own; nothing where `told` stopped it.

    The process keeps the file `lock` open: it is free again when server and process both are gone.
    """
    with (folder / LOG).open("wb") as log:
        process = subprocess.Popen(
            [*COMMAND, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            pass_fds=(lock,),
            start_new_session=True,
        )
    try:
        return _watched(process, longest_s, told)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


def _watched(process: subprocess.Popen[bytes], longest_s: float, told: Told) -> Result | None:
    began_s = time.monotonic()
    for news in _news(process):
        if news is not None and "problem" in news:
            return Result(news["facts"], news["problem"])
        doing, share = (None, None) if news is None else (news["doing"], news["share"])
        if not told(doing, share):
            return None
        if time.monotonic() - began_s > longest_s:
            return Result(None, OVERDUE.format(hours=longest_s / 3600))
    return Result(None, DIED.format(why=_why(process.wait())))


def _news(process: subprocess.Popen[bytes]) -> Iterator[dict[str, Any] | None]:
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
