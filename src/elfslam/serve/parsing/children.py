"""Starts the children that parse files from outside, and tells what each of them found.

A file from outside may make its reader slow, large or worse; the server must not suffer from it.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from typing import IO, Any

from elfslam.app.workers.child import Child
from elfslam.base.errors import InputError
from elfslam.serve.parsing.child import DISK_FULL, Bounds, Exceeded
from elfslam.serve.problems import Problem, disk_full

PARSER = "elfslam.serve.parsing.child"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Threads of a pool that one file does not need count as its memory and processor time."""
CRASHES = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS, signal.SIGILL, signal.SIGTRAP)
"""How libraries end that get no more memory, or that a damaged file leads astray."""
LAST_BYTES = 4096


class Children:
    """The children of one server; none outlives it."""

    def __init__(self) -> None:
        self._lock, self._alive, self._closed = threading.Lock(), set[Child](), False

    def parse(self, module: str, bounds: Bounds, **given: Any) -> Any:
        """What `parse` of a module gives for what is given (JSON both), called in a child.

        Raises InputError for what it refuses and for what exceeds a bound, Problem 503 where the
        server stops or the child was killed, 507 where the disk is full.
        """
        with tempfile.TemporaryFile() as errors, self._begun(module, bounds, given, errors) as each:
            try:
                printed, _ = each.communicate(timeout=bounds.wall_s)
            except subprocess.TimeoutExpired as late:
                raise InputError(bounds.refusal(Exceeded.WALL)) from late
            if self._closed:
                raise _stopping()
            if each.returncode != 0:
                raise _failure(each.returncode, bounds, errors)
        answer = json.loads(printed.splitlines()[-1])
        if "refusal" in answer:
            refused = InputError(answer["refusal"])
            refused.choices = tuple(answer.get("choices", ()))
            raise refused
        return answer["found"]

    def close(self) -> None:
        """The server stops: kill those that are there, begin no more."""
        with self._lock:
            self._closed = True
            for each in self._alive:
                each.kill()

    @contextmanager
    def _begun(
        self, module: str, bounds: Bounds, given: Mapping[str, Any], errors: IO[bytes]
    ) -> Iterator[Child]:
        told = (json.dumps(asdict(bounds)), module, json.dumps(given))
        environment = {**os.environ, **ONE_THREAD}
        with self._lock:
            if self._closed:
                raise _stopping()
            each = Child(PARSER, *told, stdout=subprocess.PIPE, stderr=errors, env=environment)
            self._alive.add(each)
        try:
            with each:
                yield each
        finally:
            with self._lock:
                self._alive.discard(each)


def _stopping() -> Problem:
    return Problem(503, "the server stops; send it again", {"Retry-After": "5"})


def _failure(code: int, bounds: Bounds, errors: IO[bytes]) -> Exception:
    """Why a child ended without an answer: a bound, a full disk, or a fault of the server."""
    if code == DISK_FULL:
        return disk_full()
    if code == -signal.SIGXCPU:
        return InputError(bounds.refusal(Exceeded.PROCESSOR))
    if -code in CRASHES:
        return InputError(bounds.refusal(Exceeded.CRASH))
    errors.seek(max(0, errors.seek(0, os.SEEK_END) - LAST_BYTES))
    said = errors.read().decode(errors="replace").strip().splitlines()
    last = said[-1] if said else f"exit code {code}"
    return Problem(503, f"it could not be read now ({last:.200}); try again", {"Retry-After": "5"})
