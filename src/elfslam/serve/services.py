"""What the routes of one server share: settings, database, rates, codes, and who is busy."""

import secrets
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends, Request
from sqlalchemy import Engine

from elfslam.serve.parsing.children import Children, Turns
from elfslam.serve.positions.hub import PositionHub
from elfslam.serve.problems import Problem
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import Sessions, sessions_of
from elfslam.serve.store.opening import Examine, join_store, open_store

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


class Busy:
    """Names of what somebody is working on; a second comer is refused, not kept waiting."""

    def __init__(self) -> None:
        self._lock, self._names = threading.Lock(), set[str]()

    @contextmanager
    def alone(self, names: Iterable[str]) -> Iterator[None]:
        """Alone with all of these. Raises Problem 423."""
        wanted = set(names)
        with self._lock:
            if self._names & wanted:
                raise Problem(
                    423, "somebody is writing there at this moment; wait", {"Retry-After": "1"}
                )
            self._names |= wanted
        try:
            yield
        finally:
            with self._lock:
                self._names -= wanted


@dataclass(frozen=True)
class Services:
    """What one server consists of."""

    settings: ServerSettings
    engine: Engine
    sessions: Sessions
    token_rates: Rates
    address_rates: Rates
    positions: PositionHub
    """Where walkers are who consent to being seen."""
    busy: Busy = field(default_factory=Busy)
    codes: OneTimeCodes = field(default_factory=OneTimeCodes)
    """That pair another device."""
    jobs_wanted: threading.Event = field(default_factory=threading.Event)
    """Set where a job was queued."""
    children: Children = field(default_factory=Children)
    """That parse what comes from outside."""
    reading: Turns = field(default_factory=Turns)
    drawing: Turns = field(default_factory=Turns)
    """Whose recording is read next, and whose floor plan is drawn."""
    finders: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(4))
    """So many phones are told at once where they are; more threads would only wait for each other.
    """

    def stop(self) -> None:
        """The server stops: end what has no end, and what nobody will wait for."""
        self.positions.board.close()
        self.children.close()


def open_services(
    settings: ServerSettings, *, alone: bool = False, examine: Examine | None = None
) -> Services:
    """The services of a data folder, which is made where it is missing.

    `alone`: the caller is, by `alone_with`; otherwise a server may be using the folder. `examine`
    is as in `open_store`. Raises StoreError, InputError.
    """
    engine = open_store(settings, examine) if alone else join_store(settings)
    limits = settings.limits
    return Services(
        settings,
        engine,
        sessions_of(engine),
        Rates(limits.token_requests_per_s, limits.burst_s),
        Rates(limits.address_requests_per_s, limits.burst_s),
        PositionHub(Rates(limits.position_requests_per_s, limits.burst_s)),
    )


async def services_of(request: Request) -> Services:
    """The services of the app that answers; waits for nothing, so it needs no thread."""
    services = request.app.state.services
    assert isinstance(services, Services)
    return services


ServicesDep = Annotated[Services, Depends(services_of)]
"""A route's parameter: the server's services."""
