"""Posts positions to the webhooks of their maps: in batches, signed, tried a few times."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from pydantic import BaseModel
from sqlalchemy import select

from elfslam.base.errors import InputError
from elfslam.serve.positions.delivery import DeliveryError, post
from elfslam.serve.positions.outboxes import MOST_WAITING, Outboxes
from elfslam.serve.positions.signature import signed_headers
from elfslam.serve.positions.tables import Webhook
from elfslam.serve.positions.targets import Target, address_of, target_of
from elfslam.serve.positions.values import LivePosition
from elfslam.serve.problems import LOG
from elfslam.serve.services import Services
from elfslam.serve.store.database import now_utc, reading

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
