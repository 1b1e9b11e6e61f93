"""Every walker's own history: written once a second, deleted in time or when they say so."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, insert, or_, select
from sqlalchemy.exc import IntegrityError, OperationalError, SQLAlchemyError
from sqlalchemy.orm import InstrumentedAttribute, Session

from elfslam.serve.positions.values import LivePosition
from elfslam.serve.problems import LOG
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Floor, KeptPosition, Map, User, now_utc

EVERY_S = 1.0
"""A server that is killed loses what came in this time."""
MOST_TOLD = 1000
"""Positions in one answer."""


@contextmanager
def keeping_history(services: Services) -> Iterator[None]:
    """What came is written once a second, and at the end."""
    stopping = threading.Event()
    thread = threading.Thread(
        target=_write_on, args=(services, stopping), name="positions", daemon=True
    )
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        thread.join()


def write_history(services: Services) -> int:
    """Write what waits; how many that were. What is of users or maps that are gone is dropped."""
    history = services.positions.history
    with history.writing:
        waiting = history.take()
        if not waiting:
            return 0
        try:
            return _written(services, waiting)
        except IntegrityError:  # somebody was deleted meanwhile; now they are gone
            return _written(services, waiting)
        except OperationalError:
            history.put_back(waiting)
            raise


def history_of(
    services: Services, user: User, before_utc: datetime | None, map_id: str | None
) -> list[LivePosition]:
    """Where a user was, the latest first: at most MOST_TOLD of them."""
    write_history(services)
    wanted = select(KeptPosition).where(
        KeptPosition.user_id == user.id, KeptPosition.time_utc >= _oldest_utc(services)
    )
    if before_utc is not None:
        wanted = wanted.where(KeptPosition.time_utc < before_utc.astimezone(UTC))
    if map_id is not None:
        wanted = wanted.where(KeptPosition.map_id == map_id)
    latest_first = (KeptPosition.time_utc.desc(), KeptPosition.number.desc())
    with reading(services.sessions) as session:
        rows = session.scalars(wanted.order_by(*latest_first).limit(MOST_TOLD))
        return [_told(row, user) for row in rows]


def delete_history(services: Services, user_id: str) -> None:
    """Delete a user's history at once, and show them nowhere."""
    services.positions.forget(user_id)
    history = services.positions.history
    with history.writing:
        history.add([each for each in history.take() if each.walker != user_id])
        with transaction(services.sessions) as session:
            session.execute(delete(KeptPosition).where(KeptPosition.user_id == user_id))


def forget_old_positions(services: Services) -> None:
    """Delete what is older than it may be by the clock.

    Where that was set back, what seems to come from later than it may is deleted as well.
    """
    latest_utc = now_utc() + _kept_for(services)
    too_old = KeptPosition.time_utc < _oldest_utc(services)
    with services.positions.history.writing, transaction(services.sessions) as session:
        session.execute(
            delete(KeptPosition).where(or_(too_old, KeptPosition.time_utc > latest_utc))
        )


def _kept_for(services: Services) -> timedelta:
    return timedelta(days=services.settings.limits.position_days)


def _oldest_utc(services: Services) -> datetime:
    return now_utc() - _kept_for(services)


def _written(services: Services, waiting: Sequence[LivePosition]) -> int:
    with transaction(services.sessions) as session:
        walkers = _known(session, User.id, {each.walker for each in waiting})
        wanted = {each.map for each in waiting}
        maps = _known(session, Map.id, wanted) | _known(session, Floor.id, wanted)
        rows = [_row(each) for each in waiting if each.walker in walkers and each.map in maps]
        if rows:
            session.execute(insert(KeptPosition), rows)
    return len(rows)


def _known(session: Session, column: InstrumentedAttribute[str], ids: set[str]) -> set[str]:
    return set(session.scalars(select(column).where(column.in_(ids))))


def _row(position: LivePosition) -> dict[str, object]:
    told = position.model_dump(exclude={"map", "walker", "name"})
    return {**told, "map_id": position.map, "user_id": position.walker}


def _told(row: KeptPosition, user: User) -> LivePosition:
    names = LivePosition.model_fields.keys() - {"map", "walker", "name"}
    told = {name: getattr(row, name) for name in names}
    return LivePosition(map=row.map_id, walker=user.id, name=user.name, **told)


def _write_on(services: Services, stopping: threading.Event) -> None:
    is_away = False
    while not stopping.wait(EVERY_S):
        is_away = _write_or_say(services, is_away=is_away)
    _write_or_say(services, is_away=is_away)


def _write_or_say(services: Services, *, is_away: bool) -> bool:
    """Whether the database did not take it; that is said once until it does."""
    try:
        write_history(services)
    except SQLAlchemyError as error:
        if not is_away:
            LOG.warning("the history of positions is not kept: %s", str(error).partition("\n")[0])
        return True
    return False
