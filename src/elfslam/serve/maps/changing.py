"""Routes that change maps: names, venues and floors, and many deleted at once."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel
from sqlalchemy import select

from elfslam.serve.maps.bodies import MapBody, body_of
from elfslam.serve.people.access import Me, not_found
from elfslam.serve.problems import Problem
from elfslam.serve.services import ServicesDep
from elfslam.serve.sharing.rights import (
    TOO_LITTLE,
    Asks,
    Principal,
    Right,
    map_for,
    right_in,
    seen_by,
)
from elfslam.serve.store.database import Map, transaction
from elfslam.serve.store.derived import forget_maps
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.texts import Deleted, Line, Many

router = APIRouter(tags=["maps"])


class MapChange(BaseModel):
    """What a map is to be called and where it lies; what is left out stays, null is nowhere."""

    name: Line | None = None
    venue: Line | None = None
    floor: Line | None = None


class PlaceChange(BaseModel):
    """A venue, or one floor of it, and what it is to be called."""

    venue: Line
    floor: Line | None = None
    name: Line


class Changed(BaseModel):
    """How many maps lie there."""

    maps: int


@router.patch("/maps/{map_id}", operation_id="change_map")
def change_map(map_id: str, given: MapChange, asker: Asks, services: ServicesDep) -> MapBody:
    """Call a map otherwise, or lay it on a floor of a venue."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        change(found, given)
        session.flush()
        return body_of(session, asker, found)


def change(found: Map, given: MapChange) -> None:
    """Change the row of a map. Raises Problem 422."""
    told = given.model_dump(include=given.model_fields_set)
    if told.get("name", found.name) is None:
        raise Problem(422, "name: got none; a map has to be called something")
    venue, floor = told.get("venue", found.venue), told.get("floor", found.floor)
    if venue is None and told.get("floor") is not None:
        raise Problem(422, "floor: it is a floor of no venue; name the venue as well")
    found.name = told.get("name", found.name)
    found.venue, found.floor = venue, None if venue is None else floor


@router.patch("/places", operation_id="rename_place")
def rename_place(given: PlaceChange, user: Me, services: ServicesDep) -> Changed:
    """Call a venue or a floor otherwise, on every map there that you may edit."""
    there = select(Map).where(seen_by(user.id), Map.venue == given.venue)
    if given.floor is not None:
        there = there.where(Map.floor == given.floor)
    asker = Principal(user.id)
    with transaction(services.sessions) as session:
        found = session.scalars(there).all()
        maps = [each for each in found if right_in(session, asker, each) >= Right.EDIT]
        if not maps:
            raise Problem(403, TOO_LITTLE[Right.EDIT]) if found else not_found("place")
        for each in maps:
            if given.floor is None:
                each.venue = given.name
            else:
                each.floor = given.name
    return Changed(maps=len(maps))


@router.post("/maps/delete", operation_id="delete_maps")
def delete_maps(given: Many, user: Me, services: ServicesDep) -> Deleted:
    """Delete many of your maps at once, or none where one is somebody else's.

    What is not there is passed over.
    """
    asker = Principal(user.id)
    with transaction(services.sessions) as session:
        seen = select(Map).where(seen_by(user.id), Map.id.in_(given.ids))
        found = session.scalars(seen).all()
        if any(right_in(session, asker, each) < Right.OWN for each in found):
            raise Problem(403, TOO_LITTLE[Right.OWN])
        named = forget_maps(session, [each.id for each in found])
    drop_unnamed(services, named)
    return Deleted(count=len(found))
