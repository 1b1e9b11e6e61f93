"""Routes of sharing: a map with people, with groups, and with everyone who has its link."""

import secrets
from contextlib import suppress

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from elfslam.serve.network.addresses import url_for_others
from elfslam.serve.network.authority import pairing_fragment
from elfslam.serve.people.access import Me, known_id, not_found, own
from elfslam.serve.people.users import ONE_YEAR_S
from elfslam.serve.problems import EVERYWHERE, Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.sharing.rights import LINK_COOKIE, WITHDRAWN, Asks, Right, map_for, opens
from elfslam.serve.store.database import count_rows, reading, transaction
from elfslam.serve.store.tables import (
    GroupMember,
    Map,
    MapGroupShare,
    MapLink,
    MapShare,
    Shared,
    User,
    UserGroup,
)
from elfslam.serve.texts import Id, Line

router = APIRouter(tags=["sharing"], prefix="/maps/{map_id}")
public = APIRouter(tags=["sharing"])
"""For who has nothing but a link."""
SECRET_BYTES = 16


class Sharing(BaseModel):
    """What others may do: read (look, export, be located), or edit as well."""

    may: Shared


class ShareBody(BaseModel):
    """Somebody with whom a map is shared."""

    user: str
    name: str
    may: Shared


class GroupShareBody(BaseModel):
    """A group with which a map is shared."""

    group: str
    name: str
    may: Shared


class LinkBody(BaseModel):
    """The address that opens a map without an account."""

    url: str
    may: Shared


class SharesBody(BaseModel):
    """With whom a map is shared."""

    people: list[ShareBody]
    groups: list[GroupShareBody]
    link: LinkBody | None


class GivenLink(BaseModel):
    """What the address of a link has behind `#link=`."""

    link: str = Field(max_length=200)


class OpenedLink(BaseModel):
    """The map of a link."""

    map: str
    name: str
    may: Shared


@router.get("/shares", operation_id="list_shares")
def list_shares(map_id: str, asker: Asks, services: ServicesDep, request: Request) -> SharesBody:
    """With whom one of your maps is shared."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.OWN)
        return _shares(services, session, found, request)


@router.put("/shares/{user_id}", operation_id="share_map", responses=problems(409))
def share_map(
    map_id: str, user_id: str, given: Sharing, asker: Asks, services: ServicesDep, request: Request
) -> SharesBody:
    """Share one of your maps with somebody, or change what they may."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.OWN, lock=True)
        person = session.get(User, known_id(user_id, "user"), with_for_update=True)
        if person is None:
            raise not_found("user")
        if person.id == found.user_id:
            raise Problem(409, "this map is yours already; share it with somebody else")
        share = session.get(MapShare, (found.id, person.id))
        if share is None:
            _refuse_too_many(services, session, found.user_id)
            share = MapShare(map_id=found.id, user_id=person.id)
            session.add(share)
        share.may = given.may
        session.flush()
        return _shares(services, session, found, request)


@router.delete("/shares/{user_id}", status_code=204, operation_id="unshare_map")
def unshare_map(map_id: str, user_id: str, asker: Asks, services: ServicesDep) -> None:
    """Share a map with somebody no more; whom it is shared with may leave by themselves.

    Who leaves a map that is shared with groups that they are in leaves those groups.
    """
    wanted = Right.READ if asker.user_id == user_id else Right.OWN
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, wanted)
        share = session.get(MapShare, (found.id, known_id(user_id, "user")))
        left = _leave_groups(session, found.id, user_id) if asker.user_id == user_id else False
        if share is not None:
            session.delete(share)
        elif not left:
            raise not_found("share")


@router.put("/groups/{group_id}", operation_id="share_map_with_group", responses=problems(409))
def share_map_with_group(
    map_id: str, group_id: str, given: Sharing, asker: Asks, services: ServicesDep, request: Request
) -> SharesBody:
    """Share one of your maps with one of your groups, or change what those in it may."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.OWN, lock=True)
        group = session.get(UserGroup, known_id(group_id, "group"), with_for_update=True)
        if group is None or group.user_id != found.user_id:
            raise not_found("group")
        session.merge(MapGroupShare(map_id=found.id, group_id=group.id, may=given.may))
        session.flush()
        return _shares(services, session, found, request)


@router.delete("/groups/{group_id}", status_code=204, operation_id="unshare_map_with_group")
def unshare_map_with_group(map_id: str, group_id: str, asker: Asks, services: ServicesDep) -> None:
    """Share a map with a group no more."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.OWN)
        share = session.get(MapGroupShare, (found.id, known_id(group_id, "group")))
        if share is None:
            raise not_found("share")
        session.delete(share)


@router.put("/link", operation_id="make_link", responses=problems(409))
def make_link(
    map_id: str, given: Sharing, asker: Asks, services: ServicesDep, request: Request
) -> SharesBody:
    """Let everyone in who has the link of one of your maps, or change what they may."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.OWN, lock=True)
        url_for_others(str(request.base_url), services.settings)
        link = session.get(MapLink, found.id)
        if link is None:
            link = MapLink(map_id=found.id, secret=secrets.token_urlsafe(SECRET_BYTES))
            session.add(link)
        link.may = given.may
        session.flush()
        return _shares(services, session, found, request)


@router.delete("/link", status_code=204, operation_id="withdraw_link")
def withdraw_link(map_id: str, asker: Asks, services: ServicesDep) -> None:
    """Let the link of a map open nothing any more; the next one is another."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.OWN)
        link = session.get(MapLink, found.id)
        if link is None:
            raise not_found("link")
        session.delete(link)


@public.post("/links/open", operation_id="open_link", responses=EVERYWHERE)
def open_link(given: GivenLink, services: ServicesDep, response: Response) -> OpenedLink:
    """Open a map by its link: a cookie for this map alone, which scripts cannot read."""
    map_id, _, secret = given.link.partition(".")
    with reading(services.sessions) as session:
        link = opens(session, map_id, secret)
        found = None if link is None else session.get(Map, map_id)
    if link is None or found is None:
        raise Problem(404, WITHDRAWN)
    response.set_cookie(
        LINK_COOKIE,
        secret,
        max_age=ONE_YEAR_S,
        path=f"/api/maps/{map_id}",
        httponly=True,
        secure=services.settings.secure_cookie,
        samesite="strict",
    )
    return OpenedLink(map=map_id, name=found.name, may=link.may)


def _shares(services: Services, session: Session, found: Map, request: Request) -> SharesBody:
    people = select(User.id, User.name, MapShare.may).join(MapShare, MapShare.user_id == User.id)
    rows = session.execute(people.where(MapShare.map_id == found.id).order_by(User.name, User.id))
    shared = select(UserGroup.id, UserGroup.name, MapGroupShare.may).join(MapGroupShare)
    grouped = session.execute(
        shared.where(MapGroupShare.map_id == found.id).order_by(UserGroup.name, UserGroup.id)
    )
    link = session.get(MapLink, found.id)
    told = None if link is None else LinkBody(url=_url(services, link, request), may=link.may)
    return SharesBody(
        people=[ShareBody(user=user, name=name, may=may) for user, name, may in rows],
        groups=[GroupShareBody(group=group, name=name, may=may) for group, name, may in grouped],
        link=told,
    )


def _leave_groups(session: Session, map_id: str, user_id: str) -> bool:
    """Take somebody out of all groups with which a map is shared; whether they were in any."""
    groups = select(MapGroupShare.group_id).where(MapGroupShare.map_id == map_id)
    mine = GroupMember.group_id.in_(groups), GroupMember.user_id == user_id
    left = session.scalars(select(GroupMember).where(*mine)).all()
    for each in left:
        session.delete(each)
    return bool(left)


def _url(services: Services, link: MapLink, request: Request) -> str:
    base = str(request.base_url)
    with suppress(Problem):  # this machine may have left its network since
        base = url_for_others(base, services.settings)
    told = f"{link.map_id}.{link.secret}"
    fragment = pairing_fragment(told, services.settings.authority_folder, name="link")
    return f"{base}desk{fragment}"


def _refuse_too_many(services: Services, session: Session, owner_id: str) -> None:
    """Raise Problem 409 where somebody has shared as often as they may."""
    most = services.settings.limits.shares
    theirs = Map.id == MapShare.map_id, Map.user_id == owner_id
    if count_rows(session, MapShare, *theirs) >= most:
        raise Problem(409, f"your maps are shared {most} times already; withdraw some first")


group_router = APIRouter(tags=["sharing"], prefix="/groups")
MOST_GROUPS = 100
MOST_MEMBERS = 1_000


class Member(BaseModel):
    """Somebody in a group."""

    id: str
    name: str


class GroupBody(BaseModel):
    """One of your groups."""

    id: str
    name: str
    members: list[Member]


class GivenGroup(BaseModel):
    """What a group is to be called, and everybody who is to be in it."""

    name: Line
    members: list[Id] = Field(max_length=MOST_MEMBERS)


@group_router.get("", operation_id="list_groups")
def list_groups(user: Me, services: ServicesDep) -> list[GroupBody]:
    """Your groups by name; of others' nobody is told."""
    with reading(services.sessions) as session:
        mine = (
            select(UserGroup)
            .where(UserGroup.user_id == user.id)
            .order_by(UserGroup.name, UserGroup.id)
        )
        return [_body(session, each) for each in session.scalars(mine)]


@group_router.post("", status_code=201, operation_id="make_group", responses=problems(409))
def make_group(given: GivenGroup, user: Me, services: ServicesDep) -> GroupBody:
    """Make a group of people of this server."""
    with transaction(services.sessions) as session:
        if count_rows(session, UserGroup, UserGroup.user_id == user.id) >= MOST_GROUPS:
            raise Problem(409, f"you have {MOST_GROUPS} groups already; delete one first")
        made = UserGroup(user_id=user.id, name=given.name)
        session.add(made)
        session.flush()
        return _filled(session, made, given)


@group_router.put("/{group_id}", operation_id="change_group")
def change_group(group_id: str, given: GivenGroup, user: Me, services: ServicesDep) -> GroupBody:
    """Call a group otherwise, and say who is in it: they may what it may, all others no more."""
    with transaction(services.sessions) as session:
        found = own(session, UserGroup, group_id, user, "group", lock=True)
        found.name = given.name
        session.execute(delete(GroupMember).where(GroupMember.group_id == found.id))
        return _filled(session, found, given)


@group_router.delete("/{group_id}", status_code=204, operation_id="delete_group")
def delete_group(group_id: str, user: Me, services: ServicesDep) -> None:
    """Delete a group; maps that were shared with it are so no more."""
    with transaction(services.sessions) as session:
        session.delete(own(session, UserGroup, group_id, user, "group", lock=True))


def _filled(session: Session, group: UserGroup, given: GivenGroup) -> GroupBody:
    """The group with these members. Raises Problem 404 where one is nobody here."""
    wanted = set(given.members)
    here = set(session.scalars(select(User.id).where(User.id.in_(wanted))))
    if wanted - here:
        raise not_found("user")
    session.add_all(GroupMember(group_id=group.id, user_id=each) for each in sorted(wanted))
    session.flush()
    return _body(session, group)


def _body(session: Session, group: UserGroup) -> GroupBody:
    people = select(User.id, User.name).join(GroupMember, GroupMember.user_id == User.id)
    rows = session.execute(
        people.where(GroupMember.group_id == group.id).order_by(User.name, User.id)
    )
    members = [Member(id=row.id, name=row.name) for row in rows]
    return GroupBody(id=group.id, name=group.name, members=members)
