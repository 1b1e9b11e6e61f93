"""The server killed (`kill -9`) at random moments from the upload of a walk to its map.

`server_kills.py` runs this beside its own kills. Each round a simulated walk goes up in pieces, is
completed and mapped, and the server is killed at one moment of all that; started again, whatever
is left is done. Nothing acknowledged may be missing, the job must end by itself, and its map must
be the one of a server that nobody killed, byte by byte but for dates and durations.
"""

from __future__ import annotations

import io
import random
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx
from served import PATIENCE_S, PIECE, TUS, completion, metadata, start

from elfslam.data.recordings import write_recording
from elfslam.world.simulate import describe_chirp, load_world, simulate

WORLD, WALKER, ROUNDS = "studio", 107, 2
PIECE_BYTES = 100_000
DATED = ("run.json", "timings.json", "report.html")
Row = dict[str, object]
Files = dict[str, bytes]


@dataclass
class Sent:
    """What a client knows of its walk: addresses, and what was acknowledged."""

    files: Files
    walk: str = ""
    places: dict[str, str] = field(default_factory=dict)
    acknowledged: dict[str, int] = field(default_factory=dict)
    stage: str = "upload"

    @property
    def acknowledged_bytes(self) -> int:
        """Of all files."""
        return sum(self.acknowledged.values())


def kill_mappings(folder: Path, rounds: int, seed: int) -> Iterator[Row]:
    """So many walks, each with a kill somewhere between its first byte and its map."""
    generator, files = random.Random(seed), simulated(folder / "simulated")
    wanted, whole_s = undisturbed(folder / "undisturbed", files)
    for number in range(rounds):
        delay_s = generator.uniform(0, whole_s)
        yield round_of(folder / "mappings", files, wanted, number + 1, delay_s)


def round_of(data: Path, files: Files, wanted: Files, number: int, delay_s: float) -> Row:
    """One walk and one kill."""
    sent, served = Sent(files), start(data, jobs=True)
    with served.client() as client, suppress(httpx.TransportError):
        until_s = time.monotonic() + delay_s
        go_on(client, sent, until_s)
        while time.monotonic() < until_s:
            sent.stage = job_of(client, sent)["state"]
            time.sleep(0.05)
    served.kill()
    killed_in, acknowledged = sent.stage, sent.acknowledged_bytes
    served = start(data, jobs=True)
    with served.client() as client:
        found = found_bytes(client, sent)
        go_on(client, sent, None)
        job = ended(client, sent)
        made = map_files(client, job)
    served.kill()
    left = list((data / "work").iterdir())
    return {
        "killed while": f"mapping, {killed_in}",
        "round": number,
        "acknowledged": acknowledged,
        "found": found,
        "lost": max(0, acknowledged - found),
        "resumed": job["state"] == "done" and not left and same(made, wanted),
    }


def go_on(client: httpx.Client, sent: Sent, until_s: float | None) -> None:
    """Whatever is left of the upload and of the completion, or as much as there is time for."""
    if not sent.walk:
        sent.walk = client.post("/api/recordings", json={"name": "walk"}).json()["id"]
    if client.get(f"/api/recordings/{sent.walk}").json()["state"] == "receiving":
        for name, content in sent.files.items():
            send(client, sent, name, content, until_s)
    if until_s is None or time.monotonic() < until_s:
        sent.stage = "completing"
        answer = client.post(f"/api/recordings/{sent.walk}/complete", json=completion(sent.files))
        answer.raise_for_status()


def send(
    client: httpx.Client, sent: Sent, name: str, content: bytes, until_s: float | None
) -> None:
    """The rest of a file."""
    if name not in sent.places:
        told = metadata(recording=sent.walk, filename=name)
        headers = {**TUS, "Upload-Metadata": told, "Upload-Length": str(len(content))}
        sent.places[name] = client.post("/api/uploads", headers=headers).headers["location"]
    place = sent.places[name]
    offset = int(client.head(place, headers=TUS).headers["upload-offset"])
    while offset < len(content) and (until_s is None or time.monotonic() < until_s):
        piece, headers = content[offset : offset + PIECE_BYTES], {"Upload-Offset": str(offset)}
        answer = client.patch(place, headers={**PIECE, **headers}, content=piece)
        answer.raise_for_status()
        offset = sent.acknowledged[name] = int(answer.headers["upload-offset"])


def found_bytes(client: httpx.Client, sent: Sent) -> int:
    """What a server has of a walk."""
    if not sent.walk:
        return 0
    told = client.get(f"/api/recordings/{sent.walk}").json()
    kept = sum(entry["size_bytes"] for entry in told["files"])
    return int(kept + sum(entry["offset_bytes"] for entry in told["uploads"]))


def job_of(client: httpx.Client, sent: Sent) -> dict[str, object]:
    """The one job of a walk. Stops the benchmark where there is another number."""
    jobs = client.get("/api/jobs", params={"recording": sent.walk}).json()
    if len(jobs) != 1:
        raise SystemExit(f"wanted one job of the walk, got {len(jobs)}")
    return dict(jobs[0])


def ended(client: httpx.Client, sent: Sent) -> dict[str, object]:
    """The job of a walk, waited for."""
    until_s = time.monotonic() + PATIENCE_S
    while (job := job_of(client, sent))["state"] in ("queued", "running"):
        if time.monotonic() > until_s:
            raise SystemExit(f"the job does not end: {job}")
        time.sleep(0.1)
    return job


def map_files(client: httpx.Client, job: dict[str, object]) -> Files:
    """The files of the map that a job gave."""
    gave = job["gave"]
    if not isinstance(gave, dict) or "map" not in gave:
        return {}
    content = client.get(f"/api/maps/{gave['map']}/map.zip").content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {Path(name).name: archive.read(name) for name in archive.namelist()}


def same(made: Files, wanted: Files) -> bool:
    """Whether two maps are one, dates and durations aside."""
    undated = (name for name in wanted if name not in DATED)
    return made.keys() == wanted.keys() and all(made[name] == wanted[name] for name in undated)


def undisturbed(data: Path, files: Files) -> tuple[Files, float]:
    """The map of a server that nobody kills, and how long that took from the first byte."""
    served, sent = start(data, jobs=True), Sent(files)
    began_s = time.monotonic()
    with served.client() as client:
        go_on(client, sent, None)
        job = ended(client, sent)
        whole_s = time.monotonic() - began_s
        made = map_files(client, job)
    served.kill()
    return made, whole_s


def simulated(folder: Path) -> Files:
    """The files of a walk through the studio, by name."""
    recording, truth = simulate(load_world(WORLD), WALKER, rounds=ROUNDS)
    write_recording(recording, folder, chirp_description=describe_chirp(), truth=truth)
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}
