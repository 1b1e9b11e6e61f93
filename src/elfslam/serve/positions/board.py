"""The live positions of every map, in memory alone, and who listens to them."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Literal

from elfslam.serve.positions.values import LivePosition

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
