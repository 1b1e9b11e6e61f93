"""Fifty walkers let others see where they are: how soon a position is acknowledged and seen.

Usage, from the root of the project:

    python -m studies.benchmarks.fifty_people [--people 50] [--listeners 10] [--seconds 30]

The server is a process of its own, on loopback; all people are in this process. Everybody posts
two positions a second, each in a request of its own, and listeners stream all of them; a position
counts from before it is posted until a listener has it. All come from one address, so the server's
limits of an address are lifted.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import numpy as np

from elfslam.app.console import print_rows
from elfslam.serve.people.users import add_user
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Building, Floor
from studies.benchmarks.served import Served, started

OFTEN = {"address_requests_per_s": 1e6, "address_connections": 500}
"""Limits of a server that refuses no address its haste."""
PERIOD_S = 0.5
SETTLING_S = 1.0


@dataclass(frozen=True)
class Log:
    """Seconds that acknowledging took, and positions that were posted and that listeners heard."""

    took_s: list[float] = field(default_factory=list)
    posted_s: dict[tuple[int, int], float] = field(default_factory=dict)
    heard: list[tuple[int, int, float]] = field(default_factory=list)


def plant(data: Path, people: int) -> tuple[str, list[str]]:
    """A published floor, in which everybody is located, and the tokens of people."""
    services = open_services(ServerSettings(data))
    with transaction(services.sessions) as session:
        building = Building(name="Hall")
        session.add(building)
        session.flush()
        where = {"latitude_deg": 47.0, "longitude_deg": 8.0, "radius_m": 50.0}
        floor = Floor(
            building=building.number, level=0, has_wifi=False, revision=1, manifest="{}", **where
        )
        session.add(floor)
    tokens = [add_user(services, f"person {k}")[1] for k in range(people)]
    services.engine.dispose()
    return floor.id, tokens


async def walk(
    client: httpx.AsyncClient, map_id: str, index: int, seconds: float, log: Log
) -> None:
    """Post two positions a second."""
    await asyncio.sleep(PERIOD_S * index / 50)
    begin_s, count = time.perf_counter(), 0
    while (due_s := begin_s + count * PERIOD_S) < begin_s + seconds:
        await asyncio.sleep(max(0.0, due_s - time.perf_counter()))
        log.posted_s[index, count] = time.perf_counter()
        fix = {"status": "OK", "x_m": index, "y_m": count, "heading_rad": 0, "sigma_m": 0.2}
        told = {"map": map_id, "walk": f"{index:016x}", "positions": [fix]}
        sent_s = time.perf_counter()
        answer = await client.post("/api/positions", json=told)
        answer.raise_for_status()
        log.took_s.append(time.perf_counter() - sent_s)
        count += 1


async def listen(client: httpx.AsyncClient, map_id: str, log: Log) -> None:
    """Keep whose position it was, which of theirs, and when it came."""
    async with client.stream("GET", f"/api/maps/{map_id}/positions/stream") as answer:
        answer.raise_for_status()
        async for line in answer.aiter_lines():
            if line.startswith("data:"):
                told = json.loads(line[5:])
                log.heard.append((int(told["x_m"]), int(told["y_m"]), time.perf_counter()))


async def together(
    served: Served, map_id: str, tokens: Sequence[str], known: argparse.Namespace
) -> Log:
    """All of them at once, as long as was asked."""
    log, limits = Log(), httpx.Limits(max_connections=None, max_keepalive_connections=None)
    clients = [
        httpx.AsyncClient(
            base_url=served.url, headers={"Authorization": f"Bearer {token}"}, timeout=60,
            limits=limits,
        )
        for token in (*tokens, served.token)
    ]  # fmt: skip
    listening = [
        asyncio.create_task(listen(clients[-1], map_id, log)) for _ in range(known.listeners)
    ]
    await asyncio.sleep(SETTLING_S)

    walks = [walk(clients[k], map_id, k, known.seconds, log) for k in range(len(tokens))]
    await asyncio.gather(*walks)
    await asyncio.sleep(SETTLING_S)
    for task in listening:
        task.cancel()
    await asyncio.gather(*listening, return_exceptions=True)
    for client in clients:
        await client.aclose()
    return log


def row(what: str, seconds: Sequence[float]) -> dict[str, object]:
    """How long something took, and how often."""
    taken_ms = 1000 * np.array(seconds)
    told = {f"{q} %, ms": round(float(np.percentile(taken_ms, q)), 1) for q in (50, 95, 99)}
    return {"": what, "times": len(taken_ms), **told, "worst, ms": round(float(taken_ms.max()))}


def measured(known: argparse.Namespace) -> tuple[list[dict[str, object]], str]:
    """The rows of the table, and what the server took."""
    with started(limits=OFTEN) as served:
        map_id, tokens = plant(served.data, known.people)
        log, used = served.while_asked(lambda: asyncio.run(together(served, map_id, tokens, known)))
    delays_s = [at_s - log.posted_s[who, which] for who, which, at_s in log.heard]
    lost = known.listeners * len(log.posted_s) - len(delays_s)
    rows = [row("a position is acknowledged", log.took_s), row("it is seen", delays_s)]
    return rows, f"{lost} positions not seen; the server: {used}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=50)
    parser.add_argument("--listeners", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    rows, used = measured(known)
    print_rows(rows, title=f"{known.people} people at once", as_json=known.json)
    if not known.json:
        print(used)


if __name__ == "__main__":
    main()
