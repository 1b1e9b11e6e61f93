"""What is done elsewhere in these tests: a process there imports it by its name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def square(task: int) -> int:
    return task * task


def process(task: int) -> int:
    return os.getpid()


def refuse(task: int) -> int:
    if task == 3:
        raise ValueError(f"no {task} here")
    return task


def die_once(task: int, folder: Path) -> int:
    """Killed over task 3 the first time; says in `folder` how often each task was begun."""
    begun = folder / f"{task}-{os.getpid()}"
    begun.touch()
    if task == 3 and len(list(folder.glob("3-*"))) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return task


def die(task: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return task


def stay(task: int) -> int:
    time.sleep(600)
    return task
