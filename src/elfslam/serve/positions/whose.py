"""Who may see the live positions of a map, and who may be located in it.

Whoever may see a map is both; that is asked of `map_for` alone. In a published floor everybody is
located, and the server's owner sees it.
"""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from elfslam.serve.buildings.tables import Floor
from elfslam.serve.people.access import known_id
from elfslam.serve.positions.tables import MapPositions
from elfslam.serve.positions.values import MapOrigin
from elfslam.serve.problems import Problem
from elfslam.serve.sharing.rights import Principal, Right, map_for
from elfslam.serve.store.database import Map, User


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
