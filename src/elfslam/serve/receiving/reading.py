"""Has a recording's folder read by a process of its own, within bounds of time and memory.

A file from outside may make its reader slow or large; the server must not suffer from it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from elfslam.serve.problems import Problem, disk_full
from elfslam.serve.settings import Limits

READER = "elfslam.serve.receiving.reader"
DISK_FULL = 28
"""How the reader exits where nothing more fits."""


@dataclass(frozen=True)
class ReadFolder:
    """What a folder holds, or why it is no recording."""

    facts: dict[str, Any] = field(default_factory=dict)
    refusal: str | None = None


def read_apart(folder: Path, limits: Limits, packed: Path | None = None) -> ReadFolder:
    """What a process of its own finds in a folder, once it has unpacked a zip into it, if one.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    command = [sys.executable, "-P", "-m", READER, str(folder), json.dumps(asdict(limits))]
    command += [] if packed is None else [str(packed)]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=limits.reading_s, check=False, text=True
        )
    except subprocess.TimeoutExpired:
        return ReadFolder(
            refusal=f"reading takes longer than {limits.reading_s:g} s; cut it in parts"
        )
    if done.returncode == DISK_FULL:
        raise disk_full()
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise Problem(503, f"the recording could not be read now ({last:.200}); complete it again")
    return ReadFolder(**json.loads(done.stdout.splitlines()[-1]))
