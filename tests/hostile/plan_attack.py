"""Hostile floor plans, fifty at a time, by one user: what another user notices.

Usage, from the root of the project:

    python -m tests.hostile.plan_attack [--seconds 60] [--at-once 50] [--json]

One user puts SVGs full of masks, progressive JPEGs of many scans, PNGs that unfold a thousandfold
and PDFs that unfold to a gigabyte, in turn, without a pause. Another lists their maps, looks at a
recording, uploads a small file and puts a small plan, before and meanwhile. At the end the server
is told to stop while it is attacked. The server, the attacker and the other user are a process
each; memory is that of the server and its children together (proportional set size).
"""

from __future__ import annotations

import argparse
import asyncio
import io
import json
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import numpy as np
from PIL import Image

from elfslam.app.console import print_rows, say
from elfslam.serve.people.users import add_user
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map
from studies.benchmarks.served import PIECE, Served, metadata, started
from tests.hostile_plans import PLANS, PNG

KINDS = (
    *("SVG masks", "progressive JPEG", "PNG bomb", "unfolding PDF"),
    *("SVG of 90 masks", "JPEG of 97 scans"),
)
"""The last two are below the bounds that are counted, and meet those of processor time."""
ELSEWHERE = "127.0.0.2"
"""Where the attacker sends from: how often one address may ask is another bound."""
PATIENCE_S = 300.0
BEFORE_S, PAUSE_S, LOOK_S = 10.0, 0.1, 0.1
NICENESS = 10
"""The attacker would have a machine of its own."""
CHILD = "elfslam.serve.parsing.child"
Row = dict[str, object]


@dataclass(frozen=True)
class Attack:
    """Plans for one map, so many at once, until the server is gone."""

    url: str
    token: str
    map_id: str
    at_once: int


def attack(told: Attack, ready: multiprocessing.Queue[None], heard: str) -> None:
    """Put one plan after the other; runs in a process of its own, and writes what it heard."""
    os.nice(NICENESS)
    plans = [(kind, PLANS[kind][0], PLANS[kind][1]()) for kind in KINDS]
    ready.put(None)
    answers: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    asyncio.run(_all_put(told, plans, answers))
    Path(heard).write_text(json.dumps(answers))


async def _all_put(
    told: Attack, plans: list[tuple[str, str, bytes]], answers: dict[str, Counter[str]]
) -> None:
    transport = httpx.AsyncHTTPTransport(
        local_address=ELSEWHERE, limits=httpx.Limits(max_connections=told.at_once)
    )
    bearer = {"Authorization": f"Bearer {told.token}"}
    async with httpx.AsyncClient(
        base_url=told.url, headers=bearer, transport=transport, timeout=PATIENCE_S
    ) as client:

        async def put(turn: int) -> None:
            while True:
                kind, media_type, content = plans[turn % len(plans)]
                answer = await _put(client, told.map_id, media_type, content)
                if answer is None:
                    return
                answers[kind][answer] += 1
                turn += 1

        await asyncio.gather(*(put(turn) for turn in range(told.at_once)))


async def _put(client: httpx.AsyncClient, map_id: str, kind: str, content: bytes) -> str | None:
    """The answer to a plan; None where the server is gone."""
    headers = {"Content-Type": kind}
    try:
        answer = await client.put(
            f"/api/maps/{map_id}/floor-plan", content=content, headers=headers
        )
    except httpx.ConnectError:
        return None
    except httpx.TransportError as error:
        return type(error).__name__
    detail = answer.json().get("detail", "") if answer.is_error else ""
    return f"{answer.status_code} {detail}".strip()


@dataclass
class Asked:
    """How long the other user waited, by question, and what was refused."""

    taken_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    failures: Counter[str] = field(default_factory=Counter)


def ask(served: Served, map_id: str, seconds: float) -> Asked:
    """Ask what a user asks, again and again."""
    asked, until_s = Asked(), time.monotonic() + seconds
    with served.client() as client:
        client.timeout = httpx.Timeout(PATIENCE_S)
        walk = str(client.post("/api/recordings", json={"name": "honest"}).json()["id"])
        questions = _questions(client, map_id, walk)
        while time.monotonic() < until_s:
            for name, question in questions.items():
                begin_s = time.perf_counter()
                answer = question()
                asked.taken_s[name].append(time.perf_counter() - begin_s)
                if answer.is_error:
                    asked.failures[f"{name}: {answer.status_code}"] += 1
                time.sleep(PAUSE_S)
    return asked


def _questions(
    client: httpx.Client, map_id: str, walk: str
) -> dict[str, Callable[[], httpx.Response]]:
    made = io.BytesIO()
    Image.new("L", (800, 600), 255).save(made, "PNG")
    plan, walls = made.getvalue(), {"Content-Type": PNG}

    def upload() -> httpx.Response:
        told = metadata(recording=walk, filename="wifi.csv")
        headers = {**PIECE, "Upload-Metadata": told, "Upload-Length": "20000"}
        answer = client.post("/api/uploads", headers=headers, content=bytes(20_000))
        client.delete(answer.headers["location"], headers=PIECE).raise_for_status()
        return answer

    return {
        "list of maps": lambda: client.get("/api/maps"),
        "a recording": lambda: client.get(f"/api/recordings/{walk}"),
        "a small upload": upload,
        "a small plan": lambda: client.put(
            f"/api/maps/{map_id}/floor-plan", content=plan, headers=walls
        ),
    }


@dataclass
class Most:
    """The most memory and the most children that were seen."""

    memory_mib: float = 0.0
    children: int = 0


@contextmanager
def watched(process: int) -> Iterator[Most]:
    """The most of a server and its children, as long as the block lasts."""
    most, ended = Most(), threading.Event()

    def look() -> None:
        while not ended.wait(LOOK_S):
            children = parsing_children()
            most.children = max(most.children, len(children))
            most.memory_mib = max(most.memory_mib, sum(map(_memory_mib, [process, *children])))

    looking = threading.Thread(target=look)
    looking.start()
    try:
        yield most
    finally:
        ended.set()
        looking.join()


def parsing_children() -> list[int]:
    """The children that parse for the one server here, also after it has ended."""
    told, found = f"{CHILD}\0".encode(), []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            if told in file.read_bytes():
                found.append(int(file.parent.name))
    return found


def _memory_mib(process: int) -> float:
    with suppress(OSError):
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) / 1024
    return 0.0


def attacked(seconds: float, at_once: int) -> tuple[list[Row], list[Row], Row]:
    """What the other user waited for, what the attacker heard, and what the server took."""
    context = multiprocessing.get_context("spawn")
    ready: multiprocessing.Queue[None] = context.Queue()
    with started() as served, watched(served.process.pid) as most:
        told, map_id = _two_users(served, at_once)
        heard = str(served.data.parent / "heard.json")
        attacker = context.Process(target=attack, args=(told, ready, heard))
        before = ask(served, map_id, BEFORE_S)
        attacker.start()
        ready.get()
        say(f"{at_once} plans at a time for {seconds:g} s")
        during = ask(served, map_id, seconds)
        begin_s = time.perf_counter()
        served.process.send_signal(signal.SIGTERM)
        served.process.wait()
        stop_s = time.perf_counter() - begin_s
        left = len(parsing_children())
        attacker.join()
        answers = json.loads(Path(heard).read_text())
    took: Row = {
        "most memory MiB": round(most.memory_mib),
        "most children": most.children,
        "stopped after s": round(stop_s, 2),
        "processes left": left,
    }
    return _waited(before, during), _heard(answers), took


def _two_users(served: Served, at_once: int) -> tuple[Attack, str]:
    """The attacker with a map, and a map of the owner's."""
    services = open_services(ServerSettings(served.data))
    eve, token = add_user(services, "Eve")
    with served.client() as client:
        ada = client.get("/api/me").json()["id"]
    with transaction(services.sessions) as session:
        rows = [Map(user_id=user, name="hall", kind="run") for user in (eve.id, ada)]
        session.add_all(rows)
        session.flush()
        hers, mine = (row.id for row in rows)
    services.engine.dispose()
    return Attack(served.url, token, hers, at_once), mine


def _waited(before: Asked, during: Asked) -> list[Row]:
    return [
        {"question": name}
        | _times("before", before.taken_s[name])
        | _times("during", during.taken_s[name])
        | {"asked": len(during.taken_s[name])}
        | {"refused": sum(n for what, n in during.failures.items() if what.startswith(name))}
        for name in before.taken_s
    ]


def _times(when: str, taken_s: list[float]) -> Row:
    taken_ms = 1000 * np.array(taken_s)
    return {
        f"median {when} ms": round(float(np.median(taken_ms))),
        f"worst {when} ms": round(float(taken_ms.max())),
    }


def _heard(answers: dict[str, dict[str, int]]) -> list[Row]:
    return [
        {"plan": kind, "times": count, "answer": answer}
        for kind, heard in answers.items()
        for answer, count in sorted(heard.items())
    ]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--at-once", type=int, default=50)
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    waited, heard, took = attacked(known.seconds, known.at_once)
    print_rows(waited, title="the other user", as_json=known.json)
    print_rows(heard, title="the attacker", as_json=known.json)
    print_rows([took], title="the server and its children", as_json=known.json)


if __name__ == "__main__":
    main()
