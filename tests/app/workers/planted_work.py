"""What is done elsewhere in these tests: a process there imports it by its name."""

import ctypes
import os
import signal
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info

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


def large(task: int, folder: Path) -> F32:
    """Sixteen megabytes."""
    (folder / str(task)).touch()
    return np.full((2048, 2048), task, dtype=np.float32)


def stay(task: int) -> int:
    named("stay")
    time.sleep(600)
    return task


def stay_in_c(task: int) -> int:
    """In the middle of C that lets nobody else have a turn."""
    named("stay_in_c")
    ctypes.PyDLL(None).sleep(600)
    return task


def tidy(path: str) -> str:
    """Nothing where the name says so; else what lasts only as long as it is worked on."""
    if not path.endswith("done"):
        file = Path(path)
        file.touch()
        try:
            time.sleep(600)
        finally:
            file.unlink()
    return path


def named(name: str) -> None:
    """Have this process bear a name."""
    Path("/proc/self/comm").write_text(name)


def main() -> None:
    """Be a child that stays."""
    time.sleep(600)
