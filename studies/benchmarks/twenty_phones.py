"""Twenty phones that upload at once to one server: latency of a piece, memory, processor.

Usage, from the root of the project:

    python -m studies.benchmarks.twenty_phones [--phones 20] [--seconds 60] [--kbit 115,161]

The server is a process of its own and speaks HTTPS on loopback. Every phone sends a piece a
second; the clients run in this process, and their share of the processor is not counted.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import time

import httpx
import numpy as np

from elfslam.app.console import print_rows
from studies.benchmarks.served import PIECE, TUS, Served, metadata, started

PIECE_S = 1.0


async def phone(client: httpx.AsyncClient, index: int, kbit: float, seconds: float) -> list[float]:
    """Send a piece a second; how long each was on its way, s."""
    made = await client.post("/api/recordings", json={"name": f"phone {index}"})
    told = metadata(recording=made.json()["id"], filename="baseband.iq")
    headers = {**TUS, "Upload-Metadata": told, "Upload-Defer-Length": "1"}
    place = (await client.post("/api/uploads", headers=headers)).headers["location"]
    piece = os.urandom(round(kbit * 1000 / 8 * PIECE_S))
    await asyncio.sleep(PIECE_S * index / 20)
    taken_s: list[float] = []
    begin_s, offset = time.perf_counter(), 0
    while (due_s := begin_s + len(taken_s) * PIECE_S) < begin_s + seconds:
        await asyncio.sleep(max(0.0, due_s - time.perf_counter()))
        sent_s = time.perf_counter()
        headers = {**PIECE, "Upload-Offset": str(offset)}
        answer = await client.patch(place, headers=headers, content=piece)
        answer.raise_for_status()
        taken_s.append(time.perf_counter() - sent_s)
        offset += len(piece)
    assert (await client.head(place, headers=TUS)).headers["upload-offset"] == str(offset)
    return taken_s


async def phones(served: Served, count: int, kbit: float, seconds: float) -> np.ndarray:
    """All phones at once; seconds of every piece."""
    async with httpx.AsyncClient(
        base_url=served.url,
        headers=served.bearer,
        verify=served.trusted,
        timeout=60,
        limits=httpx.Limits(max_connections=count, max_keepalive_connections=count),
    ) as client:
        walks = [phone(client, index, kbit, seconds) for index in range(count)]
        return np.concatenate(await asyncio.gather(*walks))


def measured(count: int, kbit: float, seconds: float) -> dict[str, object]:
    """One row of the table."""
    with started(speaks="https") as served:
        taken_s, used = served.while_asked(
            lambda: asyncio.run(phones(served, count, kbit, seconds))
        )
    return {
        "phones": count,
        "kbit/s each": kbit,
        "pieces": len(taken_s),
        "median ms": 1000 * float(np.median(taken_s)),
        "99 % ms": 1000 * float(np.quantile(taken_s, 0.99)),
        "worst ms": 1000 * float(taken_s.max()),
        **used,
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--phones", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--kbit", default="115,161")
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    rates = [float(cell) for cell in known.kbit.split(",")]
    table = [measured(known.phones, rate, known.seconds) for rate in rates]
    print_rows(table, title="Phones that upload at once", as_json=known.json)


if __name__ == "__main__":
    main()
