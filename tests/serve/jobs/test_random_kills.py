"""A server killed without warning at random moments, while phones upload, delete and await maps.

`KILLS=200 pytest tests/serve/jobs/test_random_kills.py` kills it more often, and on PostgreSQL too.
Each SIGKILL falls while the server starts, receives, maps or keeps. Phones go on from where they
were. At the end every acknowledged byte, recording and map is compared with an undisturbed one.
"""

import os
import random
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest

from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.serve.jobs.work import STAGES
from studies.benchmarks.served import TUS, Served, command, free_port, start
from tests.serve.conftest import job_when
from tests.serve.uploading import append, created, recording_of, unzipped, zipped
from tests.waiting import until

pytestmark = pytest.mark.real

KILLS = int(os.environ.get("KILLS", "3"))
DATABASES = ("sqlite", "postgresql") if "KILLS" in os.environ else ("sqlite",)
WALKS = ("one", "mute")
"""The first has sound, the other only motion."""
PHONES, PIECE_BYTES = 2, 60_000
DELETED_SHARE = 0.3
STARTING_SHARE, STARTING_S, LONGEST_S = 0.25, 2.5, 4.0
"""Kills while the server starts, and the longest life of one that answered."""
PATIENCE_S = 600.0
BUSY = (423, 429, 503)
DATED = {"run.json", "timings.json", "report.html"}
OFTEN = {"token_requests_per_s": 1000, "address_requests_per_s": 1000}


@dataclass
class Ledger:
    """What phones were told, by all of them."""

    counts: Counter[str] = field(default_factory=Counter)
    kept: dict[str, str] = field(default_factory=dict)
    """The walk of each recording that must be there."""
    deleted: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Walk:
    """A recording as it is uploaded, its files, and those of its map that say no date."""

    packed: bytes
    files: dict[str, bytes]
    mapped: dict[str, bytes]


@dataclass
class Server:
    """A data folder that is served, killed, and served again at the same address."""

    folder: Path
    database: str
    port: int = field(default_factory=free_port)

    def begin(self) -> subprocess.Popen[bytes]:
        with (self.folder.parent / "server.log").open("ab") as log:
            words = command(
                self.folder, jobs=True, database=self.database, port=self.port, limits=OFTEN
            )
            return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=log)

    def answers(self) -> bool:
        try:
            url = f"http://127.0.0.1:{self.port}/api/version"
            return httpx.get(url, timeout=5).is_success
        except httpx.TransportError:
            return False

    def client(self) -> httpx.Client:
        token = (self.folder / "authority" / "owner.token").read_text().strip()
        bearer = {"Authorization": f"Bearer {token}"}
        return httpx.Client(base_url=f"http://127.0.0.1:{self.port}", headers=bearer, timeout=30)


@pytest.fixture(scope="module")
def sent(walks: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Walk]:
    """The walks that phones send, each mapped once by nobody who is killed."""
    made = {}
    for name in WALKS:
        run = tmp_path_factory.mktemp("undisturbed") / "run"
        job = MapJob((), None, "compact", Settings(), overwrite=False)
        map_into(run, walks / name, job, lambda what, share: None)
        content = zipped(walks / name)
        mapped = {file.name: file.read_bytes() for file in run.iterdir() if file.name not in DATED}
        made[name] = Walk(content, unzipped(content), mapped)
    return made


@pytest.mark.parametrize("database_url", DATABASES, indirect=True)
def test_nothing_acknowledged_is_lost(
    sent: dict[str, Walk], database_url: str, tmp_path: Path
) -> None:
    server, ledger, stop = Server(tmp_path / "data", database_url), Ledger(), threading.Event()
    generator = random.Random(1)
    phones = [
        threading.Thread(target=phone, args=(server, sent, ledger, stop, seed))
        for seed in range(PHONES)
    ]
    for kill in range(KILLS + 1):
        process = server.begin()
        if 0 < kill < KILLS and generator.random() < STARTING_SHARE:
            time.sleep(generator.uniform(0, STARTING_S))
        else:
            until(server.answers, "an answer", patience_s=PATIENCE_S)
            if not kill:
                for each in phones:
                    each.start()
            time.sleep(generator.uniform(0, LONGEST_S))
        if kill < KILLS:
            process.kill()
            process.wait()
    stop.set()
    for each in phones:
        each.join()
    try:
        check(server, sent, ledger)
    finally:
        process.terminate()
        process.wait()
    assert "Traceback" not in (tmp_path / "server.log").read_text()


def phone(
    server: Server, sent: dict[str, Walk], ledger: Ledger, stop: threading.Event, seed: int
) -> None:
    """Upload one walk after the other, and delete some."""
    generator = random.Random(1000 + seed)
    with server.client() as client:
        while not stop.is_set():
            name = generator.choice(WALKS)
            recording = uploaded(client, sent[name].packed, ledger)
            if generator.random() < DELETED_SHARE:
                answer = patiently(partial(client.delete, f"/api/recordings/{recording}"))
                ledger.counts[f"deleting: {answer.status_code}"] += 1
                ledger.deleted.append(recording)
            else:
                ledger.kept[recording] = name
            stop.wait(generator.uniform(0.5, 3.0))


def patiently(act: Callable[[], httpx.Response]) -> httpx.Response:
    """An answer that is no excuse, however often the server is killed meanwhile."""

    def answer() -> list[httpx.Response]:
        try:
            found = act()
        except httpx.TransportError:
            return []
        return [] if found.status_code in BUSY else [found]

    return until(answer, "an answer", patience_s=PATIENCE_S)[0]


def uploaded(client: httpx.Client, content: bytes, ledger: Ledger) -> str:
    """Send a walk in pieces, from where the server says; the recording that came of it."""
    begin = partial(created, client, len(content), filename="walk.zip")
    place = patiently(begin).headers["location"]
    acknowledged = 0
    while True:
        head = patiently(lambda: client.head(place, headers=TUS))
        assert head.status_code == 200, "an upload is lost"
        offset = int(head.headers["upload-offset"])
        ledger.counts["bytes lost"] += max(0, acknowledged - offset)
        if "elfslam-recording" in head.headers:
            return str(head.headers["elfslam-recording"])
        acknowledged = in_pieces(client, place, content, offset, ledger)


def in_pieces(client: httpx.Client, place: str, content: bytes, offset: int, ledger: Ledger) -> int:
    """Send pieces until the server is gone or all has come; how much it acknowledged in all."""
    while offset < len(content):
        try:
            answer = append(client, place, offset, content[offset : offset + PIECE_BYTES])
        except httpx.TransportError:
            return offset
        if answer.status_code != 204:
            ledger.counts["errors"] += answer.status_code >= 500 and answer.status_code != 503
            return offset
        offset = int(answer.headers["upload-offset"])
    return offset


def check(server: Server, sent: dict[str, Walk], ledger: Ledger) -> None:
    """All is there when all jobs have ended."""
    with server.client() as client:

        def jobs() -> list[dict[str, Any]]:
            return list(client.get("/api/jobs").raise_for_status().json())

        until(
            lambda: all(job["state"] not in ("queued", "running") for job in jobs()),
            "the end of all jobs", patience_s=PATIENCE_S,
        )  # fmt: skip
        maps = {job["given"]["recording"]: job["gave"].get("map") for job in jobs()}
        for recording, name in ledger.kept.items():
            content = client.get(f"/api/recordings/{recording}/recording.zip").content
            assert unzipped(content) == sent[name].files
            made = unzipped(client.get(f"/api/maps/{maps[recording]}/map.zip").content)
            assert {k: v for k, v in made.items() if k not in DATED} == sent[name].mapped
        for recording in ledger.deleted:
            assert client.get(f"/api/recordings/{recording}").status_code == 404
    assert ledger.kept
    assert ledger.counts["bytes lost"] == ledger.counts["errors"] == 0
    assert {*ledger.counts} <= {"bytes lost", "errors", "deleting: 204", "deleting: 404"}
    assert list((server.folder / "work").iterdir()) == []


@contextmanager
def running(data: Path) -> Iterator[tuple[Served, httpx.Client]]:
    """A server of a data folder, started anew, and a client of its owner; killed at the end."""
    served = start(data, jobs=True)
    try:
        with served.client() as client:
            yield served, client
    finally:
        served.kill()


def test_a_server_killed_while_it_maps_goes_on_and_makes_the_same_map(
    sent: dict[str, Walk], tmp_path: Path
) -> None:
    with running(tmp_path / "data") as (served, client):
        recording_of(client, "walk.zip", sent["one"].packed)
        [job] = client.get("/api/jobs").json()
        job_when(client, job["id"], lambda job: job["doing"] in STAGES)
        served.kill()
    assert list((tmp_path / "data" / "work").iterdir()) != []
    with running(tmp_path / "data") as (_, client):
        job = job_when(client, job["id"], lambda job: job["state"] in ("done", "failed"))
        assert (job["state"], job["attempts"]) == ("done", 2)
        ours = unzipped(client.get(f"/api/maps/{job['gave']['map']}/map.zip").content)
        assert len(client.get("/api/maps").json()) == 1
    assert {name: ours[name] for name in ours.keys() - DATED} == sent["one"].mapped
    assert ours.keys() >= DATED
    assert list((tmp_path / "data" / "work").iterdir()) == []
