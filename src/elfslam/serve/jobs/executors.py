"""Where jobs are done: in processes of this machine, watched, or on a cluster.

On a cluster a job's folder travels as bytes, is filled there, and what was made comes back: nodes
need no folder in common. The work there is a process of its own with the same limits.
"""

from __future__ import annotations

import fcntl
import gc
import json
import os
import selectors
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any, Protocol

from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.app.workers import Watchers, is_ray, open_watchers
from elfslam.app.workers.child import STDIN, Child, end_children, end_with_parent
from elfslam.base.errors import ElfslamError
from elfslam.base.values import silent
from elfslam.data.recordings import write_recording
from elfslam.serve.store.blobs import place_in

TASK, GIVEN, OUT = "task.json", "given", "out"
FIXES = "fixes.csv"
DISK_FULL = "the server's disk is full; free some space there, then retry"
"""What a process says that could not write."""
LOG = "log.txt"
MOST_ATTEMPTS = 3
"""So often a job is begun whose own process died."""
PATIENCE_S = 0.3
"""How soon a cancel is noticed."""
READ_BYTES = 65_536
WORK = "elfslam.serve.jobs.work"
DIED = "the work ended in the middle ({why}); retry it, and look into the server's log if it recurs"
OVERDUE = "the work took longer than {hours:g} h and was stopped; cut the recording up"


@dataclass(frozen=True)
class Progress:
    """What is being done, and how much of it is."""

    doing: str
    share: float | None


@dataclass(frozen=True)
class Result:
    """What came of the work: facts where something was made, the problem where something failed.

    `died`: its process did, in the middle.
    """

    facts: dict[str, Any] | None
    problem: str | None = None
    died: bool = False


Events = Iterator[Progress | Result | None]
"""What comes of a job, its result at last: lines of JSON of its process. Nothing, every while."""


class Worked(Protocol):
    """A process that does a job's work, and is ended with the block."""

    @property
    def stdout(self) -> IO[bytes] | None:
        """Where it says what it does."""

    def wait(self) -> int:
        """Its exit status, once it has ended; -N where signal N ended it."""


Begin = Callable[[Path, IO[bytes], int], AbstractContextManager[Worked]]
"""Begins the work in a folder, given the file for what libraries print and the lock it keeps."""


def begin_anew(folder: Path, log: IO[bytes], lock: int) -> Child:
    """A new interpreter for the work in a folder."""
    return Child(WORK, str(folder), stdout=subprocess.PIPE, stderr=log, pass_fds=(lock,))


def work_apart(folder: Path, longest_s: float, lock: int, begin: Begin = begin_anew) -> Events:
    """Do the task of a folder in a process of its own, which whoever closes this ends.

    That keeps the file `lock` open: it is free again when whoever began it and the process both are
    gone.
    """
    with ExitStack() as stack:
        with (folder / LOG).open("wb") as log:
            process = stack.enter_context(begin(folder, log, lock))
        began_s = time.monotonic()
        for event in _events(process):
            yield event
            if isinstance(event, Result):
                return
            if time.monotonic() - began_s > longest_s:
                yield Result(None, OVERDUE.format(hours=longest_s / 3600))
                return
        yield Result(None, DIED.format(why=_why(process.wait())), died=True)


def _events(process: Worked) -> Events:
    """The latest of a process every while, nothing where none came, and its result at once."""
    assert process.stdout is not None
    pipe, rest = process.stdout.fileno(), b""
    latest, due_s = None, time.monotonic()
    with selectors.DefaultSelector() as ready:
        ready.register(pipe, selectors.EVENT_READ)
        while True:
            if ready.select(PATIENCE_S):
                came = os.read(pipe, READ_BYTES)
                if not came:
                    return
                *lines, rest = (rest + came).split(b"\n")
                latest = _read(lines[-1]) if lines else latest
            if isinstance(latest, Result) or time.monotonic() >= due_s:
                yield latest
                latest, due_s = None, time.monotonic() + PATIENCE_S


def _read(line: bytes) -> Progress | Result:
    """A line of JSON; numbers that are none are nothing, for neither browsers nor SQL know them."""
    read = json.loads(line, parse_constant=lambda name: None)
    return Result(**read) if "problem" in read else Progress(**read)


def _why(code: int) -> str:
    """An exit status in words."""
    if code == -signal.SIGKILL:
        return "it was killed, perhaps for want of memory"
    if code < 0:
        return f"signal {-code}"
    return f"exit status {code}"


SCRATCH, NEW, LOCK = "elfslam-job-", "elfslam-new-", "lock"
Files = Mapping[str, bytes]
"""Contents by path within a folder."""


@dataclass(frozen=True)
class Parcel:
    """A job's folder on its way, and how long the work may take."""

    files: Files
    longest_s: float


@dataclass(frozen=True)
class Made:
    """What came of a job, and the files that it left."""

    result: Result
    files: Files


def work_remotely(workers: Watchers, folder: Path, longest_s: float, lock: int) -> Events:
    """Do the task of a folder on a cluster, and leave there what was made, as `work_apart` does.

    `lock` stays here: whoever works elsewhere for a server that is gone can keep nothing.
    """
    parcel = Parcel(packed(folder, (TASK, GIVEN)), longest_s)
    with closing(workers.watch(work_on_parcel, parcel)) as events:  # type: ignore[type-var]
        for event in events:
            if isinstance(event, Made):
                unpack(event.files, folder)
                yield event.result
                return
            yield event


def work_on_parcel(parcel: Parcel) -> Iterator[Progress | Made | None]:
    """Unpack a job's folder here, do its task, and give what was made."""
    with _scratch() as (folder, lock):
        unpack(parcel.files, folder)
        events = work_apart(folder, parcel.longest_s, lock, _loaded().begin)
        with closing(events):  # type: ignore[type-var]
            for event in events:
                if isinstance(event, Result):
                    yield Made(event, packed(folder, (OUT, LOG)))
                else:
                    yield event


def packed(folder: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    """The files of these names and in the folders of these names, where there are any."""
    found = [
        file for name in names for file in [folder / name, *sorted((folder / name).rglob("*"))]
    ]
    return {
        file.relative_to(folder).as_posix(): file.read_bytes() for file in found if file.is_file()
    }


def unpack(files: Files, folder: Path) -> None:
    """Write files into a folder. Raises ValueError for a name that leads out of it, OSError."""
    for name, content in files.items():
        place_in(folder, name).write_bytes(content)


@cache
def _loaded() -> Loaded:
    """Of this process, which works on one job at a time; it ends with it."""
    return Loaded()


@contextmanager
def _scratch() -> Iterator[tuple[Path, int]]:
    """A folder for one job, and the lock that says that somebody works there.

    What was left by those who were killed is removed.
    """
    for left in Path(tempfile.gettempdir()).glob(f"{SCRATCH}*"):
        _remove_left(left)
    new = Path(tempfile.mkdtemp(prefix=NEW))
    folder = new.with_name(new.name.replace(NEW, SCRATCH, 1))
    try:
        with (new / LOCK).open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            new.rename(folder)
            yield folder, lock.fileno()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _remove_left(folder: Path) -> None:
    with suppress(OSError):
        lock = os.open(folder / LOCK, os.O_RDWR)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)


@dataclass(frozen=True)
class Executor:
    """Where jobs are done, so many at once; one that kills its process is begun `tries` times.

    `work` does the task of a folder, as `work_apart` does, and leaves there what was made.
    """

    count: int
    tries: int
    work: Callable[[Path, float, int], Events]


@contextmanager
def open_executor(on: str | None, count: int) -> Iterator[Executor]:
    """The place that `on` means, or else a new process of this machine for each job.

    Raises InputError where that is nobody, or a cluster that does not answer.
    """
    if on is None:
        yield Executor(count, 1, work_apart)
    elif is_ray(on):
        with open_watchers(on) as cluster:
            yield Executor(cluster.count, MOST_ATTEMPTS, partial(work_remotely, cluster))
    else:
        with ExitStack() as stack:
            ready: SimpleQueue[Begin] = SimpleQueue()
            for _ in range(int(on)):
                ready.put(stack.enter_context(closing(Loaded())).begin)
            yield Executor(int(on), MOST_ATTEMPTS, partial(_by_the_next, ready))


def _by_the_next(ready: SimpleQueue[Begin], folder: Path, longest_s: float, lock: int) -> Events:
    """By one that is idle: there are as many as may work at once."""
    begin = ready.get()
    try:
        yield from work_apart(folder, longest_s, lock, begin)
    finally:
        ready.put(begin)


# --- a process with everything loaded that forks for each job ---
#
# It is given the number of a socket, as `workers.child` runs it, and reads files and a folder from
# there. It begins the work in a fork of itself, says the number of that process and, once it has
# ended, how. It works on one job at a time.

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
            self._process = Child(__name__, str(number), pass_fds=(number,))
        return self._end


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
        map_into(folder / "run", folder / "walk", job, silent)


def _end(end: socket.socket, pid: int) -> None:
    """Say how a process ended; its number is free once that was heard."""
    told = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    assert told is not None
    code = told.si_status if told.si_code == os.CLD_EXITED else -told.si_status
    with suppress(BrokenPipeError):
        end.send(NUMBER.pack(code))
        end.recv(len(REAP))
    os.waitpid(pid, 0)


def _work(work_on: Callable[[Path], None], folder: Path, files: list[int]) -> None:
    """Be the process of a job; never returns."""
    code = 1
    try:
        os.setpgid(0, 0)
        for number, file in enumerate(files[:3]):
            os.dup2(file, number)
            os.close(file)
        end_with_parent(STDIN)
        work_on(folder)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(OSError):
            sys.stderr.flush()
        os._exit(code)
