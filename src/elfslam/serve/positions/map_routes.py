"""Routes of a map's owner: whether it takes positions, where it lies, and who is posted them."""

from __future__ import annotations

import secrets
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field
from sqlalchemy import func, select

from elfslam.serve.people.access import Me, known_id, not_found
from elfslam.serve.positions.outboxes import Deliveries
from elfslam.serve.positions.tables import MapPositions, Webhook
from elfslam.serve.positions.targets import address_of, target_of
from elfslam.serve.positions.values import MapOrigin
from elfslam.serve.positions.whose import owned_map, seen_map, settled_map
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.texts import Line

router = APIRouter(tags=["positions"], prefix="/maps/{map_id}")
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


@router.get("/positions/settings", operation_id="get_position_settings")
def get_position_settings(map_id: str, user: Me, services: ServicesDep) -> PositionSettings:
    """Whether a map takes live positions, and where it lies."""
    with reading(services.sessions) as session:
        seen = seen_map(session, user, map_id)
    return PositionSettings(is_on=seen.is_on, origin=seen.origin)


@router.put("/positions/settings", operation_id="put_position_settings")
def put_position_settings(
    map_id: str, given: PositionSettings, user: Me, services: ServicesDep
) -> PositionSettings:
    """Switch live positions of your map on or off, and say where on the Earth it lies."""
    origin = given.origin.model_dump() if given.origin else {}
    with transaction(services.sessions) as session:
        found = owned_map(session, user, map_id)
        session.merge(
            MapPositions(
                map_id=found.id,
                is_on=given.is_on,
                latitude_deg=origin.get("latitude_deg"),
                longitude_deg=origin.get("longitude_deg"),
                bearing_deg=origin.get("bearing_deg"),
            )
        )
        session.flush()
        settled = settled_map(session, found)
    if not settled.is_on:
        services.positions.board.clear(map_id)
    return PositionSettings(is_on=settled.is_on, origin=settled.origin)


@router.get("/webhooks", operation_id="list_webhooks")
def list_webhooks(map_id: str, user: Me, services: ServicesDep) -> list[WebhookBody]:
    """The webhooks of your map, and how their deliveries go."""
    with reading(services.sessions) as session:
        owned = owned_map(session, user, map_id)
        rows = select(Webhook).filter_by(map_id=owned.id).order_by(Webhook.created_utc, Webhook.id)
        return [_body(services, row) for row in session.scalars(rows)]


@router.post("/webhooks", status_code=201, operation_id="add_webhook", responses=problems(403, 409))
def add_webhook(map_id: str, given: NewWebhook, user: Me, services: ServicesDep) -> MadeWebhook:
    """Have positions in your map posted to a URL, in batches, each with a signature."""
    with reading(services.sessions) as session:
        owned_map(session, user, map_id)
    target = target_of(given.url)
    address_of(target, allow_local=services.settings.local_webhooks)
    secret, most = given.secret or secrets.token_urlsafe(SECRET_BYTES), _most(services)
    with transaction(services.sessions) as session:
        owned = owned_map(session, user, map_id)
        mine = select(func.count()).select_from(Webhook).filter_by(map_id=owned.id)
        if (session.scalar(mine) or 0) >= most:
            raise Problem(409, f"this map has {most} webhooks already; delete one first")
        row = Webhook(map_id=owned.id, url=target.url, secret=secret)
        session.add(row)
    return MadeWebhook(id=row.id, url=row.url, secret=row.secret)


@router.delete("/webhooks/{webhook_id}", status_code=204, operation_id="delete_webhook")
def delete_webhook(map_id: str, webhook_id: str, user: Me, services: ServicesDep) -> Response:
    """Post nothing there any more."""
    with transaction(services.sessions) as session:
        owned = owned_map(session, user, map_id)
        row = session.get(Webhook, known_id(webhook_id, "webhook"))
        if row is None or row.map_id != owned.id:
            raise not_found("webhook")
        session.delete(row)
    services.positions.outboxes.forget(webhook_id)
    return Response(status_code=204)


def _most(services: Services) -> int:
    return services.settings.limits.webhooks


def _body(services: Services, row: Webhook) -> WebhookBody:
    told: Deliveries = services.positions.outboxes.deliveries_of(row.id)
    return WebhookBody(
        id=row.id,
        url=row.url,
        created_utc=row.created_utc,
        delivered=told.delivered,
        dropped=told.dropped,
        last_delivered_utc=told.last_delivered_utc,
        last_error=told.last_error,
        last_error_utc=told.last_error_utc,
    )
