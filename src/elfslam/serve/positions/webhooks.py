"""Posts positions to the webhooks of their maps: in batches, signed, tried a few times.

Against server-side request forgery a webhook leads to public addresses only: its name is resolved
anew for each delivery, and the connection is made to the very address that was checked, in bounded
time, following nothing. The signature is HMAC-SHA256 over the time and the body.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import socket
import ssl
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import h11
from pydantic import BaseModel
from sqlalchemy import select

from elfslam import __version__
from elfslam.base.errors import InputError
from elfslam.serve.positions.values import LivePosition
from elfslam.serve.problems import LOG
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Webhook, now_utc

if TYPE_CHECKING:
    from elfslam.serve.services import Services

PORTS = {"http": 80, "https": 443}
TRANSLATED = ipaddress.ip_network("64:ff9b::/96")
"""NAT64: the last 32 bits are an IPv4 address."""
IpAddress = ipaddress.IPv4Address | ipaddress.IPv6Address
Resolve = Callable[[str, int], Sequence[str]]


@dataclass(frozen=True)
class Target:
    """A URL that positions are posted to, in parts. `path` has the query."""

    url: str
    is_secure: bool
    host: str
    port: int
    path: str

    @property
    def authority(self) -> str:
        """Host and port as the Host header has them."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        usual = PORTS["https" if self.is_secure else "http"]
        return shown if self.port == usual else f"{shown}:{self.port}"


def target_of(url: str) -> Target:
    """The parts of a URL. Raises InputError for what is no plain http(s) URL."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
    except ValueError:
        parts, host, port = urlsplit(""), "", None
    printable = url.isascii() and url.isprintable() and " " not in url
    good = parts.scheme in PORTS and host and printable and "%" not in host and port != 0
    if not good or parts.username is not None or parts.password is not None or parts.fragment:
        raise InputError(
            f"webhook {url!r:.80}: wanted http(s)://HOST[:PORT]/PATH in ASCII, without a user or a "
            "fragment; such as https://example.org/positions"
        )
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return Target(url, parts.scheme == "https", host, port or PORTS[parts.scheme], path)


def resolved(host: str, port: int) -> Sequence[str]:
    """The addresses of a host, in the order in which they are to be tried. Raises OSError."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(info[4][0]) for info in found))


def address_of(target: Target, *, allow_local: bool, resolve: Resolve | None = None) -> str:
    """The address to connect to. Raises InputError where one of its host's is not public."""
    try:
        found = (resolve or resolved)(target.host, target.port)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or "no such name"
        raise InputError(f"webhook {target.host:.60}: is not found ({why}); check it") from error
    hidden = [address for address in found if not is_public(address)]
    if not found or (hidden and not allow_local):
        leads = hidden[0] if hidden else "nowhere"
        raise InputError(
            f"webhook {target.host:.60}: leads to {leads}, which is not public; choose another, or "
            "have the server started with --local-webhooks"
        )
    return found[0]


def is_public(address: str) -> bool:
    """Whether an address is one of the Internet: neither this machine's, nor a local network's."""
    try:
        meant = _meant(ipaddress.ip_address(address))
        return all(each.is_global and not (each.is_multicast or each.is_reserved) for each in meant)
    except ValueError:
        return False


def _meant(address: IpAddress) -> list[IpAddress]:
    """An address, and that of IPv4 which is written in it."""
    if isinstance(address, ipaddress.IPv4Address):
        return [address]
    if address.ipv4_mapped is not None:
        return [address.ipv4_mapped]
    if address in TRANSLATED:
        return [ipaddress.IPv4Address(int(address) & 0xFFFF_FFFF)]
    inside = [address.sixtofour, *(address.teredo or ())]
    return [address, *(each for each in inside if each is not None)]


TIMESTAMP, SIGNATURE = "Elfslam-Timestamp", "Elfslam-Signature"
"""Headers: seconds since 1970, and `sha256=` with the HMAC in hexadecimal."""


def signed_headers(secret: str, timestamp_s: int, body: bytes) -> dict[str, str]:
    """The headers by which a receiver knows that a body is ours, and not an old one."""
    return {TIMESTAMP: str(timestamp_s), SIGNATURE: f"sha256={digest(secret, timestamp_s, body)}"}


def digest(secret: str, timestamp_s: int, body: bytes) -> str:
    """The HMAC-SHA256 of "TIMESTAMP.BODY", in hexadecimal."""
    told = f"{timestamp_s}.".encode() + body
    return hmac.new(secret.encode(), told, hashlib.sha256).hexdigest()


TIMEOUT_S = 10.0
"""From connecting to the status."""
PIECE_BYTES = 4096


class DeliveryError(Exception):
    """A receiver did not take it. `is_final`: asking once more is no use."""

    def __init__(self, line: str, *, is_final: bool = False) -> None:
        super().__init__(line)
        self.is_final = is_final


async def post(
    target: Target,
    address: str,
    body: bytes,
    headers: Mapping[str, str],
    *,
    timeout_s: float = TIMEOUT_S,
    tls: ssl.SSLContext | None = None,
) -> None:
    """Post JSON; any status of 200 to 299 will do. Raises DeliveryError."""
    try:
        async with asyncio.timeout(timeout_s):
            status = await _status(target, address, body, headers, tls)
    except TimeoutError as error:
        raise DeliveryError(f"did not answer in {timeout_s:g} s") from error
    except (OSError, h11.ProtocolError) as error:
        why = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise DeliveryError(f"cannot be reached: {why:.120}") from error
    if not 200 <= status < 300:
        again = status >= 500 or status in (408, 425, 429)
        followed = "; redirects are not followed" if 300 <= status < 400 else ""
        raise DeliveryError(f"answered {status}{followed}", is_final=not again)


async def _status(
    target: Target,
    address: str,
    body: bytes,
    headers: Mapping[str, str],
    tls: ssl.SSLContext | None,
) -> int:
    context = (tls or ssl.create_default_context()) if target.is_secure else None
    name = target.host if target.is_secure else None
    reader, writer = await asyncio.open_connection(
        address, target.port, ssl=context, server_hostname=name
    )
    try:
        connection = h11.Connection(h11.CLIENT)
        for part in (_request(target, body, headers), h11.Data(body), h11.EndOfMessage()):
            writer.write(connection.send(part) or b"")
        await writer.drain()
        while not isinstance(event := connection.next_event(), h11.Response):
            if event is h11.NEED_DATA:
                connection.receive_data(await reader.read(PIECE_BYTES))
            elif isinstance(event, h11.ConnectionClosed):
                raise DeliveryError("closed the connection without an answer")
        return event.status_code
    finally:
        writer.transport.abort()  # what else it says is of no interest


def _request(target: Target, body: bytes, headers: Mapping[str, str]) -> h11.Request:
    told = {
        "Host": target.authority,
        "User-Agent": f"elfslam/{__version__}",
        "Content-Type": "application/json",
        "Content-Length": str(len(body)),
        "Connection": "close",
        **headers,
    }
    return h11.Request(method="POST", target=target.path, headers=list(told.items()))


MOST_WAITING = 500
"""Of one map; the oldest give way."""


@dataclass(frozen=True)
class Deliveries:
    """Positions that a webhook took, and that were dropped; the last error in one line."""

    delivered: int = 0
    dropped: int = 0
    last_delivered_utc: datetime | None = None
    last_error: str | None = None
    last_error_utc: datetime | None = None


class Outboxes:
    """What is to be posted, map by map. Safe among threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[str, deque[LivePosition]] = {}
        self._deliveries: dict[str, Deliveries] = {}
        self._forgotten_utc: dict[str, datetime] = {}

    def put(self, positions: Sequence[LivePosition]) -> None:
        """Positions that somebody may want to be posted."""
        with self._lock:
            for each in positions:
                box = self._waiting.setdefault(each.map, deque(maxlen=MOST_WAITING))
                box.append(each)

    def take(self) -> dict[str, list[LivePosition]]:
        """All that wait, by the map, and wait no longer."""
        with self._lock:
            taken, self._waiting = self._waiting, {}
        return {map_id: list(box) for map_id, box in taken.items()}

    def deliveries_of(self, webhook_id: str) -> Deliveries:
        """How it has gone since the server started."""
        with self._lock:
            return self._deliveries.get(webhook_id, Deliveries())

    def delivered(self, webhook_id: str, count: int, at_utc: datetime) -> None:
        """So many positions were taken; the last error is one of the past."""
        before = self.deliveries_of(webhook_id)
        now = replace(before, delivered=before.delivered + count, last_delivered_utc=at_utc)
        self._set(webhook_id, replace(now, last_error=None, last_error_utc=None))

    def dropped(
        self, webhook_id: str, count: int, at_utc: datetime, error: str | None = None
    ) -> None:
        """So many positions were dropped, for this reason or for want of room."""
        before = self.deliveries_of(webhook_id)
        now = replace(before, dropped=before.dropped + count)
        if error is not None:
            now = replace(now, last_error=error, last_error_utc=at_utc)
        self._set(webhook_id, now)

    def forget(self, webhook_id: str) -> None:
        """The webhook is gone."""
        with self._lock:
            self._deliveries.pop(webhook_id, None)

    def forget_walker(self, walker: str, at_utc: datetime) -> None:
        """Pass on nothing of a walker that is of this time or before."""
        with self._lock:
            self._forgotten_utc[walker] = at_utc

    def wanted(self, positions: Sequence[LivePosition]) -> list[LivePosition]:
        """Those that may still be passed on."""
        with self._lock:
            forgotten_utc = dict(self._forgotten_utc)
        return [
            each
            for each in positions
            if each.walker not in forgotten_utc or each.time_utc > forgotten_utc[each.walker]
        ]

    def _set(self, webhook_id: str, deliveries: Deliveries) -> None:
        with self._lock:
            self._deliveries[webhook_id] = deliveries


EVERY_S = 1.0
MOST_AT_ONCE = 100
"""Positions in one POST."""
PAUSES_S = (1.0, 4.0)
"""Before the second try and the third."""
LONGEST_REST_S = 60.0
"""After ever more batches that nobody took, so long passes before the next is tried."""
STOP_S = 2.0
Send = Callable[[Target, str, bytes, Mapping[str, str]], Awaitable[None]]
Pause = Callable[[float], Awaitable[None]]


class PostedPositions(BaseModel):
    """The body of a POST to a webhook."""

    map: str
    positions: list[LivePosition]


@dataclass(frozen=True)
class Hook:
    """A webhook as it is when a batch is made."""

    id: str
    map_id: str
    url: str
    secret: str = field(repr=False)


@dataclass
class _Queue:
    """What waits for one webhook, and the delivery that is going on."""

    map_id: str
    waiting: deque[LivePosition] = field(default_factory=deque)
    going: asyncio.Task[None] | None = None
    failures: int = 0
    rests_until_s: float = 0.0


class WebhookDispatcher:
    """Takes what waits in the outboxes to the webhooks. Lives in one event loop."""

    def __init__(
        self,
        outboxes: Outboxes,
        hooks_of: Callable[[Sequence[str]], list[Hook]],
        find_address: Callable[[Target], str],
        send: Send = post,
        pause: Pause = asyncio.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._outboxes, self._hooks_of, self._find_address = outboxes, hooks_of, find_address
        self._send, self._pause, self._clock = send, pause, clock
        self._queues: dict[str, _Queue] = {}

    async def dispatch(self) -> None:
        """Begin to deliver what waits. A webhook that is slow keeps no other from its own."""
        arrived = self._outboxes.take()
        maps = {*arrived, *(each.map_id for each in self._queues.values() if each.waiting)}
        if not maps:
            return
        hooks = await asyncio.to_thread(self._hooks_of, sorted(maps))
        self._forget_others(maps, {hook.id for hook in hooks})
        for hook in hooks:
            queue = self._queues.setdefault(hook.id, _Queue(hook.map_id))
            self._add(hook, queue, arrived.get(hook.map_id, []))
            is_busy = queue.going is not None and not queue.going.done()
            if queue.waiting and not is_busy and self._clock() >= queue.rests_until_s:
                queue.going = asyncio.create_task(self._deliver(hook, queue))

    async def finish(self) -> None:
        """Wait for the deliveries that are going on."""
        going = [each.going for each in self._queues.values() if each.going is not None]
        await asyncio.gather(*going)

    def _forget_others(self, maps: set[str], known: set[str]) -> None:
        """Webhooks that were deleted get nothing more."""
        for name, queue in list(self._queues.items()):
            if queue.map_id in maps and name not in known:
                del self._queues[name]

    def _add(self, hook: Hook, queue: _Queue, positions: Sequence[LivePosition]) -> None:
        queue.waiting.extend(positions)
        surplus = len(queue.waiting) - MOST_WAITING
        for _ in range(surplus):
            queue.waiting.popleft()
        if surplus > 0:
            self._outboxes.dropped(hook.id, surplus, now_utc())

    async def _deliver(self, hook: Hook, queue: _Queue) -> None:
        count = min(len(queue.waiting), MOST_AT_ONCE)
        taken = [queue.waiting.popleft() for _ in range(count)]
        batch = self._outboxes.wanted(taken)
        if not batch:
            return
        body = PostedPositions(map=hook.map_id, positions=batch).model_dump_json().encode()
        try:
            await self._try(hook, body)
        except (DeliveryError, InputError) as error:
            self._outboxes.dropped(hook.id, len(batch), now_utc(), str(error))
            queue.failures += 1
            queue.rests_until_s = self._clock() + min(2.0**queue.failures, LONGEST_REST_S)
        except Exception:
            LOG.exception("a webhook could not be posted to")
        else:
            self._outboxes.delivered(hook.id, len(batch), now_utc())
            queue.failures, queue.rests_until_s = 0, 0.0

    async def _try(self, hook: Hook, body: bytes) -> None:
        """Raises DeliveryError after the last try, InputError where the URL may not be used."""
        target = target_of(hook.url)
        for pause_s in (*PAUSES_S, None):
            address = await asyncio.to_thread(self._find_address, target)
            headers = signed_headers(hook.secret, int(time.time()), body)
            try:
                return await self._send(target, address, body, headers)
            except DeliveryError as error:
                if error.is_final or pause_s is None:
                    raise
            await self._pause(pause_s)


@contextmanager
def posting(services: Services) -> Iterator[None]:
    """Webhooks are served as long as the server runs; what is on its way then is dropped."""
    hub, stopping = services.positions, threading.Event()
    allow_local = services.settings.local_webhooks
    find_address = partial(address_of, allow_local=allow_local)
    postman = WebhookDispatcher(hub.outboxes, partial(hooks_of, services), find_address)
    work = partial(asyncio.run, _go_on(postman, stopping))
    thread = threading.Thread(target=work, name="webhooks", daemon=True)
    thread.start()
    try:
        with hub.feeding(hub.outboxes.put):
            yield
    finally:
        stopping.set()
        thread.join(STOP_S)


def hooks_of(services: Services, maps: Sequence[str]) -> list[Hook]:
    """The webhooks of maps."""
    with reading(services.sessions) as session:
        rows = session.scalars(select(Webhook).where(Webhook.map_id.in_(maps)))
        return [Hook(row.id, row.map_id, row.url, row.secret) for row in rows]


async def _go_on(postman: WebhookDispatcher, stopping: threading.Event) -> None:
    while not await asyncio.to_thread(stopping.wait, EVERY_S):
        try:
            await postman.dispatch()
        except Exception:
            LOG.exception("posting to webhooks failed")
