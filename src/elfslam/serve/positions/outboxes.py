"""Positions that wait for webhooks, and how each webhook's deliveries have gone."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from elfslam.serve.positions.values import LivePosition

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
