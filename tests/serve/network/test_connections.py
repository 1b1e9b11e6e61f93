"""Who may stay connected, by a planted clock."""

import asyncio
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send

from elfslam.serve.network.authority import Certificate, server_certificate, utc_now
from elfslam.serve.network.connections import (
    CountingListener,
    PatientConfig,
    Visitors,
    redirect_to_https,
    visitor_of,
)
from elfslam.serve.settings import Limits


class Hall:
    """Visitors whose time is told, and the numbers of the connections that were ended."""

    def __init__(self, most: int, most_of_one: int) -> None:
        self.now_s, self.ended = 0.0, list[int]()
        self.visitors = Visitors(most, most_of_one, lambda: self.now_s)

    def enter(self, number: int, address: str) -> bool:
        """A connection, a second after the last."""
        self.now_s += 1
        return self.visitors.enter(number, address, lambda: self.ended.append(number))

    def works_for(self, *numbers: int) -> None:
        """The server, not the client, has something to do."""
        for number in numbers:
            self.visitors.of(number).waiting_since_s = None


def test_an_address_over_its_share_ends_its_own_longest_wait() -> None:
    hall = Hall(most=10, most_of_one=2)
    assert [hall.enter(1, "10.0.0.9"), hall.enter(2, "10.0.0.1")] == [True, True]
    assert [hall.enter(3, "10.0.0.1"), hall.enter(4, "10.0.0.1")] == [True, True]
    assert hall.ended == [2]
    hall.works_for(3)
    assert hall.enter(5, "10.0.0.1")
    assert hall.ended == [2, 4]


def test_an_address_that_is_worked_for_is_refused_more() -> None:
    hall = Hall(most=10, most_of_one=2)
    hall.enter(1, "10.0.0.1")
    hall.enter(2, "10.0.0.1")
    hall.works_for(1, 2)
    assert not hall.enter(3, "10.0.0.1")
    assert hall.enter(4, "10.0.0.2")
    assert hall.ended == []
    hall.visitors.leave(1)
    assert hall.enter(5, "10.0.0.1")


def test_a_full_house_ends_whoever_waits_longest() -> None:
    hall = Hall(most=3, most_of_one=3)
    for number in (1, 2, 3):
        hall.enter(number, f"10.0.0.{number}")
    hall.works_for(1)
    assert hall.enter(4, "10.0.0.4")
    assert hall.ended == [2]
    hall.works_for(3, 4)
    assert not hall.enter(5, "10.0.0.5")
    hall.visitors.of(4).waiting_since_s = hall.now_s
    assert hall.enter(6, "10.0.0.6")
    assert hall.ended == [2, 4]


def test_who_sends_at_the_pace_outlasts_who_drips() -> None:
    hall = Hall(most=3, most_of_one=3)
    for number in (1, 2, 3):
        hall.enter(number, f"10.0.0.{number}")
    hall.now_s = 100.0
    hall.visitors.of(1).credit(1000.0, hall.now_s)
    hall.visitors.of(2).credit(0.002, hall.now_s)
    hall.visitors.of(3).credit(50.0, hall.now_s)
    for number in (4, 5):
        hall.enter(number, "10.0.0.9")
    assert hall.ended == [2, 3]


def test_time_cannot_be_saved_up() -> None:
    hall = Hall(most=1, most_of_one=1)
    hall.enter(1, "10.0.0.1")
    hall.visitors.of(1).credit(1000.0, 50.0)
    assert hall.visitors.of(1).waiting_since_s == 50.0


@pytest.mark.parametrize(
    ("address", "visitor"),
    [
        ("10.0.0.1", "10.0.0.1"),
        ("::ffff:8.8.8.8", "8.8.8.8"),
        ("2a00:1450:4001:82a::200e", "2a00:1450:4001:82a::/64"),
        ("2a00:1450:4001:82a:1:2:3:4", "2a00:1450:4001:82a::/64"),
        ("fe80::1%eth0", "fe80::1"),
        ("::1", "::1"),
    ],
)
def test_who_is_at_an_address(address: str, visitor: str) -> None:
    assert visitor_of(address) == visitor


def test_a_door_counts_until_a_connection_is_closed() -> None:
    visitors = Visitors(10, 1)
    door = CountingListener(socket.create_server(("127.0.0.1", 0)), visitors)
    with door, socket.create_connection(door.getsockname()) as first:
        connection, _ = door.accept()
        visitors.of(connection.fileno()).waiting_since_s = None
        with socket.create_connection(door.getsockname()) as second:
            with pytest.raises(ConnectionAbortedError):
                door.accept()
            assert second.recv(1) == b""
        connection.close()
        assert first.recv(1) == b""
        with socket.create_connection(door.getsockname()):
            connection, _ = door.accept()
            connection.close()


@pytest.mark.parametrize(
    ("begun", "where"),
    [
        (b"GET / HTTP/1.1\r\nHost: a.b:81\r\n\r\n", b"https://a.b:81/"),
        (b"HEAD /desk?x=1 HTTP/1.0\r\nA: b\r\nhost:10.0.0.7\r\n", b"https://10.0.0.7/desk?x=1"),
        (b"GET / HTTP/1.1\r\nHost: [fd12::1]:81\r\n", b"https://[fd12::1]:81/"),
    ],
)
def test_a_browser_without_tls_is_sent_to_https(begun: bytes, where: bytes) -> None:
    answer = redirect_to_https(begun)
    assert answer is not None
    assert b"\r\nLocation: " + where + b"\r\n" in answer
    assert answer.endswith(b"\r\n\r\n")


@pytest.mark.parametrize(
    "begun",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"POST / HTTP/1.1\r\nHost: a\r\n",
        b"GET / HTTP/1.1\r\n\r\nHost: a\r\n",
        b"GET //x\r\ny HTTP/1.1\r\nHost: a\r\n",
        b"GET / HTTP/1.1\r\nHost: a/b\r\n",
        b"",
    ],
)
def test_what_is_no_request_of_a_browser_is_not_answered(begun: bytes) -> None:
    assert redirect_to_https(begun) is None


HOST = "127.0.0.1"
SHORT_S, LONG_S = 0.2, 30.0
QUICK = Limits(head_s=SHORT_S, silence_s=SHORT_S)
PATIENT = Limits(head_s=LONG_S, silence_s=LONG_S)
HEAD = b"HTTP/1.1\r\nHost: 127.0.0.1\r\n"
OK = b"HTTP/1.1 200"


@dataclass
class App:
    """Answers at once, after `/long`, without an end, or not before the client has left."""

    begun: threading.Event = field(default_factory=threading.Event)
    left: threading.Event = field(default_factory=threading.Event)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        self.begun.set()
        if scope["path"] == "/wait":
            await self._leaving(receive)
        if scope["path"] == "/long":
            await asyncio.sleep(2 * SHORT_S)
        length = [] if scope["path"] == "/endless" else [(b"content-length", b"2")]
        await send({"type": "http.response.start", "status": 200, "headers": length})
        if scope["path"] == "/endless":
            leaving = asyncio.create_task(self._leaving(receive))
            while not leaving.done():
                piece = {"body": bytes(2**16), "more_body": True}
                await send({"type": "http.response.body", **piece})
                await asyncio.sleep(0)
        await send({"type": "http.response.body", "body": b"ok"})

    async def _leaving(self, receive: Receive) -> None:
        while (await receive())["type"] != "http.disconnect":
            pass
        self.left.set()


@dataclass(frozen=True)
class Served:
    """A server in a thread of its own."""

    app: App
    address: tuple[str, int]

    def send(self, first: bytes = b"") -> socket.socket:
        """A connection on which that was sent."""
        made = socket.socket()
        made.settimeout(LONG_S)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**12)
        made.connect(self.address)
        made.sendall(first)
        return made

    def send_get(self, path: str = "/") -> socket.socket:
        """A connection on which a request was sent."""
        return self.send(b"GET " + path.encode() + b" " + HEAD + b"\r\n")


Serve = Callable[..., Served]


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Starts servers, each of an app, limits and visitors; all are stopped at the end."""
    running: list[tuple[uvicorn.Server, threading.Thread]] = []

    def served(
        limits: Limits, most_of_one: int = 100, certificate: Certificate | None = None
    ) -> Served:
        app, visitors = App(), Visitors(100, most_of_one)
        config = PatientConfig(
            visitors,
            limits,
            app=app,
            lifespan="off",
            log_config=None,
            timeout_graceful_shutdown=0,
            timeout_keep_alive=60,
            ssl_certfile=None if certificate is None else certificate.certificate,
            ssl_keyfile=None if certificate is None else certificate.key,
        )
        server, door = (
            uvicorn.Server(config),
            CountingListener(socket.create_server((HOST, 0)), visitors),
        )
        address = door.getsockname()
        thread = threading.Thread(target=server.run, kwargs={"sockets": [door]})
        thread.start()
        running.append((server, thread))
        return Served(app, address)

    yield served
    for server, thread in running:
        server.should_exit = True
        thread.join()


CODED, NO_CHUNKS = b"Transfer-Encoding: chunked\r\n", b"\r\n0\r\n\r\n"
TWO_WAYS = {
    "both lengths": b"Content-Length: 5\r\n" + CODED + NO_CHUNKS,
    "both, the other way round": CODED + b"Content-Length: 5\r\n" + NO_CHUNKS,
    "two lengths": b"Content-Length: 5\r\nContent-Length: 6\r\n\r\nhello!",
    "two lengths in one": b"Content-Length: 5, 6\r\n\r\nhello!",
    "a signed length": b"Content-Length: +5\r\n\r\nhello",
    "two codings": b"Transfer-Encoding: chunked, identity\r\n" + NO_CHUNKS,
    "two headers of codings": CODED + CODED + NO_CHUNKS,
    "an unknown coding": b"Transfer-Encoding: xchunked\r\n" + NO_CHUNKS,
    "a space before the colon": b"Transfer-Encoding : chunked\r\n" + NO_CHUNKS,
    "a folded line": b"Transfer-Encoding:\r\n chunked\r\n" + NO_CHUNKS,
    "a folded line of something else": b"X: a\r\n\tb\r\n\r\n",
    "a bare LF": b"X: a\n" + CODED + NO_CHUNKS,
    "a bare LF at the end": b"Content-Length: 0\n\n",
    "a bare LF in the end": b"Content-Length: 0\r\n\n",
    "a bare CR": b"X: a\r" + CODED + NO_CHUNKS,
    "chunks of an old request": CODED + NO_CHUNKS,
}


@pytest.mark.parametrize("case", TWO_WAYS)
def test_what_two_could_read_in_two_ways_is_refused(serve: Serve, case: str) -> None:
    served = serve(PATIENT)
    second = b"GET /second " + HEAD + b"\r\n"
    head = HEAD.replace(b"1.1", b"1.0") if "old" in case else HEAD
    with served.send(b"POST / " + head + TWO_WAYS[case] + second) as connection:
        came = answer_of(connection)
    assert came.startswith(b"HTTP/1.1 400 ")
    assert came.count(b"HTTP/1.1 ") == 1
    assert b"connection: close" in came.lower()
    assert not served.app.begun.is_set()


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_two_good_requests_come_in_pieces(serve: Serve, size: int) -> None:
    chunked = b"Transfer-Encoding: chunked\r\n\r\n5\r\na\nb\r\r\r\n0\r\n\r\n"
    last = b"Connection: close\r\nContent-Length: 3\r\n\r\n\n \n"
    sent = b"POST / " + HEAD + chunked + b"POST / " + HEAD + last
    with serve(PATIENT).send() as connection:
        for begin in range(0, len(sent), size):
            connection.sendall(sent[begin : begin + size])
        assert answer_of(connection).count(OK) == 2


def answered(connection: socket.socket) -> bool:
    """Whether one whole answer comes."""
    came = b""
    while not came.endswith(b"\r\n\r\nok") and (more := connection.recv(2**12)):
        came += more
    return came.startswith(OK)


def answer_of(connection: socket.socket) -> bytes:
    """What comes until the end."""
    came = b""
    while more := connection.recv(2**16):
        came += more
    return came


def test_dripping_does_not_put_the_end_off(serve: Serve) -> None:
    served = serve(QUICK)
    with served.send(b"GET / " + HEAD + b"X-Slow: ") as slow:
        slow.settimeout(SHORT_S / 8)
        began_s = time.monotonic()
        with suppress(ConnectionError):  # of a byte that comes after the end
            while time.monotonic() < began_s + LONG_S:
                try:
                    assert slow.recv(1) == b""
                    break
                except TimeoutError:
                    slow.send(b"a")
        assert time.monotonic() < began_s + LONG_S / 2


def test_the_second_head_on_a_connection_has_no_more_time(serve: Serve) -> None:
    served = serve(QUICK)
    with served.send_get() as kept:
        assert answered(kept)
        kept.sendall(b"GET / " + HEAD + b"X-Slow: ")
        assert answer_of(kept) == b""


def test_what_an_answered_request_still_owes_has_no_more_time(serve: Serve) -> None:
    served = serve(QUICK)
    with served.send(b"POST / " + HEAD + b"Content-Length: 100\r\n\r\nx") as slow:
        assert answer_of(slow).startswith(OK)


def test_an_answer_may_take_as_long_as_it_takes(serve: Serve) -> None:
    served = serve(QUICK)
    with served.send_get("/long") as honest:
        assert answered(honest)


def test_who_does_not_read_is_cut(serve: Serve) -> None:
    served = serve(QUICK)
    with served.send_get("/endless"):
        assert served.app.left.wait(LONG_S)


def test_who_reads_is_not_cut(serve: Serve) -> None:
    served = serve(Limits(silence_s=0.5))
    with served.send_get("/endless") as reader:
        until_s = time.monotonic() + 0.9
        while time.monotonic() < until_s:
            assert reader.recv(2**16) != b""
    assert served.app.left.wait(LONG_S)


@pytest.fixture
def certificate(tmp_path: Path) -> Certificate:
    """One of an authority of its own."""
    return server_certificate(tmp_path, [HOST], utc_now())


def trusting(certificate: Certificate) -> ssl.SSLContext:
    """Whoever trusts that authority."""
    return ssl.create_default_context(
        cafile=str(certificate.certificate.with_name("authority.pem"))
    )


@pytest.mark.parametrize(
    ("is_secure", "first"),
    [(False, b""), (False, b"G"), (False, b"GET / " + HEAD + b"X-Slow: "), (True, b""),
     (True, b"\x16\x03\x01")],
)  # fmt: skip
def test_a_head_or_a_handshake_that_drips_is_cut(
    serve: Serve, certificate: Certificate, is_secure: bool, first: bytes
) -> None:
    with serve(QUICK, certificate=certificate if is_secure else None).send(first) as slow:
        assert answer_of(slow) == b""


def test_a_handshake_makes_room_for_the_next(serve: Serve, certificate: Certificate) -> None:
    served = serve(PATIENT, most_of_one=1, certificate=certificate)
    with served.send(b"\x16\x03\x01") as slow, served.send() as plain:
        with trusting(certificate).wrap_socket(plain, server_hostname=HOST) as honest:
            honest.sendall(b"GET / " + HEAD + b"\r\n")
            assert answered(honest)
        assert answer_of(slow) == b""


def test_over_tls_a_head_is_cut_as_well(serve: Serve, certificate: Certificate) -> None:
    served = serve(Limits(head_s=1.0), certificate=certificate)
    with trusting(certificate).wrap_socket(served.send(), server_hostname=HOST) as slow:
        slow.sendall(b"GET / " + HEAD)
        assert slow.recv(1) == b""


@pytest.mark.parametrize(
    "first",
    [
        b"",
        b"GET / " + HEAD + b"X-Slow: ",
        b"GET / " + HEAD + b"\r\n",
        b"POST /wait " + HEAD + b"Content-Length: 9\r\n\r\n",
    ],
    ids=["silence", "head", "idle", "body"],
)
def test_a_newcomer_ends_what_waits_for_its_client(serve: Serve, first: bytes) -> None:
    served = serve(PATIENT, most_of_one=1)
    with served.send(first) as slow:
        if first.endswith(b"\r\n\r\n") and first.startswith(b"GET"):
            assert answered(slow)
        with served.send_get() as honest:
            assert answered(honest)
        assert answer_of(slow) == b""


def test_a_newcomer_ends_nothing_that_is_worked_for(serve: Serve) -> None:
    served = serve(PATIENT, most_of_one=1)
    with served.send_get("/wait"):
        assert served.app.begun.wait(LONG_S)
        with served.send() as second, suppress(ConnectionResetError):
            assert second.recv(1) == b""
        assert not served.app.left.is_set()
    assert served.app.left.wait(LONG_S)
