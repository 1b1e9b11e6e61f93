"""A server killed without warning, again and again, while phones upload, delete and wait for maps.

Usage, from the root of the project:

    python -m studies.benchmarks.killed_server \\
        [--kills 200] [--database sqlite] [--seed 0] [--phones 3]

Each kill (SIGKILL) falls into a random moment: while the server starts, while pieces come, while
jobs run or what was made is kept. Phones go on where they were as soon as it is back. At the end
everything is finished and compared: every acknowledged byte, every recording, every map with that
of `elfslam map` on an undisturbed machine, and what was deleted must stay deleted.
"""

from __future__ import annotations

import argparse
import io
import random
import subprocess
import tempfile
import threading
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import httpx

from elfslam.app.console import print_rows, say
from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.data.recordings import write_recording
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.own_postgresql import own_postgresql
from studies.benchmarks.served import PIECE, TUS, command, free_port, metadata

WORLD, SEED = "studio", 40
WALKS = 3
"""The first has sound, the others only motion."""
DATED = {"run.json", "timings.json", "report.html"}
PIECE_BYTES = 60_000
DELETED_SHARE = 0.3
STARTING_SHARE, LONGEST_S = 0.25, 4.0
"""Kills while the server starts, and the longest life of one that answered."""
PATIENCE_S = 900.0
OFTEN = {"token_requests_per_s": 1000, "address_requests_per_s": 1000}


@dataclass
class Ledger:
    """What phones were told, by all of them."""

    counts: Counter[str] = field(default_factory=Counter)
    recordings: dict[str, int] = field(default_factory=dict)
    """The walk of each recording that must be there."""
    deleted: list[str] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def count(self, what: str, number: int = 1) -> None:
        """Add to a count."""
        with self.lock:
            self.counts[what] += number


@dataclass
class Server:
    """A data folder that is served, killed, and served again."""

    folder: Path
    database: str
    port: int
    log: Path

    @property
    def url(self) -> str:
        """Of the server."""
        return f"http://127.0.0.1:{self.port}"

    def begin(self) -> subprocess.Popen[bytes]:
        """A process of it."""
        with self.log.open("ab") as log:
            how: dict[str, Any] = {
                "jobs": True,
                "database": self.database,
                "port": self.port,
                "limits": OFTEN,
            }
            return subprocess.Popen(
                command(self.folder, **how), stdout=subprocess.DEVNULL, stderr=log
            )

    def answers(self) -> bool:
        """Whether it can be asked."""
        try:
            return httpx.get(f"{self.url}/api/version", timeout=5).is_success
        except httpx.TransportError:
            return False

    def client(self) -> httpx.Client:
        """Of the owner."""
        token = (self.folder / "authority" / "owner.token").read_text().strip()
        return httpx.Client(
            base_url=self.url, headers={"Authorization": f"Bearer {token}"}, timeout=30
        )


def main() -> None:
    """Print what became of everything that was acknowledged."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--database", choices=("sqlite", "postgresql"), default="sqlite")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--phones", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, _database(asked.database) as url:
        folder = Path(name)
        walks = [made_walk(folder / f"walk{number}", number) for number in range(WALKS)]
        server = Server(folder / "data", url, free_port(), folder / "server.log")
        row = disturbed(server, walks, asked)
        said = server.log.read_text()
        row["tracebacks in the log"] = said.count("Traceback")
        print_rows([{"what": what, "value": value} for what, value in row.items()],
                   title=f"{asked.kills} kills, {asked.database}", as_json=False)  # fmt: skip
        if row["tracebacks in the log"]:
            say(said[-4000:])


@contextmanager
def _database(kind: str) -> Iterator[str]:
    with own_postgresql() if kind == "postgresql" else nullcontext() as running:
        yield "" if running is None else running.url


@dataclass(frozen=True)
class SentWalk:
    """A recording as it is uploaded, and the files of its map."""

    packed: bytes
    files: dict[str, bytes]
    mapped: dict[str, bytes]


def made_walk(folder: Path, number: int) -> SentWalk:
    """Simulate a walk and map it undisturbed."""
    recording, _ = simulate(load_world(WORLD), SEED + number, rounds=2, sound=number == 0)
    write_recording(recording, folder)
    job = MapJob((), None, "compact", Settings(), overwrite=False)
    run = folder.with_name(f"{folder.name}-run")
    map_into(run, folder, job, lambda what, share: None)
    files = {file.name: file.read_bytes() for file in folder.iterdir()}
    mapped = {file.name: file.read_bytes() for file in run.iterdir() if file.name not in DATED}
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return SentWalk(made.getvalue(), files, mapped)


def disturbed(
    server: Server, walks: list[SentWalk], asked: argparse.Namespace
) -> dict[str, object]:
    """Kill a server so many times while phones use it, and then look at everything."""
    generator, ledger, stop = random.Random(asked.seed), Ledger(), threading.Event()
    phones = [
        threading.Thread(target=phone, args=(server, walks, ledger, stop, asked.seed + number))
        for number in range(asked.phones)
    ]
    phases: Counter[str] = Counter()
    for kill in range(asked.kills):
        process = server.begin()
        if kill and generator.random() < STARTING_SHARE:
            time.sleep(generator.uniform(0, 2.5))
            phases["starting"] += 1
        else:
            until(server.answers)
            if not kill:
                for each in phones:
                    each.start()
            time.sleep(generator.uniform(0, LONGEST_S))
            phases["answering"] += 1
        process.kill()
        process.wait()
        if kill % 20 == 19:
            say(f"{kill + 1} kills, {dict(ledger.counts)}")
    process = server.begin()
    until(server.answers)
    stop.set()
    for each in phones:
        each.join()
    try:
        return {**{f"kills while {k}": n for k, n in phases.items()}, **ledger.counts,
                **judged(server, walks, ledger)}  # fmt: skip
    finally:
        process.terminate()
        process.wait()


def until(true: Callable[[], bool]) -> None:
    """Wait for something. Raises SystemExit where it does not come."""
    until_s = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > until_s:
            raise SystemExit("waited in vain")
        time.sleep(0.05)


def patiently(act: Callable[[], httpx.Response]) -> httpx.Response:
    """An answer that is no excuse, however often the server is killed meanwhile."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        try:
            answer = act()
        except httpx.TransportError:
            time.sleep(0.1)
            continue
        if answer.status_code not in (423, 429, 503):
            return answer
        time.sleep(0.2)
    raise SystemExit("the server does not come back")


def phone(
    server: Server, walks: list[SentWalk], ledger: Ledger, stop: threading.Event, seed: int
) -> None:
    """Upload one walk after the other, and delete some."""
    generator = random.Random(1000 + seed)
    with server.client() as client:
        while not stop.is_set():
            number = generator.randrange(len(walks))
            recording = uploaded(client, walks[number].packed, ledger)
            if generator.random() < DELETED_SHARE:
                answer = patiently(partial(client.delete, f"/api/recordings/{recording}"))
                if answer.status_code not in (204, 404):
                    ledger.count(f"answer {answer.status_code}")
                ledger.deleted.append(recording)
                ledger.count("recordings deleted")
            else:
                ledger.recordings[recording] = number
            time.sleep(generator.uniform(0.5, 3.0))


def uploaded(client: httpx.Client, content: bytes, ledger: Ledger) -> str:
    """Send a walk in pieces, from where the server says; the recording that came of it."""
    told = {**TUS, "Upload-Metadata": metadata(filename="walk.zip")}
    told["Upload-Length"] = str(len(content))
    place = patiently(lambda: client.post("/api/uploads", headers=told)).headers["location"]
    acknowledged = 0
    while True:
        head = patiently(lambda: client.head(place, headers=TUS))
        if head.status_code != 200:
            ledger.count(f"uploads lost ({head.status_code})")
            return ""
        offset = int(head.headers["upload-offset"])
        ledger.count("acknowledged bytes lost", max(0, acknowledged - offset))
        if "elfslam-recording" in head.headers:
            ledger.count("recordings made")
            return str(head.headers["elfslam-recording"])
        acknowledged = sent(client, place, content, offset, ledger)


def sent(client: httpx.Client, place: str, content: bytes, offset: int, ledger: Ledger) -> int:
    """Send pieces until the server is gone or all has come; how much it acknowledged in all."""
    while offset < len(content):
        piece = content[offset : offset + PIECE_BYTES]
        headers = {**PIECE, "Upload-Offset": str(offset)}
        try:
            answer = client.patch(place, headers=headers, content=piece)
        except httpx.TransportError:
            return offset
        if answer.status_code != 204:
            if answer.status_code >= 500 and answer.status_code != 503:
                ledger.count(f"answer {answer.status_code}")
            return offset
        offset = int(answer.headers["upload-offset"])
        ledger.count("acknowledged pieces")
    return offset


def judged(server: Server, walks: list[SentWalk], ledger: Ledger) -> dict[str, object]:
    """What is there at the end, when all jobs have ended."""
    with server.client() as client:
        until(lambda: not any(job["state"] in ("queued", "running") for job in jobs_of(client)))
        jobs = jobs_of(client)
        states = Counter(job["state"] for job in jobs)
        maps = {job["given"]["recording"]: job["gave"].get("map") for job in jobs}
        differing, equal, absent = 0, 0, 0
        for recording, number in ledger.recordings.items():
            kept = client.get(f"/api/recordings/{recording}/recording.zip")
            absent += not kept.is_success or unpacked(kept.content) != walks[number].files
            found = client.get(f"/api/maps/{maps.get(recording)}/map.zip")
            content = unpacked(found.content) if found.is_success else {}
            same = {k: v for k, v in content.items() if k not in DATED} == walks[number].mapped
            equal, differing = equal + same, differing + (not same)
        back = sum(client.get(f"/api/recordings/{each}").status_code != 404
                   for each in ledger.deleted)  # fmt: skip
    return {
        "acknowledged bytes lost": ledger.counts["acknowledged bytes lost"],
        "recordings kept": len(ledger.recordings),
        "recordings lost or changed": absent,
        "deleted and back": back,
        **{f"jobs {state}": count for state, count in states.items()},
        "maps equal to the last byte": equal,
        "maps missing or different": differing,
        "left in work/": len(list((server.folder / "work").iterdir())),
        "set aside": len(list((server.folder / "quarantine").iterdir())),
    }


def jobs_of(client: httpx.Client) -> list[dict[str, Any]]:
    """All jobs."""
    answer = client.get("/api/jobs")
    return list(answer.json()) if answer.is_success else [{"state": "queued"}]


def unpacked(content: bytes) -> dict[str, bytes]:
    """The files of a .zip by their names without folders."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {Path(name).name: archive.read(name) for name in archive.namelist()}


if __name__ == "__main__":
    main()
