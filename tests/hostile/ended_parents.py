"""Commands that have others work for them, ended at random moments: who goes on without them?

Usage, from the root of the project:

    python -m tests.hostile.ended_parents [--times 50] [--seed 0] [--only map]

`elfslam map --on 2`, `python -m studies --on 2` and `elfslam serve --on 2` with jobs, and each so
many times by SIGTERM, SIGKILL and SIGINT. Whatever they began bears a mark in its environment.
"""

from __future__ import annotations

import argparse
import io
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from elfslam.app.console import print_rows, say
from elfslam.data.recordings import write_recording
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.served import COMMAND as SERVE
from studies.benchmarks.served import PIECE, free_port, metadata

MARK = "ELFSLAM_DRILL"
MAP = (*SERVE[:3], "map")
STUDY = (sys.executable, "-m", "studies", "mapping")
SIGNALS = (signal.SIGTERM, signal.SIGKILL, signal.SIGINT)
WALKS, JOBS = 4, 2
GRACE_S = 1.0
"""Whoever is there later than this after the parent is left."""
PATIENCE_S = 60.0
STARTING_SHARE, STARTING_S = 0.2, 3.0
"""Some are ended while they start."""


@dataclass
class Drill:
    """A command, begun anew each time, and what it leaves of its work."""

    name: str
    begin: Callable[[dict[str, str]], subprocess.Popen[bytes]]
    latest_s: float
    """The last moment at which it is ended, after it has begun others."""
    unfinished: Callable[[], list[Path]]
    counts: dict[signal.Signals, Counter[str]] = field(default_factory=dict)

    def once(self, number: signal.Signals, generator: random.Random) -> None:
        """Begin it, end it, and count who and what is left."""
        mark = uuid.uuid4().hex
        parent = self.begin({**os.environ, MARK: mark})
        if generator.random() < STARTING_SHARE:
            time.sleep(generator.uniform(0, STARTING_S))
        else:
            wait_for_children(mark, parent)
            time.sleep(generator.uniform(0, self.latest_s))
        found = self.counts.setdefault(number, Counter())
        found["times"] += 1
        found["with children"] += len(marked(mark)) > 1
        parent.send_signal(number)
        try:
            parent.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            found["parents that stay"] += 1
        left = left_after(mark, GRACE_S)
        found["processes left"] += len(left)
        if number != signal.SIGKILL:
            found["half-written"] += len(self.unfinished())
        for each in left:
            with suppress(ProcessLookupError):
                os.kill(each, signal.SIGKILL)
        parent.wait()

    def rows(self) -> Iterator[dict[str, object]]:
        """Of the table."""
        columns = ("times", "with children", "parents that stay", "processes left", "half-written")
        for number, found in self.counts.items():
            yield {"command": self.name, "ended by": number.name,
                   **{name: found[name] for name in columns}}  # fmt: skip


def main() -> None:
    """Print who and what was left."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--only", default="", help="drills whose names begin so: map, studies, serve"
    )
    asked = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
    generator = random.Random(asked.seed)
    with tempfile.TemporaryDirectory() as name:
        drills = [make(Path(name)) for make in (mapping, studying, serving)]
        drills = [drill for drill in drills if drill.name.startswith(asked.only)]
        for drill in drills:
            for number in SIGNALS:
                for _ in range(asked.times):
                    drill.once(number, generator)
                say(f"{drill.name}, {number.name}: {dict(drill.counts[number])}")
    rows = [row for drill in drills for row in drill.rows()]
    print_rows(rows, title=f"Ended at {asked.times} random moments each", as_json=False)


def marked(mark: str) -> list[int]:
    """The processes that bear a mark, whoever their parent is by now."""
    wanted, found = f"{MARK}={mark}".encode(), []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if wanted in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
    return found


def wait_for_children(mark: str, parent: subprocess.Popen[bytes]) -> None:
    """Until somebody else bears a mark, or nobody will."""
    until_s = time.monotonic() + PATIENCE_S
    while len(marked(mark)) < 2 and parent.poll() is None and time.monotonic() < until_s:
        time.sleep(0.01)


def left_after(mark: str, grace_s: float) -> list[int]:
    """Who bears a mark still, after a while."""
    until_s = time.monotonic() + grace_s
    while (left := marked(mark)) and time.monotonic() < until_s:
        time.sleep(0.05)
    return left


def begun(command: list[str], environment: dict[str, str]) -> subprocess.Popen[bytes]:
    """A command in a session of its own, in silence."""
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        command, env=environment, start_new_session=True, stdin=quiet, stdout=quiet, stderr=quiet
    )


def mapping(folder: Path) -> Drill:
    """`elfslam map WALKS OUT --on 2`, each time from the beginning."""
    walks, out = folder / "walks", folder / "runs"
    for number in range(WALKS):
        recording, _ = simulate(load_world("studio"), 100 + number, rounds=2, sound=True)
        write_recording(recording, walks / str(number))

    def begin(environment: dict[str, str]) -> subprocess.Popen[bytes]:
        shutil.rmtree(out, ignore_errors=True)
        return begun([*MAP, str(walks), str(out), "--on", "2"], environment)

    def unfinished() -> list[Path]:
        runs = list(out.iterdir()) if out.is_dir() else []
        return [run for run in runs if not (run / "run.json").is_file()]

    return Drill("map --on 2", begin, 6.0, unfinished)


def studying(folder: Path) -> Drill:
    """A study that takes far longer than it is given."""
    out = folder / "studied"

    def begin(environment: dict[str, str]) -> subprocess.Popen[bytes]:
        return begun([*STUDY, "--out", str(out), "--on", "2"], environment)

    return Drill("studies --on 2", begin, 8.0, lambda: list(out.rglob(".*")))


def serving(folder: Path) -> Drill:
    """A server of two workers that is given jobs before it is ended."""
    data, port, packed = folder / "data", free_port(), io.BytesIO()
    command = [*SERVE, "--port", str(port), "--data", str(data), "--on", "2"]
    with zipfile.ZipFile(packed, "w") as archive:
        for file in (folder / "walks" / "0").iterdir():
            archive.write(file, file.name)
    recordings: list[str] = []

    def begin(environment: dict[str, str]) -> subprocess.Popen[bytes]:
        server = begun(command, environment)
        with client_of(data, port) as client:
            if not recordings:
                recordings.append(uploaded(client, packed.getvalue()))
            for _ in range(JOBS):
                client.post("/api/jobs", json={"kind": "map", "recording": recordings[0]})
        return server

    return Drill("serve --on 2", begin, 8.0, lambda: list((data / "work").iterdir()))


def uploaded(client: httpx.Client, content: bytes) -> str:
    """Send a walk at once; the recording that came of it."""
    told = {"Upload-Metadata": metadata(filename="walk.zip"), "Upload-Length": str(len(content))}
    answer = client.post("/api/uploads", headers={**PIECE, **told}, content=content)
    place = answer.raise_for_status().headers["location"]
    return str(client.head(place, headers=PIECE).headers["elfslam-recording"])


def client_of(data: Path, port: int) -> httpx.Client:
    """The owner's client of a server, once that answers. Raises SystemExit where it does not."""
    url, until_s = f"http://127.0.0.1:{port}", time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        with suppress(httpx.TransportError):
            httpx.get(f"{url}/api/version", timeout=PATIENCE_S)
            token = (data / "authority" / "owner.token").read_text().strip()
            bearer = {"Authorization": f"Bearer {token}"}
            return httpx.Client(base_url=url, headers=bearer, timeout=PATIENCE_S)
        time.sleep(0.05)
    raise SystemExit("the server does not start")


if __name__ == "__main__":
    main()
