"""Who may do what to a map: one function decides, and whatever touches a map asks it."""

import hmac
from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

from fastapi import Cookie, Depends, Request, Response, Security
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from fastapi.security import HTTPAuthorizationCredentials
from sqlalchemy import ColumnElement, Select, or_, select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from elfslam.serve.people import access
from elfslam.serve.problems import Problem, of_http, of_validation
from elfslam.serve.services import ServicesDep, services_of
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import GroupMember, Map, MapGroupShare, MapLink, MapShare, Shared

LINK_COOKIE = "elfslam_link"
LINK_SECRET = Cookie(alias=LINK_COOKIE, include_in_schema=False)
"""What `POST /api/links/open` sets for one map: a way in beside the token, told of in prose."""
WITHDRAWN = "this link was withdrawn, or its map deleted; ask whoever gave it to you for another"


class Right(IntEnum):
    """What somebody may do to a map; each holds those before it.

    READ: look at it, take it home, be located in it. EDIT: rename it, lay it on a floor, put a
    plan below it, merge it. OWN: share and delete it.
    """

    NONE = 0
    READ = 1
    EDIT = 2
    OWN = 3


TOO_LITTLE = {
    Right.EDIT: "you may look at this map, and not change it; ask its owner to let you",
    Right.OWN: "this map is somebody else's, and only they may do that; ask them",
}


@dataclass(frozen=True)
class Principal:
    """Who asks for a map: a user, whoever holds the secret of a link, or both."""

    user_id: str | None = None
    link: str | None = None


def right_to(
    asker: Principal,
    found: Map,
    share: MapShare | None = None,
    link: MapLink | None = None,
    through: Collection[Shared] = (),
) -> Right:
    """What somebody may do to a map, whose `share` is with them and whose `link` is this.

    `through` is what the groups may with which it is shared and that they are in.
    """
    if asker.user_id is not None and asker.user_id == found.user_id:
        return Right.OWN
    rights = [Right.NONE, *(Right[may.upper()] for may in through)]
    if share is not None and (share.map_id, share.user_id) == (found.id, asker.user_id):
        rights.append(Right[share.may.upper()])
    if link is not None and link.map_id == found.id and _is_secret(link, asker.link):
        rights.append(Right[link.may.upper()])
    return max(rights)


def map_for(
    session: Session,
    asker: Principal,
    map_id: str,
    wanted: Right = Right.READ,
    *,
    lock: bool = False,
) -> Map:
    """A map to which somebody has a right; `lock`: until the commit no other such call returns.

    Raises Problem 404 where they have none, as where there is no such map, and 403 where they
    have a lesser one.
    """
    found = session.get(Map, access.known_id(map_id, "map"), with_for_update=True if lock else None)
    right = Right.NONE if found is None else right_in(session, asker, found)
    if found is None or right is Right.NONE:
        raise access.not_found("map")
    if right < wanted:
        raise Problem(403, TOO_LITTLE[wanted])
    return found


def right_in(session: Session, asker: Principal, found: Map) -> Right:
    """What somebody may do to a map, as the database has it."""
    share = session.get(MapShare, (found.id, asker.user_id)) if asker.user_id else None
    link = session.get(MapLink, found.id) if asker.link else None
    through = through_groups(asker.user_id).where(MapGroupShare.map_id == found.id)
    mays = [row.may for row in session.execute(through)] if asker.user_id else []
    return right_to(asker, found, share, link, mays)


def floors_of(session: Session, asker: Principal, found: Map) -> list[Map]:
    """The maps of the building of a map that somebody may see, one a floor, rising.

    Where a floor has several, the newest; of its own floor it is the map itself.
    """
    if "level" not in found.facts:
        return [found]
    rows = select(Map).where(Map.facts["frame"].as_string() == found.facts.get("frame", found.id))
    seen = [
        each
        for each in session.scalars(rows.order_by(Map.created_utc, Map.id))
        if "level" in each.facts and right_in(session, asker, each) >= Right.READ
    ]
    by_level = {each.facts["level"]: each for each in [*seen, found]}
    return [by_level[level] for level in sorted(by_level)]


def through_groups(user_id: str | None) -> Select[str, str, Shared]:
    """Map, group and what may be done, for all that is shared with groups that a user is in."""
    wanted = select(MapGroupShare.map_id, MapGroupShare.group_id, MapGroupShare.may)
    member = GroupMember.group_id == MapGroupShare.group_id
    return wanted.join(GroupMember, member).where(GroupMember.user_id == user_id)


def seen_by(user_id: str) -> ColumnElement[bool]:
    """The maps that a user sees in lists: their own, and those that are shared with them."""
    shared = select(MapShare.map_id).where(MapShare.user_id == user_id)
    through = through_groups(user_id).with_only_columns(MapGroupShare.map_id)
    return or_(Map.user_id == user_id, Map.id.in_(shared), Map.id.in_(through))


def opens(session: Session, map_id: str, secret: str) -> MapLink | None:
    """The link of a map, if that is its secret."""
    link = session.get(MapLink, map_id) if access.ID.fullmatch(map_id) else None
    return link if link is not None and _is_secret(link, secret) else None


def _is_secret(link: MapLink, secret: str | None) -> bool:
    given = (secret or "").encode("utf-8", "surrogatepass")
    return hmac.compare_digest(link.secret.encode(), given)


def current_asker(
    map_id: str,
    services: ServicesDep,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Security(access.BEARER)],
    cookie: Annotated[str | None, Security(access.IN_COOKIE)],
    secret: Annotated[str | None, LINK_SECRET] = None,
) -> Principal:
    """Who asks for a map: by token, by link, or by both.

    Raises Problem 401 for who has neither, 404 for a withdrawn link, 429 for too many requests.
    """
    token = bearer.credentials if bearer else cookie
    with reading(services.sessions) as session:
        user = access.user_of_token(session, token) if token else None
        has_link = secret is not None and opens(session, map_id, secret) is not None
    if user is None and not has_link:
        if token:
            raise access.unknown_token(access.NOT_KNOWN)
        raise Problem(404, WITHDRAWN) if secret else access.unknown_token(access.NOTHING_SENT)
    access.refuse_haste(services.token_rates.take(user.id if user else f"link {map_id}"))
    return Principal(user.id if user else None, secret if has_link else None)


async def identify_first(request: Request, error: Exception) -> Response:
    """The answer to a body or a query that is wrong: 401 where nobody is known who sent it.

    FastAPI reads bodies before it asks who is there.
    """
    if not isinstance(error, Problem) and asks_who(request.scope.get("route")):
        of_map = "map_id" in request.path_params
        secret = request.cookies.get(LINK_COOKIE) if of_map else None
        map_id = request.path_params.get("map_id", "")
        given = await access.BEARER(request), await access.IN_COOKIE(request), secret
        try:
            await run_in_threadpool(current_asker, map_id, await services_of(request), *given)
        except Problem as refusal:
            return await of_http(request, refusal)
    is_http = isinstance(error, HTTPException)
    return await (of_http if is_http else of_validation)(request, error)


def asks_who(route: object) -> bool:
    """Whether a route looks at tokens."""

    def asks(needed: Dependant) -> bool:
        return needed.call is access.BEARER or any(map(asks, needed.dependencies))

    return isinstance(route, APIRoute) and asks(route.dependant)


Asks = Annotated[Principal, Depends(current_asker)]
"""A route's parameter: who asks for the map of its path."""
