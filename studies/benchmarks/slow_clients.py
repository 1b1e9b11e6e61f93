"""A thousand slow clients of each kind: what an honest client notices.

Usage, from the root of the project:

    python -m studies.benchmarks.slow_clients [--clients 1000] [--seconds 20] [--speaks http,https]
        [--kinds headers,bodies,handshakes,idle,readers] [--places own,one,many]

Slow clients begin a request head, a body or a TLS handshake and send a byte every two seconds, or
nothing; `readers` ask for a large file and read nothing of it. Whoever is cut comes again a second
later. They come from the honest client's own address, from one other, or from many; all of these
are loopback's. The honest client asks for the version ten times a second, each time by a new
connection, and uploads pieces by a kept one. The server, the slow clients and the honest one are
a process each.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import socket
import ssl
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

import httpx
import numpy as np

from elfslam.app.console import print_rows, say
from studies.benchmarks.served import PIECE, TUS, Served, metadata, peak_mib, started

HOST, OTHER = "127.0.0.1", "127.0.0.2"
DRIP_S = 2.0
AGAIN_S = 1.0
CONNECT_S = 30.0
RECEIVED_BYTES = 2**12
ASK_S, PATIENCE_S = 0.1, 10.0
BEFORE_S = 5.0
PIECE_BYTES, PIECE_S = 100_000, 0.5
LARGE_FILE = "/vendor/onnxruntime-web/ort-wasm-simd-threaded.wasm"
HEAD = f"HTTP/1.1\r\nHost: {HOST}\r\n"
BEGINNINGS = {
    "headers": f"GET / {HEAD}X-Slow: ",
    "bodies": (
        f"POST /api/recordings {HEAD}Content-Length: 10000\r\n"
        "Content-Type: application/json\r\n\r\n"
    ),
    "handshakes": "",
    "idle": "",
    "readers": f"GET {LARGE_FILE} {HEAD}Accept-Encoding: gzip\r\n\r\n",
}
DRIPPING = ("headers", "bodies")
PLACES = ("own", "one", "many")
Row = dict[str, object]


@dataclass(frozen=True)
class Attack:
    """So many slow clients of a kind, for so long."""

    kind: str
    place: str
    clients: int
    seconds: float
    port: int
    secure: bool

    def source(self, index: int) -> str:
        """The address of one of them."""
        many = f"127.1.{index // 250}.{index % 250 + 1}"
        return {"own": HOST, "one": OTHER, "many": many}[self.place]


def attack(told: Attack) -> None:
    """Be slow; runs in a process of its own."""
    asyncio.run(_all_slow(told))


async def _all_slow(told: Attack) -> None:
    context = None
    if told.secure:
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    until_s = time.monotonic() + told.seconds
    clients = (_slow(told, told.source(index), context, until_s) for index in range(told.clients))
    await asyncio.gather(*clients)


async def _slow(told: Attack, source: str, context: ssl.SSLContext | None, until_s: float) -> None:
    while (left_s := until_s - time.monotonic()) > 0:
        with suppress(OSError, TimeoutError):
            async with asyncio.timeout(left_s):
                await _one_connection(told, source, context)
        await asyncio.sleep(min(AGAIN_S, max(0.0, until_s - time.monotonic())))


async def _one_connection(told: Attack, source: str, context: ssl.SSLContext | None) -> None:
    shakes = told.kind == "handshakes"
    async with asyncio.timeout(CONNECT_S):
        plain = await _connected(source, told.port)
        secured = None if shakes else context
        reader, writer = await asyncio.open_connection(
            sock=plain, ssl=secured, server_hostname=HOST if secured else None
        )
    try:
        writer.write(_client_hello(context) if shakes else BEGINNINGS[told.kind].encode())
        while not writer.is_closing():
            if told.kind == "readers":
                await asyncio.sleep(DRIP_S)
                continue
            with suppress(TimeoutError):
                async with asyncio.timeout(DRIP_S):
                    while await reader.read(2**16):
                        pass
                    return
            if told.kind in DRIPPING:
                writer.write(b"a")
    finally:
        writer.transport.abort()


async def _connected(source: str, port: int) -> socket.socket:
    """A connection from an address, whose system holds little of what nobody reads."""
    plain = socket.socket()
    try:
        plain.setblocking(False)
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVED_BYTES)
        plain.bind((source, 0))
        await asyncio.get_running_loop().sock_connect(plain, (HOST, port))
    except BaseException:
        plain.close()
        raise
    return plain


def _client_hello(context: ssl.SSLContext | None) -> bytes:
    assert context is not None
    sent = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), sent, server_hostname=HOST).do_handshake()
    return sent.read()


@dataclass
class Asked:
    """What the honest client met."""

    taken_s: list[float] = field(default_factory=list)
    failures: Counter[str] = field(default_factory=Counter)


def ask(served: Served, seconds: float) -> Asked:
    """Ask for the version again and again."""
    asked, until_s = Asked(), time.monotonic() + seconds
    context = served.trusted if isinstance(served.trusted, ssl.SSLContext) else None
    while time.monotonic() < until_s:
        begin_s = time.perf_counter()
        try:
            outcome = _status(port_of(served), context)
        except OSError as error:
            outcome = type(error).__name__
        taken_s = time.perf_counter() - begin_s
        asked.taken_s.append(taken_s)
        if outcome != "200":
            asked.failures[outcome] += 1
        time.sleep(max(0.0, ASK_S - taken_s))
    return asked


def _status(port: int, context: ssl.SSLContext | None) -> str:
    with socket.create_connection((HOST, port), PATIENCE_S, (HOST, 0)) as plain:
        connection = context.wrap_socket(plain, server_hostname=HOST) if context else plain
        connection.sendall(f"GET /api/version {HEAD}Connection: close\r\n\r\n".encode())
        answer = b""
        while more := connection.recv(2**16):
            answer += more
    return answer[9:12].decode() or "cut off"


@dataclass
class Uploaded:
    """How an upload went on."""

    taken_s: list[float] = field(default_factory=list)
    cut: int = 0


@contextmanager
def uploading(served: Served) -> Iterator[Uploaded]:
    """Pieces of a file go up by a kept connection; one that is cut goes on from the offset."""
    told, ended = Uploaded(), threading.Event()
    with served.client() as client:
        client.timeout = httpx.Timeout(PATIENCE_S)
        place = _upload(client)

        def send() -> None:
            while not ended.is_set():
                begin_s = time.perf_counter()
                try:
                    offset = int(client.head(place, headers=TUS).headers["upload-offset"])
                    sent = {**PIECE, "Upload-Offset": str(offset)}
                    client.patch(place, headers=sent, content=bytes(PIECE_BYTES)).raise_for_status()
                    told.taken_s.append(time.perf_counter() - begin_s)
                except (httpx.HTTPError, KeyError):
                    told.cut += 1
                ended.wait(PIECE_S)

        sender = threading.Thread(target=send)
        sender.start()
        yield told
        ended.set()
        sender.join()


def _upload(client: httpx.Client) -> str:
    made = client.post("/api/recordings", json={"name": "honest"}).json()["id"]
    headers = {
        **TUS,
        "Upload-Metadata": metadata(recording=made, filename="baseband.iq"),
        "Upload-Defer-Length": "1",
    }
    return str(client.post("/api/uploads", headers=headers).headers["location"])


def port_of(served: Served) -> int:
    """Where a server listens."""
    return int(served.url.rstrip("/").rpartition(":")[2])


def held(served: Served) -> int:
    """How many connections a server holds."""
    return len(os.listdir(f"/proc/{served.process.pid}/fd"))


def measured(speaks: str, kind: str, place: str, clients: int, seconds: float) -> Row:
    """One row of the table."""
    with started(speaks=speaks) as served:
        before, empty = ask(served, BEFORE_S), held(served)
        told = Attack(kind, place, clients, seconds, port_of(served), speaks == "https")
        process = multiprocessing.get_context("spawn").Process(target=attack, args=(told,))
        with uploading(served) as uploaded:
            process.start()
            during = ask(served, seconds)
            left = held(served) - empty
        process.join()
        memory_mib = peak_mib(served.process.pid)
    failures = ", ".join(f"{count} {name}" for name, count in during.failures.most_common())
    row: Row = {"speaks": speaks, "slow": kind, "from": place}
    row |= _times("before", before.taken_s) | _times("during", during.taken_s)
    return row | {
        "asked": len(during.taken_s),
        "failed": failures or "0",
        "pieces": len(uploaded.taken_s),
        "cut": uploaded.cut,
        "held at the end": left,
        "memory MiB": round(memory_mib),
    }


def _times(when: str, taken_s: list[float]) -> Row:
    taken_ms = 1000 * np.array(taken_s)
    return {
        f"{when} ms": round(float(np.median(taken_ms)), 1),
        f"99 % {when} ms": round(float(np.quantile(taken_ms, 0.99)), 1),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clients", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--speaks", default="http,https")
    parser.add_argument("--kinds", default=",".join(BEGINNINGS))
    parser.add_argument("--places", default=",".join(PLACES))
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    table = []
    for speaks in known.speaks.split(","):
        for kind in known.kinds.split(","):
            for place in known.places.split(","):
                if kind == "handshakes" and speaks == "http":
                    continue
                say(f"{speaks}: {kind} from {place}")
                table.append(measured(speaks, kind, place, known.clients, known.seconds))
    print_rows(table, title=f"{known.clients} slow clients", as_json=known.json)


if __name__ == "__main__":
    main()
