"""Codes for tokens: each is good once and for a short time, and is kept in memory alone."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable

CODE_BYTES = 16
LASTS_S = 600.0
MOST = 1000
"""Codes that wait to be used; the oldest give way."""


class OneTimeCodes:
    """Tokens by codes. Safe among threads."""

    def __init__(
        self, lasts_s: float = LASTS_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.lasts_s, self._clock = lasts_s, clock
        self._lock = threading.Lock()
        self._tokens: dict[str, tuple[str, float]] = {}

    def make(self, token: str) -> str:
        """A new code for a token."""
        code = secrets.token_urlsafe(CODE_BYTES)
        with self._lock:
            self._forget_old()
            while len(self._tokens) >= MOST:
                del self._tokens[next(iter(self._tokens))]
            self._tokens[code] = token, self._clock() + self.lasts_s
        return code

    def redeem(self, code: str) -> str | None:
        """The token of a code, which is used up; None for one that was used or is too old."""
        with self._lock:
            self._forget_old()
            token, _ = self._tokens.pop(code, (None, 0.0))
        return token

    def _forget_old(self) -> None:
        now_s = self._clock()
        for code in [each for each, (_, ends_s) in self._tokens.items() if ends_s <= now_s]:
            del self._tokens[code]
