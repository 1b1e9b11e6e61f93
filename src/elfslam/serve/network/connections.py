"""Who is connected: so many at once, whose connection ends where more come, how long it may wait.

A connection waits for its client while the client owes something: the rest of a handshake or of a
request, the next request, or reading what was sent. Of those the one that has waited longest ends
for a newcomer. One that the server works for never does. The body of a request that is being
answered is waited for by `people/guards.py`, as a client that is too slow is then told so.
"""

import asyncio
import gc
import ipaddress
import re
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from elfslam.serve.settings import Limits

NEIGHBOURS = 64
"""Bits of an IPv6 address that a provider gives to one customer: all below are one visitor."""
SENT_BYTES = 2**18
"""The system holds so much for one who does not read it; by itself it takes 16 times as much."""
PLAIN_REQUEST = re.compile(
    rb"(?:GET|HEAD) (/[!-~]*) HTTP/1\.[01]\r\n(?:[^\r\n]+\r\n)*?host: *([\w.:\[\]-]+)\r\n", re.I
)
"""Of a browser; what else comes without TLS ends as any failed handshake."""
TIDY_EACH = 256
"""asyncio leaves a ring of garbage, 300 kB large, of a TLS handshake that fails; Python by itself
would let a gigabyte of it come together."""


@dataclass(eq=False)
class Connection:
    """A connection, how to end it, and since when it waits for its client; None: it does not."""

    visitor: str
    end: Callable[[], None]
    waiting_since_s: float | None

    def credit(self, earned_s: float, now_s: float) -> None:
        """The client has sent what it has so much time for."""
        since_s = now_s if self.waiting_since_s is None else self.waiting_since_s
        self.waiting_since_s = min(now_s, since_s + earned_s)


class Visitors:
    """The connections there are, by the numbers of their sockets. For one thread."""

    def __init__(
        self, most: int, most_of_one: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._most, self._most_of_one, self._clock = most, most_of_one, clock
        self._visits: dict[int, Connection] = {}

    def enter(self, number: int, address: str, end: Callable[[], None]) -> bool:
        """Whether a newcomer may stay; another connection has ended where that was wanted."""
        visitor = visitor_of(address)
        own = {key: each for key, each in self._visits.items() if each.visitor == visitor}
        full = self._visits if len(self._visits) >= self._most else {}
        crowd = own if len(own) >= self._most_of_one else full
        if crowd and not self._end_one(crowd):
            return False
        self._visits[number] = Connection(visitor, end, self._clock())
        return True

    def leave(self, number: int) -> None:
        """A connection has ended."""
        self._visits.pop(number, None)

    def of(self, number: int) -> Connection:
        """The visit on a socket; one that is not counted any more where it was just ended."""
        return self._visits.get(number) or Connection("", lambda: None, None)

    def _end_one(self, visits: Mapping[int, Connection]) -> bool:
        """End the one that waits longest; False where the server works for all of them."""
        waiting = [
            (visit.waiting_since_s, number)
            for number, visit in visits.items()
            if visit.waiting_since_s is not None
        ]
        if waiting:
            self._visits.pop(min(waiting)[1]).end()
        return bool(waiting)


class CountingListener(socket.socket):
    """A listening socket that counts connections from before any handshake to their end."""

    def __init__(
        self, listening: socket.socket, visitors: Visitors, *, speaks_tls: bool = False
    ) -> None:
        super().__init__(fileno=listening.detach())
        self.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SENT_BYTES)
        self._visitors, self._accepted, self._speaks_tls = visitors, 0, speaks_tls

    def listen(self, backlog: int = 0) -> None:
        """It does so already, with a longer queue than what asyncio accepts at once."""

    def accept(self) -> tuple[socket.socket, Any]:
        """A connection that may stay. Raises ConnectionAbortedError where it may not."""
        accepted, address = super().accept()
        self._accepted += 1
        if self._accepted % TIDY_EACH == 0:
            gc.collect()
        kind = _CountedTls if self._speaks_tls else _Counted
        connection = kind(accepted, self._visitors)
        if not self._visitors.enter(connection.fileno(), address[0], connection.end):
            connection.close()
            raise ConnectionAbortedError("too many connections")
        return connection, address


class _Counted(socket.socket):
    """A connection that is counted until it is closed."""

    def __init__(self, accepted: socket.socket, visitors: Visitors) -> None:
        super().__init__(fileno=accepted.detach())
        self._visitors = visitors

    def end(self) -> None:
        """Let whoever reads it find its end, and close it."""
        with suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._visitors.leave(self.fileno())
        super().close()


def visitor_of(address: str) -> str:
    """Who is at an address: a network of IPv6 belongs to one, but for local ones."""
    told = ipaddress.ip_address(address.partition("%")[0])
    found = getattr(told, "ipv4_mapped", None) or told
    if found.version == 4 or not found.is_global:
        return str(found)
    return str(ipaddress.ip_network((found, NEIGHBOURS), strict=False))


class _CountedTls(_Counted):
    """One that TLS is to be spoken on: a browser that speaks HTTP is sent to HTTPS."""

    _begun = False

    def recv_into(self, buffer: Any, nbytes: int = 0, flags: int = 0) -> int:
        """What came; nothing more after a request without TLS, which is answered here."""
        count = super().recv_into(buffer, nbytes, flags)
        if not self._begun and count:
            self._begun = True
            answer = redirect_to_https(bytes(buffer[:count]))
            if answer is not None:
                with suppress(OSError):
                    self.send(answer)
                return 0
        return count


def redirect_to_https(begun: bytes) -> bytes | None:
    """The answer to what a connection begins with: None where that is TLS, or no whole request."""
    found = PLAIN_REQUEST.match(begun)
    if found is None:
        return None
    target, host = found.groups()
    return (
        b"HTTP/1.1 307 Temporary Redirect\r\nLocation: https://%b%b\r\nContent-Length: 0\r\n"
        b"Connection: close\r\n\r\n" % (host, target)
    )


LENGTHS = (b"content-length", b"transfer-encoding")
HEAD_END = re.compile(rb"\r\n\r\n|\n\r?\n")
AMBIGUOUS = re.compile(rb"(?<!\r)\n|\r(?!\n|\Z)|\n[ \t]")
HEAD_BYTES = 2**14
"""Of a request, at most."""
HELD_BYTES = 2**16
"""What waits for somebody to read it; over TLS asyncio would hold eight times as much."""


class Deadline:
    """Something that happens unless it is called off in time."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, seconds: float, then: Callable[[], None]
    ) -> None:
        self._loop, self._seconds, self._then = loop, seconds, then
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        """Begin to wait, if that has not begun."""
        if self._timer is None:
            self._timer = self._loop.call_later(self._seconds, self._then)

    def end(self) -> None:
        """Wait no longer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class PatientConfig(uvicorn.Config):
    """What uvicorn is told, and what its loop and protocol have to know here."""

    def __init__(self, visitors: Visitors, limits: Limits, **told: Any) -> None:
        super().__init__(**told, http=PatientProtocol)
        self.visitors, self.limits = visitors, limits

    def get_loop_factory(self) -> Callable[[], asyncio.AbstractEventLoop]:
        """Makes the loop; no other accepts by a method of the listening socket."""
        return partial(PatientLoop, self.limits.head_s)


class PatientLoop(asyncio.SelectorEventLoop):
    """asyncio's loop, whose servers wait a minute for a TLS handshake; this one waits less."""

    def __init__(self, handshake_s: float) -> None:
        super().__init__()
        self._handshake_s = handshake_s

    async def create_server(self, *given: Any, **named: Any) -> asyncio.Server:
        """As asyncio does it."""
        if named.get("ssl") is not None:
            named |= dict.fromkeys(
                ("ssl_handshake_timeout", "ssl_shutdown_timeout"), self._handshake_s
            )
        return await super().create_server(*given, **named)


class StrictConnection(h11.Connection):
    """HTTP/1.1 as every proxy reads it: what two could read in two ways is refused."""

    def next_event(self) -> Any:
        """As h11 has it. Raises h11.RemoteProtocolError, also for an ambiguous head."""
        if self.their_state is h11.IDLE:
            _refuse_ambiguous_lines(self.trailing_data[0])
        event = super().next_event()
        if isinstance(event, h11.Request):
            _refuse_ambiguous_length(event)
        return event


def _refuse_ambiguous_lines(begun: bytes) -> None:
    """Lines of a head end in CRLF alone, and none goes on with the one before."""
    head = begun[: found.end()] if (found := HEAD_END.search(begun)) else begun
    if AMBIGUOUS.search(head):
        raise h11.RemoteProtocolError("bare LF, bare CR or folded line", error_status_hint=400)


def _refuse_ambiguous_length(request: h11.Request) -> None:
    """A body has one length, said in one way."""
    names = [name for name, _ in request.headers if name in LENGTHS]
    old = request.http_version != b"1.1" and b"transfer-encoding" in names
    if len(names) > 1 or old:
        raise h11.RemoteProtocolError("several lengths", error_status_hint=400)


class PatientProtocol(H11Protocol):
    """HTTP/1.1 with ends to waiting; tells the visit of its connection whose turn it is."""

    config: PatientConfig

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.conn = StrictConnection(h11.SERVER, HEAD_BYTES)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        transport.set_write_buffer_limits(HELD_BYTES)
        limits = self.config.limits
        self._visit = self.config.visitors.of(transport.get_extra_info("socket").fileno())
        self._request = Deadline(self.loop, limits.head_s, transport.abort)
        self._reading = Deadline(self.loop, limits.silence_s, transport.abort)
        self._request.begin()

    def connection_lost(self, exc: Exception | None) -> None:
        self._request.end()
        self._reading.end()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if not self._answers():
            self._request.begin()
            return
        self._request.end()
        if self.cycle.more_body:
            earned_s = len(data) / self.config.limits.slowest_bytes_per_s
            self._visit.credit(earned_s, time.monotonic())
        else:
            self._visit.waiting_since_s = None

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._after_answer()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self._after_answer()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._visit.waiting_since_s = time.monotonic()
        self._reading.begin()

    def resume_writing(self) -> None:
        super().resume_writing()
        self._reading.end()
        if self._answers() and not self.cycle.more_body:
            self._visit.waiting_since_s = None

    def _answers(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def _after_answer(self) -> None:
        """It is the client's turn: the next request, or what it still owes of this one."""
        if self._answers():
            return
        self._visit.waiting_since_s = time.monotonic()
        if self.transport.is_closing() or self.conn.their_state is h11.SEND_BODY:
            self._request.begin()
