"""Child processes that end with their parent, whatever ended it.

The standard input of a child is a pipe whose other end the parent alone holds. When the parent is
gone the kernel closes that, and kills the child at once, be it in the middle of a call into C.
"""

import fcntl
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from types import TracebackType
from typing import Any

START = "from elfslam.app.workers.child import main; main()"
STDIN, ORPHANED = 0, 1
"""How a child exits that finds itself without a parent."""


class Child(subprocess.Popen[bytes]):
    """A process of its own for the `main` of a module, which finds its arguments in `sys.argv`.

    It leads a group, and ends with the block, or with this process. `how` is for
    `subprocess.Popen`. Raises OSError where no process can be had.
    """

    def __init__(self, module: str, *arguments: str, **how: Any) -> None:
        theirs, self._held = os.pipe()
        command = [sys.executable, "-P", "-c", START, module, *arguments]
        try:
            super().__init__(command, stdin=theirs, start_new_session=True, **how)
        except BaseException:
            os.close(self._held)
            raise
        finally:
            os.close(theirs)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        end_children([self])
        super().__exit__(kind, error, trace)

    def release(self) -> None:
        """Let go of what has ended."""
        held, self._held = self._held, -1
        if held >= 0:
            os.close(held)


def end_children(children: Iterable[Child], grace_s: float = 0.0) -> None:
    """End children: by SIGTERM where they have a while to tidy up, and by SIGKILL after that."""
    children = list(children)
    until_s = time.monotonic() + grace_s
    if grace_s:
        for child in children:
            child.terminate()
    for child in children:
        with suppress(subprocess.TimeoutExpired):
            child.wait(max(0.0, until_s - time.monotonic()))
    for child in children:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        child.release()


def end_with_parent(pipe: int) -> None:
    """Have this process killed once nobody holds the other end of the pipe."""
    if sys.platform != "linux":
        threading.Thread(target=_follow, args=(pipe,), daemon=True).start()
        return
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(pipe, fcntl.F_SETFL, os.O_ASYNC)
    if select.select([pipe], [], [], 0)[0]:  # it came before anybody was to be told
        os._exit(ORPHANED)


def _follow(pipe: int) -> None:
    """Elsewhere a thread waits, which gets its turn between calls into C."""
    os.read(pipe, 1)
    os._exit(ORPHANED)


def main() -> None:
    """Be the child: the module and its arguments are on the command line."""
    end_with_parent(STDIN)
    del sys.argv[0]
    import_module(sys.argv[0]).main()
