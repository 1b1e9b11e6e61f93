"""Maps as the API tells them, and how high floors lie by their names."""

import re
from collections import defaultdict
from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel
from sqlalchemy import ColumnElement, func, select, union
from sqlalchemy.orm import Session

from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.sharing.rights import Principal, Right, right_to, through_groups
from elfslam.serve.store.tables import (
    GroupMember,
    Map,
    MapFile,
    MapGroupShare,
    MapLink,
    MapShare,
    Shared,
    User,
)


class MapFileBody(BaseModel):
    """A file of a map's folder."""

    name: str
    size_bytes: int
    sha256: str


class MapBody(BaseModel):
    """A map, where it lies, and what who asks may do to it.

    `sources` are the recordings that one's own map came from and that are still here; `level` is
    how high the floor lies, by its name. With how many people one's own map is shared, and whether
    by link, tell `shared_with` and `has_link`.
    """

    id: str
    name: str
    kind: str
    venue: str | None
    floor: str | None
    level: int | None
    sources: list[str]
    facts: dict[str, Any]
    floor_plan: dict[str, Any] | None
    files: list[MapFileBody]
    owner: str
    right: Literal["read", "edit", "own"]
    shared_with: int
    has_link: bool
    created_utc: datetime


OF_THE_ROW = ("id", "name", "kind", "venue", "floor", "facts", "floor_plan", "created_utc")


def body_of(session: Session, asker: Principal, each: Map) -> MapBody:
    """A map as the API tells it to somebody."""
    return bodies_of(session, asker, Map.id == each.id)[0]


def bodies_of(session: Session, asker: Principal, of_maps: ColumnElement[bool]) -> list[MapBody]:
    """Some maps as the API tells them to somebody, the newest first.

    In a few queries, however many they are.
    """
    maps = session.scalars(select(Map).where(of_maps).order_by(Map.created_utc.desc(), Map.id))
    files = _files(session, of_maps)
    owners = select(User).where(User.id.in_(select(Map.user_id).where(of_maps)))
    names = {user.id: user.name for user in session.scalars(owners)}
    with_link = select(MapLink).join(Map).where(of_maps)
    links = {row.map_id: row for row in session.scalars(with_link)}
    with_asker = select(MapShare).filter_by(user_id=asker.user_id)
    shares = {row.map_id: row for row in session.scalars(with_asker)}
    through = _through(session, asker, of_maps)
    counts = _counts(session, of_maps)
    bodies = []
    for each in maps:
        right = right_to(asker, each, shares.get(each.id), links.get(each.id), through[each.id])
        is_own = right is Right.OWN
        bodies.append(
            MapBody(
                **{name: getattr(each, name) for name in OF_THE_ROW},
                level=level_of(each.floor),
                sources=each.sources if is_own else [],
                files=files[each.id],
                owner=names.get(each.user_id, ""),
                right=right.name.lower(),  # type: ignore[arg-type]
                shared_with=counts.get(each.id, 0) if is_own else 0,
                has_link=is_own and each.id in links,
            )
        )
    return bodies


def _files(session: Session, of_maps: ColumnElement[bool]) -> dict[str, list[MapFileBody]]:
    """The files of some maps' folders, by the map."""
    rows = select(MapFile).join(Map).where(of_maps, MapFile.name != FLOOR_PLAN)
    found: dict[str, list[MapFileBody]] = defaultdict(list)
    for row in session.scalars(rows.order_by(MapFile.name)):
        found[row.map_id].append(MapFileBody.model_validate(row, from_attributes=True))
    return found


def _through(
    session: Session, asker: Principal, of_maps: ColumnElement[bool]
) -> dict[str, list[Shared]]:
    """What the asker's groups may do to each map."""
    found: dict[str, list[Shared]] = defaultdict(list)
    if asker.user_id is not None:
        rows = through_groups(asker.user_id).join(Map, Map.id == MapGroupShare.map_id)
        for row in session.execute(rows.where(of_maps)):
            found[row.map_id].append(row.may)
    return found


def _counts(session: Session, of_maps: ColumnElement[bool]) -> dict[str, int]:
    """With how many people each map is shared, in groups or by name."""
    alone = select(MapShare.map_id, MapShare.user_id).join(Map).where(of_maps)
    member = GroupMember.group_id == MapGroupShare.group_id
    grouped = select(MapGroupShare.map_id, GroupMember.user_id).join(GroupMember, member)
    others = grouped.join(Map, Map.id == MapGroupShare.map_id).where(
        of_maps, GroupMember.user_id != Map.user_id
    )
    people = union(alone, others).subquery()
    rows = select(people.c.map_id, func.count()).group_by(people.c.map_id)
    return {row[0]: row[1] for row in session.execute(rows)}


DASHES = "-\u2212\u2013"
"""A minus as people write it."""
NUMBER = re.compile(rf"(?:(?<!\w)[{DASHES}])?(?<!\d)\d{{1,3}}(?!\d)")
BASEMENT = re.compile(r"\b(?:basement|cellar|underground)\b|^(?:b|ug)\d", re.I)
GROUND = re.compile(r"\bground\b|\blobby\b|^(?:g|eg|gf)$", re.I)


def level_of(floor: str | None) -> int | None:
    """How high a floor lies by its name, 0 at the ground; None where the name does not say."""
    if floor is None:
        return None
    if GROUND.search(floor):
        return 0
    number, below = NUMBER.search(floor), BASEMENT.search(floor)
    if number is None:
        return -1 if below else None
    level = int(number[0].lstrip(DASHES))
    return -level if below or number[0][0] in DASHES else level


def floor_name(level: int) -> str:
    """What the floor of a published building is called."""
    return "Ground floor" if level == 0 else f"Floor {level}"
