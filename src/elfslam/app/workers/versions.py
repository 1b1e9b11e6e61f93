"""The version of the code travels with the work, and a worker of another one refuses it."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import elfslam
from elfslam import __version__
from elfslam.app.workers.interface import Result, Task
from elfslam.base.errors import WorkerError

PACKAGE = Path(elfslam.__file__).parent
CODE = ("*.py", "*.onnx", "*.toml")


@dataclass(frozen=True)
class Environment:
    """What must be the same for results to be the same: this package, Python and NumPy."""

    elfslam: str
    code: str
    python: str
    numpy: str


@cache
def own_version() -> Environment:
    """The version of this process, its code by digest."""
    return Environment(__version__, code_digest(PACKAGE), platform.python_version(), np.__version__)


def code_digest(folder: Path) -> str:
    """Digest of the names and contents of the code in a folder, weights and worlds among it."""
    digest = hashlib.sha256()
    for file in sorted(file for pattern in CODE for file in folder.rglob(pattern)):
        digest.update(f"{file.relative_to(folder).as_posix()}\0".encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def done_by_the_same(wanted: Environment, do: Callable[[Task], Result], task: Task) -> Result:
    """What `do` makes of the task. Raises WorkerError where this is another version than wanted."""
    check_version(wanted, own_version())
    return do(task)


def check_version(wanted: Environment, got: Environment) -> None:
    """Raise WorkerError where two versions differ: in what, and how."""
    for name, value in vars(wanted).items():
        other = getattr(got, name)
        if other != value:
            raise WorkerError(
                f"worker {platform.node()}: got {name} {other}, wanted {value}; "
                "install the same version there"
            )
