"""Routes of groups: people with whom somebody shares maps at once."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field
from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from elfslam.serve.people.access import Me, known_id, not_found
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import ServicesDep
from elfslam.serve.sharing.tables import GroupMember, UserGroup
from elfslam.serve.store.database import User, reading, transaction
from elfslam.serve.texts import Line

router = APIRouter(tags=["sharing"], prefix="/groups")
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
    members: list[Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]] = Field(max_length=MOST_MEMBERS)


@router.get("", operation_id="list_groups")
def list_groups(user: Me, services: ServicesDep) -> list[GroupBody]:
    """Your groups by name; of others' nobody is told."""
    with reading(services.sessions) as session:
        mine = (
            select(UserGroup)
            .where(UserGroup.user_id == user.id)
            .order_by(UserGroup.name, UserGroup.id)
        )
        return [_body(session, each) for each in session.scalars(mine)]


@router.post("", status_code=201, operation_id="make_group", responses=problems(409))
def make_group(given: GivenGroup, user: Me, services: ServicesDep) -> GroupBody:
    """Make a group of people of this server."""
    with transaction(services.sessions) as session:
        count = select(func.count()).select_from(UserGroup).where(UserGroup.user_id == user.id)
        if (session.scalar(count) or 0) >= MOST_GROUPS:
            raise Problem(409, f"you have {MOST_GROUPS} groups already; delete one first")
        made = UserGroup(user_id=user.id, name=given.name)
        session.add(made)
        session.flush()
        return _filled(session, made, given)


@router.put("/{group_id}", operation_id="change_group")
def change_group(group_id: str, given: GivenGroup, user: Me, services: ServicesDep) -> GroupBody:
    """Call a group otherwise, and say who is in it: they may what it may, all others no more."""
    with transaction(services.sessions) as session:
        found = _mine(session, user, group_id)
        found.name = given.name
        session.execute(delete(GroupMember).where(GroupMember.group_id == found.id))
        return _filled(session, found, given)


@router.delete("/{group_id}", status_code=204, operation_id="delete_group")
def delete_group(group_id: str, user: Me, services: ServicesDep) -> Response:
    """Delete a group; maps that were shared with it are so no more."""
    with transaction(services.sessions) as session:
        session.delete(_mine(session, user, group_id))
    return Response(status_code=204)


def _mine(session: Session, user: User, group_id: str) -> UserGroup:
    found = session.get(UserGroup, known_id(group_id, "group"), with_for_update=True)
    if found is None or found.user_id != user.id:
        raise not_found("group")
    return found


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
