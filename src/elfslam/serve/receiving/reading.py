"""Has a recording's folder read by a process of its own, within bounds of time and memory.

A file from outside may make its reader slow or large; the server must not suffer from it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from elfslam.serve.problems import Problem
from elfslam.serve.settings import Limits

READER = "elfslam.serve.receiving.reader"


@dataclass(frozen=True)
class Found:
    """What a folder holds, or why it is no recording."""

    facts: dict[str, Any] = field(default_factory=dict)
    refusal: str | None = None


def read_apart(folder: Path, limits: Limits) -> Found:
    """What a process of its own finds in a folder. Raises Problem 503 where that was killed."""
    command = [sys.executable, "-P", "-m", READER, str(folder), str(limits.reading_bytes)]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=limits.reading_s, check=False, text=True
        )
    except subprocess.TimeoutExpired:
        return Found(refusal=f"reading takes longer than {limits.reading_s:g} s; cut it in parts")
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise Problem(503, f"the recording could not be read now ({last:.200}); complete it again")
    return Found(**json.loads(done.stdout.splitlines()[-1]))
