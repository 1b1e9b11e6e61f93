"""How often somebody may ask: a bucket of requests each, which fills as time goes by."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

MOST_BUCKETS = 10_000


class Rates:
    """Buckets by key, all of one size. Safe among threads."""

    def __init__(
        self, per_s: float, burst_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._per_s, self._room, self._clock = per_s, max(1.0, per_s * burst_s), clock
        self._lock = threading.Lock()
        self._buckets: dict[str, tuple[float, float]] = {}

    def take(self, key: str) -> float:
        """Take one request from a bucket: 0, or where it is empty the seconds to wait."""
        with self._lock:
            now_s = self._clock()
            if len(self._buckets) >= MOST_BUCKETS:
                self._forget_full(now_s)
            left = self._left(key, now_s)
            if left < 1:
                return (1 - left) / self._per_s
            self._buckets[key] = left - 1, now_s
            return 0.0

    def _left(self, key: str, now_s: float) -> float:
        left, since_s = self._buckets.get(key, (self._room, now_s))
        return min(self._room, left + (now_s - since_s) * self._per_s)

    def _forget_full(self, now_s: float) -> None:
        full = [key for key in self._buckets if self._left(key, now_s) >= self._room]
        for key in full or list(self._buckets)[: MOST_BUCKETS // 2]:
            del self._buckets[key]
