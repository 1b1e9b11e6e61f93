"""Where positions arrive and whence they go: the board of live ones, history, MQTT and webhooks.

Live positions are in memory alone; whoever listens gets server-sent events (HTML standard, 9.2).
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Literal

from elfslam.serve.positions.values import LivePosition
from elfslam.serve.positions.webhooks import Outboxes

if TYPE_CHECKING:
    from elfslam.serve.services import Rates

LASTS_S = 10.0
"""Whoever has told nothing for so long is shown no more."""
MOST_WALKS = 10
"""Of one walker, at once; the oldest gives way."""
MOST_WAITING = 1000
"""Events that wait for one listener; the oldest give way."""
Kind = Literal["position", "gone"]
Walk = tuple[str, str]
"""A walker's id and their walk's."""


@dataclass(frozen=True)
class Event:
    """Something that listeners are told: a position, or that a walk is shown no more; as JSON."""

    kind: Kind
    data: str


class Listener:
    """What was told and was not taken yet. Filled from any thread, taken from in one event loop."""

    def __init__(self, user_id: str) -> None:
        self.user_id = user_id
        self._loop, self._told = asyncio.get_running_loop(), asyncio.Event()
        self._waiting: deque[Event] = deque(maxlen=MOST_WAITING)

    def put(self, events: Sequence[Event]) -> None:
        """Add to what waits, and wake whoever takes it."""
        self._waiting.extend(events)
        with suppress(RuntimeError):  # the loop has ended, and with it whoever listened
            self._loop.call_soon_threadsafe(self._told.set)

    async def take(self, patience_s: float) -> list[Event]:
        """All that waits, as soon as there is anything; nothing where nothing comes in time."""
        with suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                await self._told.wait()
        self._told.clear()
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken


class Board:
    """Where everybody is that consents. Safe among threads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._maps: dict[str, dict[Walk, tuple[LivePosition, float]]] = {}
        self._listeners: dict[str, set[Listener]] = {}
        self.is_closed = False

    def tell(self, positions: Sequence[LivePosition]) -> None:
        """Show positions, oldest first, and tell whoever listens."""
        with self._lock:
            self._forget_old()
        for each in positions:
            with self._lock:
                walks = self._maps.setdefault(each.map, {})
                walks.pop((each.walker, each.walk), None)
                walks[each.walker, each.walk] = each, self._clock()
                self._forget_surplus(each.walker)
            self._tell(each.map, [Event("position", each.model_dump_json())])

    def leave(self, walker: str, walk: str | None = None) -> None:
        """Show a walk no more, or all of a walker."""
        with self._lock:
            gone = [
                (map_id, key)
                for map_id, walks in self._maps.items()
                for key in walks
                if key[0] == walker and walk in (None, key[1])
            ]
            for map_id, key in gone:
                self._drop(map_id, key)
        for map_id, key in gone:
            self._tell(map_id, [_gone(key)])

    def clear(self, map_id: str) -> None:
        """Show nobody in a map any more."""
        with self._lock:
            gone = list(self._maps.pop(map_id, {}))
        self._tell(map_id, [_gone(key) for key in gone])

    def there(self, map_id: str) -> list[LivePosition]:
        """Who is in a map now, each walk's last position, by name."""
        with self._lock:
            self._forget_old()
            found = [position for position, _ in self._maps.get(map_id, {}).values()]
        return sorted(found, key=lambda each: (each.name, each.walk))

    @contextmanager
    def listening(self, map_id: str, user_id: str) -> Iterator[Listener]:
        """Somebody who is told what happens in a map, in the event loop that runs."""
        listener = Listener(user_id)
        with self._lock:
            self._listeners.setdefault(map_id, set()).add(listener)
        try:
            yield listener
        finally:
            with self._lock:
                self._listeners[map_id].discard(listener)
                if not self._listeners[map_id]:
                    del self._listeners[map_id]

    def listeners_of(self, user_id: str) -> int:
        """How often somebody listens at this moment."""
        with self._lock:
            return sum(
                each.user_id == user_id for all_ in self._listeners.values() for each in all_
            )

    def close(self) -> None:
        """End all streams: the server stops."""
        self.is_closed = True
        with self._lock:
            everybody = [each for all_ in self._listeners.values() for each in all_]
        for listener in everybody:
            listener.put(())

    def _tell(self, map_id: str, events: Sequence[Event]) -> None:
        with self._lock:
            listeners = list(self._listeners.get(map_id, ()))
        for listener in listeners:
            listener.put(events)

    def _forget_surplus(self, walker: str) -> None:
        mine = [
            (since_s, map_id, key)
            for map_id, walks in self._maps.items()
            for key, (_, since_s) in walks.items()
            if key[0] == walker
        ]
        for _, map_id, key in sorted(mine)[: max(len(mine) - MOST_WALKS, 0)]:
            self._drop(map_id, key)

    def _forget_old(self) -> None:
        before_s = self._clock() - LASTS_S
        for map_id, walks in list(self._maps.items()):
            for key in [key for key, (_, since_s) in walks.items() if since_s < before_s]:
                self._drop(map_id, key)

    def _drop(self, map_id: str, key: Walk) -> None:
        del self._maps[map_id][key]
        if not self._maps[map_id]:
            del self._maps[map_id]


def _gone(key: Walk) -> Event:
    return Event("gone", f'{{"walker":"{key[0]}","walk":"{key[1]}"}}')


BEAT_S = 15.0
"""Without anything to tell, a comment comes so often; and so often it is asked who may listen."""
BEAT = b":\n\n"
BEGIN = b"retry: 3000\n\n"
MEDIA_TYPE = "text/event-stream"


async def stream_of(
    board: Board,
    map_id: str,
    user_id: str,
    may_listen: Callable[[], Awaitable[bool]],
    *,
    beat_s: float = BEAT_S,
) -> AsyncIterator[bytes]:
    """Who is there, then every position as it comes, until the server stops or access ends."""
    with board.listening(map_id, user_id) as listener:
        there = [Event("position", each.model_dump_json()) for each in board.there(map_id)]
        yield BEGIN + written(there)
        asked_s = time.monotonic()
        while not board.is_closed:
            events = await listener.take(beat_s)
            if time.monotonic() - asked_s >= beat_s:
                asked_s = time.monotonic()
                if not await may_listen():
                    return
            yield written(events) or BEAT


def written(events: list[Event]) -> bytes:
    """Events as they are sent."""
    return "".join(f"event: {each.kind}\ndata: {each.data}\n\n" for each in events).encode()


MOST_UNWRITTEN = 20_000
"""Where the database is away, the oldest give way."""


class HistoryBuffer:
    """Positions that are not in the database yet. Safe among threads."""

    def __init__(self, most: int = MOST_UNWRITTEN) -> None:
        self._lock, self._waiting = threading.Lock(), deque[LivePosition](maxlen=most)
        self.writing = threading.Lock()
        """Held by whoever writes or deletes history: what is deleted does not come again."""

    def add(self, positions: Sequence[LivePosition]) -> None:
        """Keep positions until they are written."""
        with self._lock:
            self._waiting.extend(positions)

    def take(self) -> list[LivePosition]:
        """All that wait, and wait no longer."""
        with self._lock:
            found = list(self._waiting)
            self._waiting.clear()
        return found

    def put_back(self, positions: Sequence[LivePosition]) -> None:
        """What was taken and could not be written waits again, before what has come since."""
        with self._lock:
            later = list(self._waiting)
            self._waiting.clear()
            self._waiting.extend([*positions, *later])


Sink = Callable[[Sequence[LivePosition]], None]
"""Takes positions and waits for nobody."""


class PositionHub:
    """The live positions of one server. `rates`: how often a walker may send some."""

    def __init__(self, rates: Rates) -> None:
        self.rates = rates
        self.board, self.history, self.outboxes = Board(), HistoryBuffer(), Outboxes()
        self._sinks: tuple[Sink, ...] = ()

    def take(self, positions: Sequence[LivePosition], *, keep: bool) -> None:
        """Tell everybody who is to know of positions, oldest first; keep them where that is on."""
        self.board.tell(positions)
        if keep:
            self.history.add(positions)
        for sink in self._sinks:
            sink(positions)

    def forget(self, walker: str) -> None:
        """Show a walker no more, and pass on nothing of them that still waits."""
        self.board.leave(walker)
        self.outboxes.forget_walker(walker, datetime.now(UTC))

    @contextmanager
    def feeding(self, sink: Sink) -> Iterator[None]:
        """Somebody more who takes all positions, as long as the block lasts."""
        self._sinks = (*self._sinks, sink)
        try:
            yield
        finally:
            self._sinks = tuple(each for each in self._sinks if each is not sink)
