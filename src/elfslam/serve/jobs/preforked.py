"""Preforked worker: a process with everything loaded that forks for each job.

It is given the number of a socket, as `workers.child` runs it, and reads files and a folder from
there. It begins the work in a fork of itself, says the number of that process and, once it has
ended, how. It works on one job at a time.
"""

from __future__ import annotations

import gc
import os
import signal
import socket
import struct
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.app.workers.child import STDIN, Child, end_children, end_with_parent
from elfslam.base.errors import ElfslamError
from elfslam.data.recordings import write_recording

if TYPE_CHECKING:
    from elfslam.serve.jobs.executors import Worked

PREFORKED = "elfslam.serve.jobs.preforked"
NUMBER = struct.Struct("!i")
MOST_BYTES = 65_536
FILES = 4
"""Standard input, output and error of the work, and the lock that it keeps."""
REAP = b"."
WORLD, SEED = "studio", 100


class Loaded:
    """The other end: begins the work of one job after the other. One that died is made anew."""

    def __init__(self) -> None:
        self._process: Child | None = None
        self._end: socket.socket | None = None

    @contextmanager
    def begin(self, folder: Path, log: IO[bytes], lock: int) -> Iterator[Worked]:
        """The work in a folder, begun; see `child.Begin`."""
        end = self._alive()
        theirs, held = os.pipe()
        told, their_out = os.pipe()
        with os.fdopen(held, "wb"), os.fdopen(told, "rb", 0) as said:
            try:
                given = [theirs, their_out, log.fileno(), lock]
                socket.send_fds(end, [str(folder).encode()], given)
                process = _Forked(_received(end), said, end)
            except OSError as error:
                self.close()
                raise ChildProcessError(f"no process for {folder.name}: {error}") from error
            finally:
                os.close(theirs)
                os.close(their_out)
            try:
                yield process
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def close(self) -> None:
        """End it, and what it works on."""
        if self._end is not None:
            self._end.close()
        if self._process is not None:
            end_children([self._process])
        self._process = self._end = None

    def _alive(self) -> socket.socket:
        if self._end is not None and self._process is not None and self._process.poll() is None:
            return self._end
        self.close()
        self._end, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            number = theirs.fileno()
            self._process = Child(PREFORKED, str(number), pass_fds=(number,))
        return self._end


@contextmanager
def loaded() -> Iterator[Loaded]:
    """One as long as it is needed."""
    made = Loaded()
    try:
        yield made
    finally:
        made.close()


@dataclass
class _Forked:
    """The process of one job."""

    pid: int
    stdout: IO[bytes] | None
    end: socket.socket
    status: int | None = None

    def wait(self) -> int:
        """As `Worked` says. Its number is not given to another before that."""
        if self.status is None:
            try:
                self.status = _received(self.end)
                self.end.send(REAP)
            except OSError:
                self.status = -signal.SIGKILL
        return self.status


def _received(end: socket.socket) -> int:
    got = end.recv(NUMBER.size)
    if len(got) != NUMBER.size:
        raise ConnectionResetError("it ended")
    return int(NUMBER.unpack(got)[0])


def main() -> None:
    """Fork for one job after the other."""
    from elfslam.serve.jobs import work

    end = socket.socket(fileno=int(sys.argv[1]))
    with suppress(OSError, ElfslamError):  # without it jobs are as good, and slower
        warm_up()
    gc.freeze()  # what is loaded stays shared between the processes
    while True:
        told, files, _, _ = socket.recv_fds(end, MOST_BYTES, FILES)
        if not told:
            return
        pid = os.fork()
        if pid == 0:
            end.close()
            _work(work.work_on, Path(told.decode()), files)
        for file in files:
            os.close(file)
        with suppress(OSError):
            os.setpgid(pid, pid)  # whoever is told the number may kill its group at once
        end.send(NUMBER.pack(pid))
        _end(end, pid)


def warm_up() -> None:
    """Map a short walk: kernels and what draws are loaded when first used.

    It is one without sound, whose mapping begins no threads: a fork would not have them.
    """
    from elfslam.world.simulate import load_world, simulate

    walk, _ = simulate(load_world(WORLD), SEED, rounds=1, sound=False)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_recording(walk, folder / "walk")
        job = MapJob((), None, "spectral", Settings(), overwrite=False)
        map_into(folder / "run", folder / "walk", job, lambda what, share: None)


def _end(end: socket.socket, pid: int) -> None:
    """Say how a process ended; its number is free once that was heard."""
    told = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    assert told is not None
    code = told.si_status if told.si_code == os.CLD_EXITED else -told.si_status
    with suppress(BrokenPipeError):
        end.send(NUMBER.pack(code))
        end.recv(len(REAP))
    os.waitpid(pid, 0)


def _work(work_on: object, folder: Path, files: list[int]) -> None:
    """Be the process of a job; never returns."""
    code = 1
    try:
        os.setpgid(0, 0)
        for number, file in enumerate(files[:3]):
            os.dup2(file, number)
            os.close(file)
        end_with_parent(STDIN)
        assert callable(work_on)
        work_on(folder)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(OSError):
            sys.stderr.flush()
        os._exit(code)
