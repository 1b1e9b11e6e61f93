"""Live positions, every walker's history and a map's settings: their routes, and who may use them.

Whoever may see a map may see who is there and be located in it; that is asked of `map_for` alone.
In a published floor everybody is located, and the server's owner sees it.
"""

import secrets
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse
from pydantic import AwareDatetime, BaseModel, Field
from sqlalchemy import delete, insert, or_, select
from sqlalchemy.exc import IntegrityError, OperationalError, SQLAlchemyError
from sqlalchemy.orm import InstrumentedAttribute, Session
from starlette.concurrency import run_in_threadpool

from elfslam.serve.people.access import Me, known_id, not_found, refuse_haste
from elfslam.serve.positions.hub import MEDIA_TYPE, stream_of
from elfslam.serve.positions.values import LivePosition, MapOrigin, NewPositions, told_of
from elfslam.serve.positions.webhooks import address_of, target_of
from elfslam.serve.problems import LOG, Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.sharing.rights import Principal, Right, map_for
from elfslam.serve.store.database import count_rows, reading, transaction
from elfslam.serve.store.tables import (
    Floor,
    KeptPosition,
    Map,
    MapPositions,
    User,
    Webhook,
    now_utc,
)
from elfslam.serve.texts import Id, Line


@dataclass(frozen=True)
class WalkedMap:
    """A map in which walkers are located: whether it takes positions, and where it lies."""

    id: str
    is_on: bool = True
    origin: MapOrigin | None = None


def seen_map(session: Session, user: User, map_id: str) -> WalkedMap:
    """A map whose live positions the user may see. Raises Problem 404."""
    if user.is_owner and _is_floor(session, known_id(map_id, "map")):
        return WalkedMap(map_id)
    return settled_map(session, map_for(session, Principal(user.id), map_id))


def walked_map(session: Session, user: User, map_id: str) -> WalkedMap:
    """A map in which the user may tell where they are. Raises Problem 404, 409."""
    if _is_floor(session, map_id):
        return WalkedMap(map_id)
    found = settled_map(session, map_for(session, Principal(user.id), map_id))
    if not found.is_on:
        raise Problem(409, "the owner of this map has switched live positions off; ask them")
    return found


def owned_map(session: Session, user: User, map_id: str) -> Map:
    """A map that is the user's own. Raises Problem 404, 403."""
    return map_for(session, Principal(user.id), map_id, Right.OWN)


def settled_map(session: Session, found: Map) -> WalkedMap:
    """A map with what its owner has set."""
    row = session.get(MapPositions, found.id)
    return WalkedMap(found.id) if row is None else WalkedMap(found.id, row.is_on, _origin_of(row))


def _origin_of(row: MapPositions) -> MapOrigin | None:
    if row.latitude_deg is None or row.longitude_deg is None or row.bearing_deg is None:
        return None
    return MapOrigin(
        latitude_deg=row.latitude_deg, longitude_deg=row.longitude_deg, bearing_deg=row.bearing_deg
    )


def _is_floor(session: Session, map_id: str) -> bool:
    return session.scalar(select(Floor.number).filter_by(id=map_id)) is not None


router = APIRouter(tags=["positions"])


@router.post("/positions", status_code=204, operation_id="post_positions", responses=problems(409))
def post_positions(given: NewPositions, user: Me, services: ServicesDep) -> None:
    """Tell those who may see a map where you are in it: at most 20 fixes, all of the last minute.

    They are shown for ten seconds, passed on to MQTT and webhooks, and kept in your history.
    """
    hub, limits = services.positions, services.settings.limits
    refuse_haste(hub.rates.take(user.id))
    with reading(services.sessions) as session:
        walked = walked_map(session, user, given.map)
    told = told_of(given, user.id, user.name, now_utc(), walked.origin)
    hub.take(told, keep=limits.position_days > 0)
    if given.is_over:
        hub.board.leave(user.id, given.walk)


@router.get("/positions", operation_id="list_my_positions")
def list_my_positions(
    user: Me,
    services: ServicesDep,
    before: Annotated[AwareDatetime | None, Query(description="with a zone, such as Z")] = None,
    of_map: Annotated[Id | None, Query(alias="map")] = None,
) -> list[LivePosition]:
    """Your own history, the latest first: 1000 at most, and those `before` a time."""
    return history_of(services, user, before, of_map)


@router.delete("/positions", status_code=204, operation_id="delete_my_positions")
def delete_my_positions(user: Me, services: ServicesDep) -> None:
    """Delete your history, and be shown nowhere until you tell a position again."""
    delete_history(services, user.id)


@router.get("/maps/{map_id}/positions", operation_id="list_live_positions")
def list_live_positions(map_id: str, user: Me, services: ServicesDep) -> list[LivePosition]:
    """Who is in a map at this moment and consents to being seen: each walk's last position."""
    with reading(services.sessions) as session:
        seen = seen_map(session, user, map_id)
    return services.positions.board.there(seen.id) if seen.is_on else []


@router.get(
    "/maps/{map_id}/positions/stream",
    operation_id="stream_live_positions",
    response_class=StreamingResponse,
    responses={200: {"content": {MEDIA_TYPE: {"schema": {"type": "string"}}}}},
)
async def stream_live_positions(map_id: str, user: Me, services: ServicesDep) -> StreamingResponse:
    """The same as server-sent events: `position` for each that comes, `gone` where a walk ends."""
    board, most = services.positions.board, services.settings.limits.position_streams
    await run_in_threadpool(_check_listening, services, user, map_id)
    if board.listeners_of(user.id) >= most:
        raise Problem(429, f"you listen {most} times already; end one of them first")

    async def may_listen() -> bool:
        return await run_in_threadpool(_may_listen, services, user.id, map_id)

    stream = stream_of(board, map_id, user.id, may_listen)
    return StreamingResponse(stream, media_type=MEDIA_TYPE, headers={"X-Accel-Buffering": "no"})


def _check_listening(services: Services, user: User, map_id: str) -> None:
    """Raise Problem 404 where the map is not theirs to see, 409 where it takes no positions."""
    with reading(services.sessions) as session:
        if not seen_map(session, user, map_id).is_on:
            raise Problem(409, "live positions of this map are switched off")


def _may_listen(services: Services, user_id: str, map_id: str) -> bool:
    try:
        with reading(services.sessions) as session:
            user = session.get(User, user_id)
            return user is not None and seen_map(session, user, map_id).is_on
    except Problem:
        return False


map_router = APIRouter(tags=["positions"], prefix="/maps/{map_id}")
SECRET_BYTES = 32


class PositionSettings(BaseModel):
    """Whether a map takes live positions, and where on the Earth it lies, if that is known."""

    is_on: bool = True
    origin: MapOrigin | None = None


class NewWebhook(BaseModel):
    """Where to post positions to. Without a secret one is made."""

    url: str = Field(max_length=2000)
    secret: Annotated[Line, Field(min_length=16)] | None = None


class WebhookBody(BaseModel):
    """A webhook, and how its deliveries have gone since the server started."""

    id: str
    url: str
    created_utc: datetime
    delivered: int
    dropped: int
    last_delivered_utc: datetime | None
    last_error: str | None
    last_error_utc: datetime | None


class MadeWebhook(BaseModel):
    """A new webhook with the secret that signs what it is sent: told once."""

    id: str
    url: str
    secret: str


@map_router.get("/positions/settings", operation_id="get_position_settings")
def get_position_settings(map_id: str, user: Me, services: ServicesDep) -> PositionSettings:
    """Whether a map takes live positions, and where it lies."""
    with reading(services.sessions) as session:
        seen = seen_map(session, user, map_id)
    return PositionSettings(is_on=seen.is_on, origin=seen.origin)


@map_router.put("/positions/settings", operation_id="put_position_settings")
def put_position_settings(
    map_id: str, given: PositionSettings, user: Me, services: ServicesDep
) -> PositionSettings:
    """Switch live positions of your map on or off, and say where on the Earth it lies."""
    nowhere = dict.fromkeys(MapOrigin.model_fields)
    origin = given.origin.model_dump() if given.origin else nowhere
    with transaction(services.sessions) as session:
        found = owned_map(session, user, map_id)
        session.merge(MapPositions(map_id=found.id, is_on=given.is_on, **origin))
        session.flush()
        settled = settled_map(session, found)
    if not settled.is_on:
        services.positions.board.clear(map_id)
    return PositionSettings(is_on=settled.is_on, origin=settled.origin)


@map_router.get("/webhooks", operation_id="list_webhooks")
def list_webhooks(map_id: str, user: Me, services: ServicesDep) -> list[WebhookBody]:
    """The webhooks of your map, and how their deliveries go."""
    with reading(services.sessions) as session:
        owned = owned_map(session, user, map_id)
        rows = select(Webhook).filter_by(map_id=owned.id).order_by(Webhook.created_utc, Webhook.id)
        return [_webhook_body(services, row) for row in session.scalars(rows)]


@map_router.post(
    "/webhooks", status_code=201, operation_id="add_webhook", responses=problems(403, 409)
)
def add_webhook(map_id: str, given: NewWebhook, user: Me, services: ServicesDep) -> MadeWebhook:
    """Have positions in your map posted to a URL, in batches, each with a signature."""
    with reading(services.sessions) as session:
        owned_map(session, user, map_id)
    target = target_of(given.url)
    address_of(target, allow_local=services.settings.local_webhooks)
    secret = given.secret or secrets.token_urlsafe(SECRET_BYTES)
    most = services.settings.limits.webhooks
    with transaction(services.sessions) as session:
        owned = owned_map(session, user, map_id)
        if count_rows(session, Webhook, Webhook.map_id == owned.id) >= most:
            raise Problem(409, f"this map has {most} webhooks already; delete one first")
        row = Webhook(map_id=owned.id, url=target.url, secret=secret)
        session.add(row)
    return MadeWebhook(id=row.id, url=row.url, secret=row.secret)


@map_router.delete("/webhooks/{webhook_id}", status_code=204, operation_id="delete_webhook")
def delete_webhook(map_id: str, webhook_id: str, user: Me, services: ServicesDep) -> None:
    """Post nothing there any more."""
    with transaction(services.sessions) as session:
        owned = owned_map(session, user, map_id)
        row = session.get(Webhook, known_id(webhook_id, "webhook"))
        if row is None or row.map_id != owned.id:
            raise not_found("webhook")
        session.delete(row)
    services.positions.outboxes.forget(webhook_id)


def _webhook_body(services: Services, row: Webhook) -> WebhookBody:
    told = services.positions.outboxes.deliveries_of(row.id)
    return WebhookBody(id=row.id, url=row.url, created_utc=row.created_utc, **asdict(told))


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
