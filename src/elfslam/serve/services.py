"""What the routes of one server share: settings, database, and who is busy with what."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends, Request
from sqlalchemy import Engine

from elfslam.serve.parsing.children import Children
from elfslam.serve.parsing.turns import Turns
from elfslam.serve.people.codes import OneTimeCodes
from elfslam.serve.people.rates import Rates
from elfslam.serve.positions.hub import PositionHub
from elfslam.serve.problems import Problem
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import Sessions, sessions_of
from elfslam.serve.store.opening import Examine, join_store, look_at_nothing, open_store


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
    settings: ServerSettings, *, alone: bool = False, examine: Examine = look_at_nothing
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
