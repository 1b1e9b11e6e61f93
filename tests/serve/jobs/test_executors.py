"""Where jobs are done: the same map everywhere, kills noticed, nothing left behind."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.app.workers import WorkerDiedError
from elfslam.serve.jobs.executors import (
    GIVEN,
    LOG,
    OUT,
    SCRATCH,
    TASK,
    Executor,
    Made,
    Parcel,
    Progress,
    Result,
    open_executor,
    packed,
    unpack,
    work_on_parcel,
)
from elfslam.serve.store.blobs import link_into, put_folder
from tests.waiting import until

pytestmark = pytest.mark.real

DATED = {"run.json", "timings.json", "report.html"}
LONG_S = 600.0
AS_THE_COMMAND = MapJob((), None, "compact", Settings(), overwrite=False)
Laid = Callable[[str], Path]


@pytest.fixture(scope="module", params=[None, "2", "ray"])
def place(request: pytest.FixtureRequest) -> Iterator[Executor]:
    if request.param == "ray":
        pytest.importorskip("ray", reason="Ray is not installed")
    with open_executor(request.param, 1) as opened:
        yield opened


@pytest.fixture
def laid(tmp_path: Path, walks: Path) -> Laid:
    """The folder of a job that maps a walk, as the server lays it out."""

    def lay(name: str) -> Path:
        folder, blobs = tmp_path / f"job-{name}", tmp_path / "blobs"
        blobs.mkdir(exist_ok=True)
        named = {file: blob.sha256 for file, blob in put_folder(blobs, walks / name).items()}
        link_into(folder / GIVEN / name, blobs, named)
        task = {"kind": "map", "recording": name, "by": [], "start_pose": None}
        limits = {"limits": {"bytes": 8 * 2**30}}
        (folder / TASK).write_text(json.dumps({**task, **limits}))
        return folder

    return lay


@pytest.fixture
def lock(tmp_path: Path) -> Iterator[int]:
    with (tmp_path / "lock").open("w") as file:
        yield file.fileno()


def workers_of(where: str) -> list[int]:
    """The processes that have a folder open that begins so."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            files = [os.readlink(file) for file in (entry / "fd").iterdir()]
        except OSError:
            continue
        if any(file.startswith(where) and file.endswith(LOG) for file in files):
            found.append(int(entry.name))
    return found


def last_of(events: Iterable[Progress | Result]) -> Result:
    """What comes of work, when it has ended."""
    *_, last = events
    assert isinstance(last, Result)
    return last


def scratch() -> str:
    return str(Path(tempfile.gettempdir()) / SCRATCH)


def test_the_map_is_the_same_wherever_it_is_made(
    place: Executor, laid: Laid, lock: int, walks: Path, tmp_path: Path
) -> None:
    folder = laid("mute")
    said = list(place.work(folder, LONG_S, lock))
    assert isinstance(said[-1], Result)
    assert not any(isinstance(each, Result) for each in said[:-1])
    assert said[-1].facts is not None
    assert said[-1].facts["status"] == "NO_CLOSURES"
    map_into(tmp_path / "theirs", walks / "mute", AS_THE_COMMAND, lambda what, share: None)
    names = {file.name for file in (tmp_path / "theirs").iterdir()}
    assert {file.name for file in (folder / OUT).iterdir()} == names
    for name in names - DATED:
        assert (folder / OUT / name).read_bytes() == (tmp_path / "theirs" / name).read_bytes()


def test_what_is_being_done_is_heard_and_whoever_closes_ends_it(
    place: Executor, laid: Laid, lock: int, tmp_path: Path
) -> None:
    with closing(place.work(laid("one"), LONG_S, lock)) as events:  # type: ignore[type-var]
        stages = (each.doing for each in events if isinstance(each, Progress))
        assert next(stages) in ("motion", "echoes", "step length", "features")
        assert workers_of(str(tmp_path)) or workers_of(scratch())
    until(lambda: not workers_of(str(tmp_path)) + workers_of(scratch()), "the end of who works")
    assert not list(Path(tempfile.gettempdir()).glob(f"{SCRATCH}*"))


def test_a_killed_process_is_noticed_and_the_next_job_is_done(
    place: Executor, laid: Laid, lock: int, tmp_path: Path
) -> None:
    folder = laid("one")
    with closing(place.work(folder, LONG_S, lock)) as events:  # type: ignore[type-var]
        assert any(isinstance(each, Progress) and each.doing for each in events)
        for process in workers_of(str(tmp_path)) or workers_of(scratch()):
            if process not in (os.getpid(), os.getppid()):
                os.kill(process, signal.SIGKILL)
        last = last_of(events)
    assert last.died
    assert "it was killed" in str(last.problem)
    done = last_of(place.work(laid("mute"), LONG_S, lock))
    assert (done.problem, done.died) == (None, False)


def test_what_takes_too_long_is_stopped(place: Executor, laid: Laid, lock: int) -> None:
    last = last_of(place.work(laid("one"), 0.01, lock))
    assert "took longer than" in str(last.problem)
    assert not last.died


@pytest.mark.parametrize("place", ["ray"], indirect=True)
def test_a_killed_node_process_is_noticed(place: Executor, laid: Laid, lock: int) -> None:
    """The work ends with it, and the scratch that it left is swept away by the next."""
    folder = laid("one")
    with closing(place.work(folder, LONG_S, lock)) as events:  # type: ignore[type-var]
        assert any(isinstance(each, Progress) and each.doing for each in events)
        [work] = workers_of(scratch())
        os.kill(parent_of(parent_of(work)), signal.SIGKILL)
        with pytest.raises(WorkerDiedError, match="do it again"):
            list(events)
    until(lambda: not workers_of(scratch()), "the end of who works")
    done = last_of(place.work(laid("mute"), LONG_S, lock))
    assert done.problem is None
    assert not list(Path(tempfile.gettempdir()).glob(f"{SCRATCH}*"))


def parent_of(process: int) -> int:
    status = Path(f"/proc/{process}/status").read_text()
    return int(status.partition("PPid:")[2].split()[0])


def test_a_parcel_brings_what_it_took(tmp_path: Path, laid: Laid) -> None:
    folder = laid("mute")
    files = packed(folder, (TASK, GIVEN))
    assert f"{GIVEN}/mute/recording.json" in files
    unpack(files, tmp_path / "there")
    assert packed(tmp_path / "there", (TASK, GIVEN)) == files
    with pytest.raises(ValueError, match="leads out"):
        unpack({"../mine": b""}, tmp_path / "there")
    assert not (tmp_path / "mine").exists()
    made = list(work_on_parcel(Parcel(files, LONG_S)))[-1]
    assert isinstance(made, Made)
    assert f"{OUT}/run.json" in made.files


SERVER = """
import sys
from pathlib import Path
from elfslam.serve.jobs.executors import begin_anew
from elfslam.serve.jobs.executors import Loaded
folder, begin = Path(sys.argv[1]), {begin}
with (folder / "log").open("wb") as log, begin(folder, log, log.fileno()) as process:
    print(process.wait())
"""


def descendants(parent: str) -> list[str]:
    threads = Path(f"/proc/{parent}/task").glob("*/children")
    children = [child for file in threads for child in file.read_text().split()]
    return [*children, *(each for child in children for each in descendants(child))]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM], ids=["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize(("begin", "count"), [("begin_anew", 1), ("Loaded().begin", 2)])
def test_who_works_on_a_job_ends_with_the_server(
    begin: str, count: int, number: signal.Signals, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / TASK)  # nobody writes there: the work waits for its task
    with subprocess.Popen([sys.executable, "-c", SERVER.format(begin=begin), tmp_path]) as server:
        until(lambda: len(descendants(str(server.pid))) == count, "who works")
        began = descendants(str(server.pid))
        server.send_signal(number)
    until(lambda: not [each for each in began if Path(f"/proc/{each}").exists()], "their end")
