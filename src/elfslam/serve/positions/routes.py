"""Routes of live positions: tell mine, see those of a map, listen; and my own history."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response
from fastapi.responses import StreamingResponse
from pydantic import AwareDatetime
from starlette.concurrency import run_in_threadpool

from elfslam.serve.people.access import Me, refuse_haste
from elfslam.serve.positions.history import delete_history, history_of
from elfslam.serve.positions.streaming import MEDIA_TYPE, stream_of
from elfslam.serve.positions.values import LivePosition, MapId, NewPositions, told_of
from elfslam.serve.positions.whose import seen_map, walked_map
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.database import User, now_utc, reading

router = APIRouter(tags=["positions"])


@router.post("/positions", status_code=204, operation_id="post_positions", responses=problems(409))
def post_positions(given: NewPositions, user: Me, services: ServicesDep) -> Response:
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
    return Response(status_code=204)


@router.get("/positions", operation_id="list_my_positions")
def list_my_positions(
    user: Me,
    services: ServicesDep,
    before: Annotated[AwareDatetime | None, Query(description="with a zone, such as Z")] = None,
    of_map: Annotated[MapId | None, Query(alias="map")] = None,
) -> list[LivePosition]:
    """Your own history, the latest first: 1000 at most, and those `before` a time."""
    return history_of(services, user, before, of_map)


@router.delete("/positions", status_code=204, operation_id="delete_my_positions")
def delete_my_positions(user: Me, services: ServicesDep) -> Response:
    """Delete your history, and be shown nowhere until you tell a position again."""
    delete_history(services, user.id)
    return Response(status_code=204)


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
