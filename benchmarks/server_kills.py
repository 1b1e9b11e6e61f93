"""The server killed (`kill -9`) at random moments: what it acknowledged, and what is there.

Usage, from the root of the project:

    python benchmarks/server_kills.py [--rounds 20] [--seed 0] [--only uploads]

Uploads: one file goes up in pieces while the server is killed and started again; the offset
after each start may not lie below what was acknowledged. Completions: a recording that has come
whole is completed while the server is killed; afterwards it is completed again, and there must
be one ready recording and one job. Mappings: see `mapping_kills.py`.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import random
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import httpx
from mapping_kills import kill_mappings
from served import PIECE, TUS, Served, completion, metadata, start, walk_files

from elfslam.console import print_rows, say

PIECE_BYTES = 20_000
Row = dict[str, object]


def killed_after(served: Served, delay_s: float) -> threading.Timer:
    """Kill a server after a while."""
    timer = threading.Timer(delay_s, served.kill)
    timer.start()
    return timer


def kill_uploads(folder: Path, rounds: int, seed: int) -> Iterator[Row]:
    """One upload, over so many kills; after each what is there is the beginning of the file."""
    generator = random.Random(seed)
    whole = generator.randbytes(PIECE_BYTES * 25 * (rounds + 1))
    served = start(folder / "uploads")
    with served.client() as client:
        place = begin(client, len(whole))
    file, found = folder / "uploads" / "uploads" / place.rpartition("/")[2], 0
    for round_ in range(rounds):
        with served.client() as client:
            offset = send(client, place, whole, found, generator.randint(1, 20))
            timer = killed_after(served, generator.uniform(0, 0.05))
            acknowledged = send(client, place, whole, offset, len(whole))
            timer.join()
        served = start(folder / "uploads")
        with served.client() as client:
            found = offset_of(client, place)
        resumed = file.read_bytes() == whole[:found]
        yield row("uploading", round_, acknowledged, found, resumed=resumed)
    with served.client() as client:
        send(client, place, whole, found, len(whole))
    served.kill()
    if hashlib.sha256(file.read_bytes()).digest() != hashlib.sha256(whole).digest():
        raise SystemExit("what went up is not what is there")


def row(doing: str, round_: int, acknowledged: int, found: int, *, resumed: bool) -> Row:
    """One kill, in the table."""
    return {
        "killed while": doing,
        "round": round_ + 1,
        "acknowledged": acknowledged,
        "found": found,
        "lost": max(0, acknowledged - found),
        "resumed": resumed,
    }


def begin(client: httpx.Client, length: int, name: str = "audio.flac", walk: str = "") -> str:
    """An upload of so many bytes; its address."""
    walk = walk or client.post("/api/recordings", json={"name": "walk"}).json()["id"]
    told = metadata(recording=walk, filename=name)
    headers = {**TUS, "Upload-Metadata": told, "Upload-Length": str(length)}
    return str(client.post("/api/uploads", headers=headers).headers["location"])


def offset_of(client: httpx.Client, place: str) -> int:
    """How much of an upload is there."""
    return int(client.head(place, headers=TUS).headers["upload-offset"])


def send(client: httpx.Client, place: str, whole: bytes, offset: int, pieces: int) -> int:
    """Send so many pieces, or until the server is gone; what was acknowledged."""
    for _ in range(pieces):
        if offset == len(whole):
            break
        headers = {**PIECE, "Upload-Offset": str(offset)}
        piece = whole[offset : offset + PIECE_BYTES]
        try:
            answer = client.patch(place, headers=headers, content=piece)
        except httpx.TransportError:
            break
        answer.raise_for_status()
        offset = int(answer.headers["upload-offset"])
    return offset


def kill_completions(folder: Path, rounds: int, seed: int) -> Iterator[Row]:
    """So many recordings, each completed by a server that is killed meanwhile."""
    generator, data = random.Random(seed), folder / "completions"
    files = walk_files(folder / "walk", 2.0)
    served = start(data)
    taken_s = seconds_of_completion(served, files)
    for round_ in range(rounds):
        with served.client() as client:
            walk = sent(client, files)
            timer = killed_after(served, generator.uniform(0, 1.5 * taken_s))
            with contextlib.suppress(httpx.TransportError):
                client.post(f"/api/recordings/{walk}/complete", json=completion(files))
            timer.join()
        served = start(data)
        yield completed_again(served, walk, files, round_)
    served.kill()


def seconds_of_completion(served: Served, files: dict[str, bytes]) -> float:
    """How long a completion takes that is not killed."""
    with served.client() as client:
        walk, begin_s = sent(client, files), time.monotonic()
        client.post(f"/api/recordings/{walk}/complete", json=completion(files))
        return time.monotonic() - begin_s


def sent(client: httpx.Client, files: dict[str, bytes]) -> str:
    """The id of a recording whose files have all come."""
    walk = str(client.post("/api/recordings", json={"name": "walk"}).json()["id"])
    for name, content in files.items():
        send(client, begin(client, len(content), name, walk), content, 0, len(content))
    return walk


def completed_again(served: Served, walk: str, files: dict[str, bytes], round_: int) -> Row:
    """What is there after the kill, and after the completion was asked for again."""
    with served.client() as client:
        before = client.get(f"/api/recordings/{walk}").json()
        found = sum(entry["size_bytes"] for entry in before["files"])
        found += sum(entry["offset_bytes"] for entry in before["uploads"])
        again = client.post(f"/api/recordings/{walk}/complete", json=completion(files))
        jobs = client.get("/api/jobs", params={"recording": walk}).json()
    ready = again.status_code == 200 and again.json()["state"] == "ready" and len(jobs) == 1
    whole_bytes = sum(map(len, files.values()))
    return row(f"completing, {before['state']}", round_, whole_bytes, found, resumed=ready)


KILLS: dict[str, Callable[[Path, int, int], Iterable[Row]]] = {
    "uploads": kill_uploads,
    "completions": kill_completions,
    "mappings": kill_mappings,
}
"""What the server may be doing when it is killed."""


def main() -> None:
    """Print what every kill left, and a line that sums it up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=list(KILLS))
    known = parser.parse_args()
    begin_s, rows = time.monotonic(), []
    with tempfile.TemporaryDirectory() as folder:
        for name in [known.only] if known.only else list(KILLS):
            for kill in KILLS[name](Path(folder), known.rounds, known.seed):
                rows.append(kill)
                say(", ".join(f"{key} {cell}" for key, cell in kill.items()))
    print_rows(rows, title="The server, killed", as_json=False)
    lost = sum(int(str(kill["lost"])) for kill in rows)
    resumed = sum(kill["resumed"] is True for kill in rows)
    spent_s = time.monotonic() - begin_s
    print(
        f"{len(rows)} kills in {spent_s:.0f} s: {lost} acknowledged bytes lost, {resumed} resumed"
    )


if __name__ == "__main__":
    main()
