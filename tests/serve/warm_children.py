"""Children that parse, forked from a process that has imported all that they need.

What a child costs in a test is otherwise the import of SciPy, two seconds each; that it is started
anew, keeps to its bounds and ends with its server is tested in `parsing/test_children.py`.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import IO, Any

PARSER = "elfslam.serve.parsing.child"
WARM = (
    PARSER,
    "elfslam.serve.receiving.reader",
    "elfslam.serve.receiving.walks",
    "elfslam.serve.receiving.sensors",
    "elfslam.serve.maps.plan_drawing",
    "tests.serve.warm_children",
    "pytest",
)
"""The last because a child looks for the main module of whoever has it forked."""
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(list(WARM))


class WarmChild:
    """What the server asks of its own kind of child."""

    def __init__(self, *told: str, stderr: IO[bytes], **_how: Any) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        places = [f"/proc/{os.getpid()}/fd/{file.fileno()}" for file in (self._said, stderr)]
        self._process = CONTEXT.Process(target=be_the_child, args=(told, places), daemon=True)

    def __enter__(self) -> WarmChild:
        self._process.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._process.join()
        self._said.close()

    def communicate(self, timeout: float) -> tuple[bytes, None]:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(PARSER, timeout)
        self._said.seek(0)
        return self._said.read(), None

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def kill(self) -> None:
        if self._process.pid is not None:
            self._process.kill()


def be_the_child(told: tuple[str, ...], places: list[str]) -> None:
    """Run the module that is told first; output and errors go to those files."""
    for descriptor, place in enumerate(places, start=1):
        with Path(place).open("wb") as file:
            os.dup2(file.fileno(), descriptor)
    sys.argv[:] = told
    import_module(told[0]).main()
    sys.stdout.flush()
