"""The real command, each time in a fork of a process that has everything loaded.

    python tests/hostile/forked_commands.py SOCKET

Starting an interpreter and its libraries takes seconds; a fork takes milliseconds.
"""

import gc
import json
import os
import resource
import select
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partialmethod
from pathlib import Path

LONGEST_S = 300.0
"""By the clock, for a command that waits for what never comes."""
MOST_CPU_S = 120
MOST_ADDRESSES_BYTES = 8 * 2**30
"""So that this machine survives what the tests are to find."""
BATCH_S = 2.0
"""Of an encoder; those that loop are many here."""
MOST_MESSAGE_BYTES = 2**16


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (a signal is negative), and what it took."""

    code: int
    peak_bytes: int
    errors: str = ""


@dataclass(frozen=True)
class Order:
    """A command, the folder that it is given in, and the one for its temporary files."""

    arguments: tuple[str, ...]
    folder: str
    scratch: str


class Commands:
    """The other end: runs one command after the other."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    def run(self, arguments: Sequence[object], folder: Path, scratch: Path) -> Ended:
        """Run `elfslam` with these arguments in a folder."""
        order = Order(tuple(map(str, arguments)), str(folder), str(scratch))
        with open(os.devnull, "wb") as output, tempfile.TemporaryFile() as errors:
            told = json.dumps(asdict(order)).encode()
            socket.send_fds(self._end, [told], [output.fileno(), errors.fileno()])
            ended = Ended(**json.loads(self._end.recv(MOST_MESSAGE_BYTES)))
            errors.seek(0)
            return replace(ended, errors=errors.read().decode(errors="backslashreplace"))


@contextmanager
def loaded_commands() -> Iterator[Commands]:
    """A process that has everything loaded, as long as it is needed."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        with theirs:
            command = [sys.executable, str(Path(__file__).resolve()), str(theirs.fileno())]
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, pass_fds=(theirs.fileno(),)
            )
        try:
            ours.recv(1)
            yield Commands(ours)
        finally:
            ours.shutdown(socket.SHUT_RDWR)
            process.wait(LONGEST_S)


def main() -> None:
    """Load, and then fork for one command after the other."""
    end = socket.socket(fileno=int(sys.argv[1]))
    _warm_up()
    gc.collect()
    gc.freeze()
    end.send(b".")
    while True:
        told, files, _, _ = socket.recv_fds(end, MOST_MESSAGE_BYTES, 2)
        if not told:
            return
        pid = os.fork()
        if pid == 0:
            end.close()
            _be(Order(**json.loads(told)), files)
        for file in files:
            os.close(file)
        end.send(json.dumps(asdict(_ended(pid)), default=str).encode())


def _ended(pid: int) -> Ended:
    """Wait for a process, and end it where that takes too long."""
    watch = os.pidfd_open(pid)
    try:
        if not select.select([watch], [], [], LONGEST_S)[0]:
            os.kill(pid, signal.SIGKILL)
    finally:
        os.close(watch)
    _, status, used = os.wait4(pid, 0)
    return Ended(os.waitstatus_to_exitcode(status), used.ru_maxrss * 1024)


def _be(order: Order, files: Sequence[int]) -> None:
    """Be the command; never returns."""
    import elfslam.cli

    code = 70
    try:
        for number, file in zip((1, 2), files, strict=True):
            os.dup2(file, number)
            os.close(file)
        os.chdir(order.folder)
        os.environ["TMPDIR"] = tempfile.tempdir = order.scratch
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))
        resource.setrlimit(resource.RLIMIT_AS, (MOST_ADDRESSES_BYTES, MOST_ADDRESSES_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.argv = ["elfslam", *order.arguments]
        elfslam.cli.main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 70
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _warm_up() -> None:
    """Load what is else loaded late, and map a walk without sound, which begins no threads."""
    import onnxruntime  # noqa: F401
    import pyarrow.parquet  # noqa: F401
    from PIL import Image

    import elfslam.cli.app
    import elfslam.learn.onnx_files  # noqa: F401
    from elfslam.serve.jobs.executors import warm_up
    from elfslam.stages import feature

    Image.init()
    begun = feature.OnnxEncoder.__init__
    feature.OnnxEncoder.__init__ = partialmethod(begun, batch_s=BATCH_S)  # type: ignore[assignment]
    warm_up()


if __name__ == "__main__":
    main()
