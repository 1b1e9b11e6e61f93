"""Positions on their way into the database."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

from elfslam.serve.positions.values import LivePosition

MOST_WAITING = 20_000
"""Where the database is away, the oldest give way."""


class HistoryBuffer:
    """Positions that are not in the database yet. Safe among threads."""

    def __init__(self, most: int = MOST_WAITING) -> None:
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
