"""Has files from outside read by a process of its own, within bounds of time and memory.

A file from outside may make its reader slow or large; the server must not suffer from it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from elfslam.base.errors import InputError
from elfslam.serve.problems import Problem, disk_full
from elfslam.serve.settings import Limits

READER, WALKS = "elfslam.serve.receiving.reader", "elfslam.serve.receiving.walks"
DISK_FULL = 28
"""How a reader exits where nothing more fits."""


@dataclass(frozen=True)
class ReadFolder:
    """What a folder holds, or why it is no recording."""

    facts: dict[str, Any] = field(default_factory=dict)
    refusal: str | None = None


@dataclass(frozen=True)
class Walk:
    """What came of a walk in a file; `place` is the name of its folder, where there is one."""

    found: ReadFolder
    place: str | None = None


def read_apart(folder: Path, limits: Limits) -> ReadFolder:
    """What a process of its own finds in the folder of a recording.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    try:
        return ReadFolder(**run_apart(READER, limits, str(folder)))
    except InputError as late:
        return ReadFolder(refusal=str(late))


def walks_apart(file: Path, folder: Path, most: int, limits: Limits) -> list[Walk]:
    """What a process of its own finds in a file, unpacked into `folder`; `most` walks and no more.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    try:
        told = run_apart(WALKS, limits, str(file), str(folder), str(most))
    except InputError as late:
        return [Walk(ReadFolder(refusal=str(late)))]
    return [Walk(ReadFolder(**each["found"]), each["place"]) for each in told]


def run_apart(reader: str, limits: Limits, *told: str) -> Any:
    """What a module prints, as JSON, that is run with `told` and the limits.

    Raises InputError where it takes too long, Problem 503 where it was killed, 507 where the
    disk is full.
    """
    command = [sys.executable, "-P", "-m", reader, *told, json.dumps(asdict(limits))]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=limits.reading_s, check=False, text=True
        )
    except subprocess.TimeoutExpired as late:
        raise InputError(
            f"reading takes longer than {limits.reading_s:g} s; cut it in parts"
        ) from late
    if done.returncode == DISK_FULL:
        raise disk_full()
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise Problem(503, f"the recording could not be read now ({last:.200}); complete it again")
    return json.loads(done.stdout.splitlines()[-1])
