"""What is done elsewhere in these tests: a process there imports it by its name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info

from elfslam.app.workers.together import Seat
from elfslam.base.arrays import F32


def square(task: int) -> int:
    return task * task


def process(task: int) -> int:
    return os.getpid()


def threads(task: int) -> int:
    """Of the arithmetic: the most that any of its libraries would use."""
    np.ones((8, 8)) @ np.ones((8, 8))
    return max(int(each["num_threads"]) for each in threadpool_info())


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


def noise(task: int) -> F32:
    """The same bits wherever it is made, after a while that differs."""
    time.sleep(0.02 * (task % 3))
    return np.random.default_rng([7, task]).standard_normal((4, 2352)).astype(np.float32)


def noise_after_a_kill(task: int, folder: Path) -> F32:
    die_once(task, folder)
    return noise(task)


def count_up(seat: Seat, *, folder: Path, keep: bool, dies: int, times: int) -> None:
    """Adds up its parts of 5 steps, the state in a file; a process kills itself at step 3.

    As in a training, nobody ends a step before all have begun it, nor begins one before all have
    kept the one before.
    """
    done, total = _number(folder / f"sum-{seat.number}"), _number(folder / f"total-{seat.number}")
    for step in range(done, 5):
        part = seat.part_of(step)
        deaths = len(list(folder.glob("death-*")))
        if step == 3 and seat.number == dies and deaths < times:
            (folder / f"death-{deaths}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        total += sum(part)
        if not keep:
            continue
        _meet(seat, folder, "begun", step + 1)
        seat.tell((step, total))
        _put(folder / f"total-{seat.number}", total)
        _meet(seat, folder, "sum", step + 1)
        seat.keep()


def _meet(seat: Seat, folder: Path, what: str, step: int) -> None:
    """Say how far this process is, and wait until all are."""
    _put(folder / f"{what}-{seat.number}", step)
    while any(_number(folder / f"{what}-{each}") < step for each in range(seat.count)):
        time.sleep(0.01)


def _put(file: Path, number: int) -> None:
    partial = file.with_suffix(".partial")
    partial.write_text(str(number))
    partial.replace(file)


def _number(file: Path) -> int:
    return int(file.read_text()) if file.exists() else 0


def fail_together(seat: Seat, *, error: Exception) -> None:
    """Number 1 fails, and number 0 of what comes of it."""
    if seat.number == 1:
        raise error
    time.sleep(0.3)
    raise RuntimeError("the other one is gone")


def large(task: int, folder: Path) -> F32:
    """Sixteen megabytes."""
    (folder / str(task)).touch()
    return np.full((2048, 2048), task, dtype=np.float32)


def stay(task: int) -> int:
    time.sleep(600)
    return task
