"""Fifty people on one server: they let others see where they are, share maps and take them away.

Usage, from the root of the project:

    python -m studies.benchmarks.fifty_people [--people 50] [--listeners 10] [--seconds 30]
        [--pause 30]

The server is a process of its own, on loopback; all people are in this process. Everybody posts
two positions a second, each in a request of its own, and every `--pause` seconds shares their map
with the next one, who looks at their list, opens the map, names a place in it, exports it (GeoJSON,
IMDF) and takes what a phone keeps; then the share is withdrawn. Ten listeners stream the positions;
one counts from before it is posted until a listener has it. Maps are of one simulated walk through
the studio. All come from one address, so the server's limits of an address are lifted.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from elfslam.app.console import print_rows
from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.data.recordings import write_recording
from elfslam.serve.buildings.tables import Building, Floor
from elfslam.serve.people.users import add_user
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Map, MapFile, transaction
from elfslam.world.simulate import describe_chirp, load_world, simulate
from studies.benchmarks.served import Served, started

OFTEN = {"address_requests_per_s": 1e6, "address_connections": 500}
"""Limits of a server that refuses no address its haste."""
PERIOD_S = 0.5
SETTLING_S = 1.0
SEED = 107
ORIGIN = {"origin": "47.3769,8.5417"}
VENUE = {
    **ORIGIN, "name": "Hall", "category": "businesscampus", "address": "Street 1",
    "locality": "Town", "country": "CH", "level": "Ground floor", "ordinal": "0",
}  # fmt: skip
DOOR = {"name": "Door", "kind": "door", "x_m": 1.0, "y_m": 1.0}


@dataclass(frozen=True)
class Person:
    """Somebody with a map."""

    id: str
    token: str
    map_id: str


@dataclass(frozen=True)
class Log:
    """Seconds that requests of each kind took, and positions that listeners heard."""

    took_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    posted_s: dict[tuple[int, int], float] = field(default_factory=dict)
    heard: list[tuple[int, int, float]] = field(default_factory=list)


def plant(data: Path, people: int) -> tuple[str, list[Person]]:
    """A published floor, in which everybody is located, and people with a map each."""
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
    planted = plant_maps(services, [add_user(services, f"person {k}") for k in range(people)])
    services.engine.dispose()
    return floor.id, planted


def plant_maps(services: Services, users: Sequence[tuple[Any, str]]) -> list[Person]:
    """A map for each user, as a job would have left it."""
    with tempfile.TemporaryDirectory() as folder:
        recording, _ = simulate(load_world("studio"), SEED, rounds=2)
        walk, run = Path(folder) / "walk", Path(folder) / "run"
        write_recording(recording, walk, chirp_description=describe_chirp())
        job = MapJob((), None, "compact", Settings(), overwrite=False)
        map_into(run, walk, job, lambda *_: None)
        files = blobs.put_folder(services.settings.blobs_folder, run)
    people = []
    for user, token in users:
        with transaction(services.sessions) as session:
            made = Map(user_id=user.id, name="studio", kind="run", facts={})
            session.add(made)
            session.flush()
            session.add_all(
                MapFile(map_id=made.id, name=name, sha256=blob.sha256, size_bytes=blob.size_bytes)
                for name, blob in files.items()
            )
            people.append(Person(user.id, token, made.id))
    return people


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
        await asked(client, log, "a position is acknowledged", "POST", "/api/positions", json=told)
        count += 1


async def share(
    client: httpx.AsyncClient, other: httpx.AsyncClient, mine: Person, to: Person, log: Log
) -> None:
    """Share a map; whom it is shared with finds it, looks, names a place, takes it away."""
    path = f"/api/maps/{mine.map_id}"
    points, shared = f"{path}/points-of-interest", f"{path}/shares/{to.id}"
    await asked(client, log, "a map is shared", "PUT", shared, json={"may": "edit"})
    listed = await asked(other, log, "the list of maps", "GET", "/api/maps")
    if mine.map_id not in [each["id"] for each in listed.json()]:
        raise SystemExit("a shared map is in no list")
    await asked(other, log, "a map is opened", "GET", f"{path}/view")
    now = (await asked(other, log, "named places", "GET", points)).json()
    told = {"version": now["version"], "points": [DOOR] if not now["points"] else []}
    await asked(other, log, "a place is named", "PUT", points, json=told)
    exports = f"{path}/exports"
    await asked(other, log, "export, GeoJSON", "GET", f"{exports}/geojson", params=ORIGIN)
    await asked(other, log, "export, IMDF", "GET", f"{exports}/imdf", params=VENUE)
    await asked(other, log, "manifest for a phone", "GET", f"{path}/package")
    await asked(client, log, "a share is withdrawn", "DELETE", shared)


async def asked(
    client: httpx.AsyncClient, log: Log, what: str, method: str, path: str, **more: Any
) -> httpx.Response:
    """An answer that is no refusal; how long it took goes into the log."""
    sent_s = time.perf_counter()
    answer = await client.request(method, path, **more)
    answer.raise_for_status()
    log.took_s[what].append(time.perf_counter() - sent_s)
    return answer


async def listen(client: httpx.AsyncClient, map_id: str, log: Log) -> None:
    """Keep whose position it was, which of theirs, and when it came."""
    async with client.stream("GET", f"/api/maps/{map_id}/positions/stream") as answer:
        answer.raise_for_status()
        async for line in answer.aiter_lines():
            if line.startswith("data:"):
                told = json.loads(line[5:])
                log.heard.append((int(told["x_m"]), int(told["y_m"]), time.perf_counter()))


async def together(
    served: Served, map_id: str, people: Sequence[Person], known: argparse.Namespace
) -> Log:
    """All of them at once, as long as was asked."""
    log, limits = Log(), httpx.Limits(max_connections=None, max_keepalive_connections=None)
    clients = [
        httpx.AsyncClient(
            base_url=served.url, headers={"Authorization": f"Bearer {token}"}, timeout=60,
            limits=limits,
        )
        for token in (*(each.token for each in people), served.token)
    ]  # fmt: skip
    listening = [
        asyncio.create_task(listen(clients[-1], map_id, log)) for _ in range(known.listeners)
    ]
    await asyncio.sleep(SETTLING_S)

    async def shares(index: int) -> None:
        other = (index + 1) % len(people)
        begin_s = time.perf_counter()
        due_s = begin_s + known.pause * index / len(people)
        while due_s < begin_s + known.seconds:
            await asyncio.sleep(max(0.0, due_s - time.perf_counter()))
            await share(clients[index], clients[other], people[index], people[other], log)
            due_s += known.pause

    walks = [walk(clients[k], map_id, k, known.seconds, log) for k in range(len(people))]
    await asyncio.gather(*walks, *(shares(k) for k in range(len(people) if known.pause else 0)))
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
        map_id, people = plant(served.data, known.people)
        log, used = served.while_asked(lambda: asyncio.run(together(served, map_id, people, known)))
    delays_s = [at_s - log.posted_s[who, which] for who, which, at_s in log.heard]
    lost = known.listeners * len(log.posted_s) - len(delays_s)
    rows = [row("a position is seen", delays_s), *(row(*each) for each in log.took_s.items())]
    return rows, f"{lost} positions not seen; the server: {used}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=50)
    parser.add_argument("--listeners", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument(
        "--pause", type=float, default=30.0, help="s between shares; 0 shares nothing"
    )
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    rows, used = measured(known)
    print_rows(rows, title=f"{known.people} people at once", as_json=known.json)
    if not known.json:
        print(used)


if __name__ == "__main__":
    main()
