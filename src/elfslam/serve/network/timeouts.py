"""How long the server waits for a client: for handshakes, requests, and reading of answers.

The body of a request that is being answered is waited for by whoever reads it, `people/bodies.py`,
as a client that is too slow is then told so.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from elfslam.serve.network.visitors import Visitors
from elfslam.serve.settings import Limits

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
