"""Requests made to do harm: each gets a refusal or an honest answer, and the server goes on."""

import asyncio
import errno
import os
import random
import socket
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from damage import ANYTHING
from damaged_formats import ZIPPED
from hypothesis import HealthCheck, Phase, core, given, settings
from hypothesis import strategies as st

from studies.benchmarks.served import TUS
from tests.serve.uploading import append, created, zipped

pytestmark = pytest.mark.hostile
Start = Callable[..., Any]
CASES = int(os.environ.get("HOSTILE_CASES", "200"))
ZIP_SHARE = 20
"""One case in so many uploads a whole recording, whose reading takes a process of its own."""
LONGEST_S = 60.0
TRIES = 10
"""Of a client that is asked to wait."""
OFTEN = {
    "token_requests_per_s": 1e6, "address_requests_per_s": 1e6, "open_uploads": 100_000,
    "recordings": 100_000, "silence_s": 1.0,
}  # fmt: skip
NEW_IDS = ("0" * 32, "x", "..", "%2e%2e%2f", "%00", "A" * 5000, "ä", "1' OR '1'='1")
ROUTES = (
    "/api/version", "/api/me", "/api/session", "/api/users", "/api/users/{id}", "/api/recordings",
    "/api/recordings/{id}", "/api/recordings/{id}/complete", "/api/recordings/{id}/recording.zip",
    "/api/uploads", "/api/uploads/{id}", "/api/jobs", "/api/jobs/{id}", "/api/jobs/{id}/cancel",
    "/api/maps", "/api/maps/{id}", "/api/maps/{id}/view", "/api/maps/{id}/floor-plan",
    "/api/maps/{id}/export", "/api/maps/{id}/package", "/api/key", "/api/find", "/", "/desk",
    "/api/maps/{id}/shares", "/api/maps/{id}/shares/{id}", "/api/maps/{id}/link", "/api/links/open",
    "/api/maps/delete", "/api/recordings/delete", "/api/places", "/api/people",
    "/api/maps/{id}/points-of-interest",
    "/precache.json", "/authority.pem", "/openapi.json", "/{id}", "/api/../api/me", "//", "*",
)  # fmt: skip
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "G\x00T")
JSON_BODIES = (
    b"", b"{}", b"[]", b"null", b"NaN", b"[" * 50_000, b'{"a":' * 5_000, b"9" * 6_000, b"\xff\xfe",
    b'{"name": "' + b"x" * 200_000 + b'"}', b'{"name": "\\ud800"}', b'{"name": "a\\u0000b"}',
    b'{"name": 1e999}', b'{"name": ["walk"]}', b'{"kind": "map", "recording": {"$ne": 1}}',
    b'{"files": [{"name": "../../x", "size_bytes": -1, "sha256": "zz"}]}', b'{"files": {}}',
    b'{"may": "edit"}', b'{"venue": "a", "name": "b"}',
    b'{"link": "00000000000000000000000000000000.x"}',
    b'{"files": [{"name": "audio.flac", "size_bytes": 1e400, "sha256": ""}], "map": true}',
)  # fmt: skip
HEADERS: dict[str, tuple[str, ...]] = {
    "Content-Length": ("-1", "99999999999999999999", "abc", "0x10", "5, 6", ""),
    "Transfer-Encoding": ("chunked", "gzip, chunked", "identity", "x"),
    "Content-Type": ("application/json", "text/plain", "multipart/form-data; boundary=x", "\x01",
                     "application/offset+octet-stream"),
    "Origin": ("https://evil.example", "null", "http://[", "http://127.0.0.1"),
    "Host": ("evil.example", "", "127.0.0.1:1:1", "[::1", "a" * 300),
    "Range": ("bytes=0-0,1-1,2-2", "bytes=-99999999999999999", "lines=1", "bytes=9-1"),
    "If-None-Match": ("*", '"' + "x" * 1000, "W/"),
    "Cookie": ("elfslam_link=x", "elfslam_token=", "elfslam_token=\x80; " * 20, "a" * 5000),
    "Authorization": ("Bearer", "Bearer " + "x" * 10_000, "Basic eDp4", "Bearer \xff"),
    "X-HTTP-Method-Override": ("PATCH", "DELETE", "CONNECT", "patch "),
    "X-Forwarded-For": ("8.8.8.8", "127.0.0.1, 1.1.1.1", "'"),
    "Upload-Length": ("-1", "0", "9007199254740993", "1e9", ""),
    "Upload-Offset": ("-1", "9007199254740993", "x"),
    "Upload-Defer-Length": ("1", "2", ""),
    "Upload-Metadata": ("filename", "filename !!!", "filename d2Fsay56aXA=,filename eA==",
                        "recording Li4vLi4=,filename d2lmaS5jc3Y=", "a " * 3000),
    "Upload-Checksum": ("sha256", "sha256 AAAA", "md5 AAAA", "sha256 ////"),
    "Accept-Encoding": ("gzip;q=9", "*", "\x7f"),
    "Expect": ("100-continue", "200-ok"),
    "Connection": ("upgrade", "close", "keep-alive, x"),
    "Upgrade": ("websocket", "h2c"),
}  # fmt: skip


@dataclass(frozen=True)
class Request:
    """A request as it goes over the wire."""

    method: str
    path: str
    headers: tuple[tuple[str, str], ...]
    body: bytes
    known: bool
    """Whether it carries the owner's token."""
    cut: int | None
    """After so many bytes the connection is closed."""

    def raw(self, bearer: str) -> bytes:
        """Its bytes."""
        told = dict(self.headers)
        if self.known:
            told.setdefault("Authorization", bearer)
        told.setdefault("Host", "127.0.0.1")
        if self.body and "Transfer-Encoding" not in told:
            told.setdefault("Content-Length", str(len(self.body)))
        told.setdefault("Connection", "close")
        lines = [f"{self.method} {self.path} HTTP/1.1", *(f"{k}: {v}" for k, v in told.items())]
        return "\r\n".join([*lines, "", ""]).encode("latin-1", "replace") + self.body


@st.composite
def requests(draw: st.DrawFn) -> Request:
    """Anything that somebody may send to a route."""
    path = draw(st.sampled_from(ROUTES)).replace("{id}", draw(st.sampled_from(NEW_IDS)))
    query = draw(st.sampled_from(("", "?", "?limit=-1", "?recording=%00", "?a[]=1&" * 50)))
    names = draw(st.lists(st.sampled_from(sorted(HEADERS)), max_size=4, unique=True))
    told = [(name, draw(st.sampled_from(HEADERS[name]))) for name in names]
    if path.startswith("/api/uploads") and draw(st.booleans()):
        told.append(("Tus-Resumable", "1.0.0"))
    chunked = b"5\r\nhello\r\nZZ\r\n"
    body = draw(st.sampled_from(JSON_BODIES) | st.binary(max_size=200) | st.just(chunked))
    cut = draw(st.none() | st.integers(0, 400))
    known = draw(st.integers(0, 3)) > 0
    method = draw(st.sampled_from(METHODS))
    return Request(method, path + query, tuple(told), body, known, cut)


def damaged(content: bytes, seed: int) -> bytes:
    """A .zip that was cut off, changed, or made to mislead."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "walk.zip")
        file.write_bytes(content)
        chance.choice((*ANYTHING, *ZIPPED, *ZIPPED, *ZIPPED))(file, chance)
        return file.read_bytes()


@dataclass(frozen=True)
class Attacked:
    """A server, and a whole recording that it would take."""

    server: Any
    walk: bytes

    def client(self) -> httpx.Client:
        """Of its owner."""
        return httpx.Client(base_url=self.server.url, headers=self.server.bearer, timeout=LONGEST_S)


@pytest.fixture(scope="module")
def attacked(start_server: Start, walk_files: dict[str, bytes]) -> Iterator[Attacked]:
    """A server whose process and answers are looked at when all is over."""
    server = start_server(**OFTEN)
    attacked = Attacked(server, zipped(walk_files, method=zipfile.ZIP_STORED))
    yield attacked
    assert server.process.poll() is None, "the server ended"
    with attacked.client() as client:
        assert client.get("/api/me").json()["is_owner"] is True
        assert uploaded(client, attacked.walk).headers["elfslam-recording"]
    assert rss_bytes(server.process.pid) < 2**30


def rss_bytes(pid: int) -> int:
    """The most memory that a process has had."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))


def answer_of(url: str, raw: bytes) -> bytes:
    """What is answered to bytes, as long as the connection lives."""
    where = urlsplit(url)
    with socket.create_connection((where.hostname, where.port), timeout=LONGEST_S) as connection:
        try:
            connection.sendall(raw)
            connection.shutdown(socket.SHUT_WR)
            return connection.makefile("rb").read()
        except OSError as error:
            if isinstance(error, ConnectionError) or error.errno == errno.ENOTCONN:
                return b""
            raise


CAREFUL = settings(
    max_examples=CASES,
    deadline=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
    derandomize=core.global_force_seed is None,
)


@CAREFUL
@given(request=requests())
def test_no_request_is_the_servers_mistake(attacked: Attacked, request: Request) -> None:
    raw = request.raw(attacked.server.bearer["Authorization"])
    answer = answer_of(attacked.server.url, raw if request.cut is None else raw[: request.cut])
    if answer:
        head = answer.split(b"\r\n", 1)[0]
        assert head.startswith(b"HTTP/1."), head
        status = int(head.split()[1])
        assert status < 500 or status == 503, (head, request)
        assert b"Traceback" not in answer


def uploaded(client: httpx.Client, content: bytes) -> httpx.Response:
    """The HEAD of an upload of a whole recording, when all of it has come."""
    place = created(client, len(content), filename="walk.zip").headers["location"]
    sent = append(client, place, 0, content)
    assert sent.status_code == 204, sent.text
    return client.head(place, headers=TUS)


@settings(CAREFUL, max_examples=max(5, CASES // ZIP_SHARE))
@given(seed=st.integers(0, 2**32))
def test_a_zip_that_is_none_becomes_a_refused_recording(attacked: Attacked, seed: int) -> None:
    content = damaged(attacked.walk, seed)
    with attacked.client() as client:
        head = uploaded(client, content)
        assert head.status_code == 200
        told = client.get(f"/api/recordings/{head.headers['elfslam-recording']}").json()
        assert told["state"] in ("ready", "refused")
        assert "\n" not in (told["refusal"] or "")
        assert "Traceback" not in (told["refusal"] or "")


@pytest.mark.parametrize("path", ["/api/me", "/api/uploads", "/"])
@pytest.mark.parametrize("header", sorted(HEADERS))
def test_every_header_value_on_every_kind_of_route(
    attacked: Attacked, path: str, header: str
) -> None:
    for value in HEADERS[header]:
        for method in ("GET", "POST", "PATCH"):
            request = Request(method, path, ((header, value),), b"{}", True, None)
            for each in (request, replace(request, known=False)):
                answer = answer_of(
                    attacked.server.url, each.raw(attacked.server.bearer["Authorization"])
                )
                status = int(answer.split(b" ", 2)[1]) if answer else 400
                assert status < 500 or status == 503, (value, method, answer[:200])


def test_five_hundred_uploads_that_begin_at_once_all_begin(attacked: Attacked) -> None:
    told = {**TUS, "Upload-Metadata": "filename d2Fsay56aXA=", "Upload-Length": "100"}

    async def begin(client: httpx.AsyncClient) -> int:
        for _ in range(TRIES):
            answer = await client.post("/api/uploads", headers=told)
            if answer.status_code != 503:
                break
            await asyncio.sleep(float(answer.headers["Retry-After"]))
        return answer.status_code

    async def storm() -> list[int]:
        bearer = attacked.server.bearer
        where = {"base_url": attacked.server.url, "headers": bearer, "timeout": LONGEST_S}
        limits = httpx.Limits(max_connections=50)
        async with httpx.AsyncClient(**where, limits=limits) as client:
            return list(await asyncio.gather(*(begin(client) for _ in range(500))))

    assert set(asyncio.run(storm())) == {201}
