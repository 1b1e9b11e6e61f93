"""One POST: to the address that was checked, in time, following nothing."""

from __future__ import annotations

import asyncio
import contextlib
import re
import ssl
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import trustme

from elfslam.serve.positions.delivery import DeliveryError, post
from elfslam.serve.positions.signature import signed_headers
from elfslam.serve.positions.targets import Target, target_of
from studies.benchmarks.served import free_port
from tests.serve.positions.conftest import Receiver

ROOT = Path(__file__).resolve().parents[3]


def send(target: Target, body: bytes = b"{}", **more: Any) -> None:
    asyncio.run(post(target, "127.0.0.1", body, {"X-Told": "yes"}, **more))


def elsewhere(receiver: Receiver) -> Target:
    """A name that no name server knows, at the receiver's port."""
    return target_of(receiver.url.replace("127.0.0.1", "hooks.invalid"))


def test_the_pinned_address_is_asked_by_the_name(receiver: Receiver) -> None:
    target = elsewhere(receiver)
    send(target, b'{"a":1}')
    [(path, headers, body)] = receiver.got
    assert (path, body) == ("/positions", b'{"a":1}')
    assert (headers["Host"], headers["X-Told"]) == (f"hooks.invalid:{target.port}", "yes")
    assert headers["Content-Type"] == "application/json"
    assert headers["User-Agent"].startswith("elfslam/")


@pytest.mark.parametrize(
    ("status", "is_final"),
    [(302, True), (400, True), (410, True), (408, False), (429, False), (503, False)],
)
def test_what_is_no_success_is_told(receiver: Receiver, status: int, is_final: bool) -> None:
    receiver.statuses.append(status)
    with pytest.raises(DeliveryError, match=f"answered {status}") as refused:
        send(elsewhere(receiver))
    assert refused.value.is_final is is_final
    assert len(receiver.got) == 1


def test_nobody_there_is_told() -> None:
    with pytest.raises(DeliveryError, match="cannot be reached") as refused:
        send(target_of(f"http://127.0.0.1:{free_port()}/"))
    assert not refused.value.is_final


async def closed(writers: list[asyncio.StreamWriter]) -> None:
    """Once these are closed."""
    for writer in writers:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


async def answering(content: bytes, *, then_waits: bool) -> None:
    """Post to a server that sends this and no more."""

    async def answer(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(content)
        await writer.drain()
        writers.append(writer)
        if not then_waits:
            writer.close()

    writers: list[asyncio.StreamWriter] = []
    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        target = target_of(f"http://127.0.0.1:{port}/")
        await post(target, "127.0.0.1", b"{}", {}, timeout_s=0.2 if then_waits else 60)
    finally:
        server.close()
        await closed(writers)


def test_who_says_nothing_is_left_in_time() -> None:
    with pytest.raises(DeliveryError, match=r"did not answer in 0\.2 s"):
        asyncio.run(answering(b"HTTP/1.1 200 O", then_waits=True))


@pytest.mark.parametrize("content", [b"", b"HTTP/1.1 2", b"SSH-2.0-OpenSSH\r\n\r\n"])
def test_who_speaks_no_http_is_told(content: bytes) -> None:
    with pytest.raises(DeliveryError, match=r"cannot be reached|without an answer"):
        asyncio.run(answering(content, then_waits=False))


def test_an_endless_head_is_not_read_to_its_end() -> None:
    with pytest.raises(DeliveryError, match="cannot be reached"):
        asyncio.run(answering(b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 100_000, then_waits=False))


def tls_server(name: str) -> tuple[trustme.CA, ssl.SSLContext]:
    authority, context = trustme.CA(), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert(name).configure_cert(context)
    return authority, context


async def posted_over_tls(name: str, *, trusted: bool) -> None:
    authority, context = tls_server(name)

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 204 No Content\r\n\r\n")
        await writer.drain()
        writers.append(writer)

    writers: list[asyncio.StreamWriter] = []
    server = await asyncio.start_server(answer, "127.0.0.1", 0, ssl=context)
    port, tls = server.sockets[0].getsockname()[1], ssl.create_default_context()
    if trusted:
        authority.configure_trust(tls)
    try:
        target = target_of(f"https://hooks.invalid:{port}/")
        await post(target, "127.0.0.1", b"{}", {}, tls=tls)
    finally:
        server.close()
        await closed(writers)


def test_over_tls_the_name_is_verified_not_the_address() -> None:
    asyncio.run(posted_over_tls("hooks.invalid", trusted=True))
    with pytest.raises(DeliveryError, match="cannot be reached"):
        asyncio.run(posted_over_tls("other.invalid", trusted=True))
    with pytest.raises(DeliveryError, match="cannot be reached"):
        asyncio.run(posted_over_tls("hooks.invalid", trusted=False))


def test_the_receiver_of_the_documentation_checks_what_we_sign() -> None:
    page = (ROOT / "docs" / "how-to" / "positions.md").read_text(encoding="utf-8")
    [code] = re.findall(r"^```python\n(.*?)^```", page, re.S | re.M)
    made: dict[str, Any] = {}
    exec(code.rpartition("HTTPServer(")[0], made)  # its class, without the server on port 8000
    made["Receiver"].log_message = lambda *_: None
    body, now_s = b'{"a":1}', int(time.time())
    with serving(made["Receiver"]) as target:
        for secret, sent_s, is_good in (
            ("SECRET", now_s, True),
            ("OTHER", now_s, False),
            ("SECRET", now_s - 1000, False),
        ):
            told = post(target, "127.0.0.1", body, signed_headers(secret, sent_s, body))
            with contextlib.nullcontext() if is_good else pytest.raises(DeliveryError, match="403"):
                asyncio.run(told)


@contextlib.contextmanager
def serving(handler: type[BaseHTTPRequestHandler]) -> Iterator[Target]:
    """A server of requests, as a target."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield target_of(f"http://127.0.0.1:{server.server_port}/")
    server.shutdown()
    thread.join()
    server.server_close()
