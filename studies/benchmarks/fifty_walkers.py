"""Fifty walkers who let others see where they are, and ten who look: how late a position comes.

Usage, from the root of the project:

    python -m studies.benchmarks.fifty_walkers [--walkers 50] [--listeners 10] [--seconds 20]

The server is a process of its own, on loopback; walkers and listeners run in this process. Every
walker posts two positions a second, each in a request of its own; a position counts from before it
is posted until a listener has it. The walkers come from one address here, so the server's limit of
requests of an address is lifted.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import time
from collections.abc import Sequence
from pathlib import Path

import httpx
import numpy as np

from elfslam.app.console import print_rows
from elfslam.serve.buildings.tables import Building, Floor
from elfslam.serve.people.users import add_user
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import transaction
from studies.benchmarks.served import Served, started

OFTEN = {"address_requests_per_s": 1e6, "address_connections": 500}
"""Limits of a server that refuses no address its haste."""
PERIOD_S = 0.5
SETTLING_S = 1.0


def plant(data: Path, walkers: int) -> tuple[str, list[str]]:
    """A published floor, in which everybody is located: its id, and the tokens of its walkers."""
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
    tokens = [add_user(services, f"walker {k}")[1] for k in range(walkers)]
    services.engine.dispose()
    return floor.id, tokens


async def walk(
    client: httpx.AsyncClient, map_id: str, index: int, seconds: float
) -> list[tuple[float, float]]:
    """Post two positions a second: when each was posted, and how long that took, s."""
    taken: list[tuple[float, float]] = []
    await asyncio.sleep(PERIOD_S * index / 50)
    begin_s = time.perf_counter()
    while (due_s := begin_s + len(taken) * PERIOD_S) < begin_s + seconds:
        await asyncio.sleep(max(0.0, due_s - time.perf_counter()))
        sent_s = time.perf_counter()
        fix = {"status": "OK", "x_m": index, "y_m": len(taken), "heading_rad": 0, "sigma_m": 0.2}
        told = {"map": map_id, "walk": f"{index:016x}", "positions": [fix]}
        answer = await client.post("/api/positions", json=told)
        answer.raise_for_status()
        taken.append((sent_s, time.perf_counter() - sent_s))
    return taken


async def listen(
    client: httpx.AsyncClient, map_id: str, heard: list[tuple[int, int, float]]
) -> None:
    """Keep whose position it was, which of theirs, and when it came."""
    async with client.stream("GET", f"/api/maps/{map_id}/positions/stream") as answer:
        answer.raise_for_status()
        async for line in answer.aiter_lines():
            if line.startswith("data:"):
                told = json.loads(line[5:])
                heard.append((int(told["x_m"]), int(told["y_m"]), time.perf_counter()))


async def together(
    served: Served, map_id: str, tokens: Sequence[str], listeners: int, seconds: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Seconds of every request, seconds until every listener had it, and how many were lost."""
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=None)
    clients = [
        httpx.AsyncClient(
            base_url=served.url, headers={"Authorization": f"Bearer {token}"}, timeout=60,
            limits=limits,
        )
        for token in (*tokens, served.token)
    ]  # fmt: skip
    heard: list[list[tuple[int, int, float]]] = [[] for _ in range(listeners)]
    listening = [asyncio.create_task(listen(clients[-1], map_id, each)) for each in heard]
    await asyncio.sleep(SETTLING_S)
    walks = [walk(client, map_id, k, seconds) for k, client in enumerate(clients[:-1])]
    sent = await asyncio.gather(*walks)
    await asyncio.sleep(SETTLING_S)
    for task in listening:
        task.cancel()
    await asyncio.gather(*listening, return_exceptions=True)
    for client in clients:
        await client.aclose()
    delays_s = [at_s - sent[who][which][0] for each in heard for who, which, at_s in each]
    posted_s = [took_s for each in sent for _, took_s in each]
    return np.array(posted_s), np.array(delays_s), listeners * len(posted_s) - len(delays_s)


def measured(walkers: int, listeners: int, seconds: float) -> dict[str, object]:
    """The row of the table."""
    with started(limits=OFTEN) as served:
        map_id, tokens = plant(served.data, walkers)
        (posted_s, delays_s, lost), used = served.while_asked(
            lambda: asyncio.run(together(served, map_id, tokens, listeners, seconds))
        )
    return {
        "walkers": walkers,
        "listeners": listeners,
        "positions": len(posted_s),
        "posted, median ms": 1000 * float(np.median(posted_s)),
        "posted, 99 % ms": 1000 * float(np.quantile(posted_s, 0.99)),
        "seen, median ms": 1000 * float(np.median(delays_s)),
        "seen, 99 % ms": 1000 * float(np.quantile(delays_s, 0.99)),
        "not seen": lost,
        **used,
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--walkers", type=int, default=50)
    parser.add_argument("--listeners", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    row = measured(known.walkers, known.listeners, known.seconds)
    print_rows([row], title="Walkers who are seen", as_json=known.json)


if __name__ == "__main__":
    main()
