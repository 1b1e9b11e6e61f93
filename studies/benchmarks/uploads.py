"""How soon a recording can be read after it has come to a real server: one at a time, many at once.

Usage, from the root of the project:

    python -m studies.benchmarks.uploads [--count 30] [--at-once 8]

The recording is a simulated minute with sound, packed as a .zip. Seconds from the first byte of
its upload until the server calls it ready.
"""

import argparse
import shutil
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median

import httpx

from elfslam.app.console import print_rows
from elfslam.data.recordings import write_recording
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from studies.benchmarks.served import PIECE, metadata, start

WORLD, SEED, AT_REST = "studio", 100, ("ready", "refused")
POLL_S = 0.02


def packed(folder: Path) -> bytes:
    """A simulated recording as a .zip."""
    recording, _ = simulate(load_world(WORLD), SEED, rounds=2)
    write_recording(recording, folder / "walk")
    return Path(shutil.make_archive(str(folder / "walk"), "zip", folder / "walk")).read_bytes()


def seconds_until_ready(client: httpx.Client, data: bytes) -> float:
    """Upload a recording and wait. Raises RuntimeError where the server refuses it."""
    told = {"Upload-Metadata": metadata(filename="walk.zip"), "Upload-Length": str(len(data))}
    begun_s = time.monotonic()
    made = client.post("/api/uploads", headers={**PIECE, **told}, content=data).raise_for_status()
    at = f"/api/recordings/{made.headers['elfslam-recording']}"
    while (known := client.get(at).raise_for_status().json())["state"] not in AT_REST:
        time.sleep(POLL_S)
    if known["state"] != "ready":
        raise RuntimeError(known["refusal"])
    return time.monotonic() - begun_s


def uploaded(client: httpx.Client, data: bytes, count: int, at_once: int) -> list[float]:
    """Seconds of so many uploads by so many at once."""
    with ThreadPoolExecutor(at_once) as pool:
        return list(pool.map(lambda _: seconds_until_ready(client, data), range(count)))


def row(what: str, took_s: Sequence[float], begun_s: float) -> dict[str, object]:
    """A row of the table."""
    return {"uploads": what, "median (s)": round(median(took_s), 2),
            "longest (s)": round(max(took_s), 2),
            "all (s)": round(time.monotonic() - begun_s, 1)}  # fmt: skip


def main() -> None:
    """Upload the same walk alone and in company, and print how soon each is ready."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--at-once", type=int, default=8)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        data = packed(Path(name))
        served = start(Path(name) / "data")
        try:
            with served.client() as client:
                for count, at_once in ((5, 1), (given.count, given.at_once)):
                    begun_s = time.monotonic()
                    took_s = uploaded(client, data, count, at_once)
                    rows.append(row(f"{count}, {at_once} at once", took_s, begun_s))
        finally:
            served.kill()
    print_rows(rows, title=f"{len(data) / 1e6:.1f} MB each", as_json=False)


if __name__ == "__main__":
    main()
