"""The route of ways: from one place of a building to another, and which maps are its floors."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel
from sqlalchemy.orm import Session

from elfslam.app.way import WayFloor, position_of, route_between
from elfslam.base.building import Passage
from elfslam.base.errors import NoAnswerError, StoreError
from elfslam.base.values import LevelPassage
from elfslam.data.building_files import passage_of
from elfslam.data.map_files import MAP, read_map
from elfslam.serve.maps.bodies import level_of
from elfslam.serve.maps.point_routes import points_of
from elfslam.serve.people.access import not_found
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.sharing.rights import Asks, floors_of, map_for
from elfslam.serve.store.database import reading
from elfslam.serve.store.sending import unfolded
from elfslam.serve.store.tables import Map, MapFile
from elfslam.stages.ways import moves_of

router = APIRouter(tags=["maps"])
Told = Annotated[
    str,
    Query(
        min_length=1, max_length=120,
        description="a named place, LEVEL:NAME, LEVEL:X,Y in metres, or X,Y on this floor",
    ),
]  # fmt: skip


class LegBody(BaseModel):
    """A line on one floor, the map of it, and what leads from its end to the next."""

    level: int
    map: str
    xy_m: list[tuple[float, float]]
    leaves_by: LevelPassage | None


class MoveBody(BaseModel):
    """Straight on for so far, after a turn, a passage, or the start."""

    level: int
    after: str
    length_m: float


class WayBody(BaseModel):
    """A way from floor to floor, and the same as one tells it."""

    length_m: float
    duration_s: float
    legs: list[LegBody]
    moves: list[MoveBody]


@router.get("/maps/{map_id}/way", operation_id="get_way")
def get_way(
    map_id: str,
    asker: Asks,
    services: ServicesDep,
    start: Told,
    goal: Told,
    *,
    without_stairs: bool = False,
) -> WayBody:
    """The quickest way along walked ground, through the floors of a building that you may see.

    `without_stairs` leads by lifts alone.
    """
    with reading(services.sessions) as session:
        here = map_for(session, asker, map_id)
        maps = {level_in_building(each): each for each in floors_of(session, asker, here)}
        try:
            floors = {k: _floor(services, session, each) for k, each in maps.items()}
        except FileNotFoundError as error:
            raise not_found("map") from error
        passages = list(dict.fromkeys(p for each in maps.values() for p in passages_of_map(each)))
        ids = {level: each.id for level, each in maps.items()}
        level = level_in_building(here)
    ends = (position_of(told, floors, level) for told in (start, goal))
    try:
        route = route_between(floors, passages, *ends, stairs=not without_stairs)
    except NoAnswerError as error:
        raise Problem(404, str(error)) from error
    legs = [
        LegBody(level=each.level, map=ids[each.level], xy_m=each.xy_m.tolist(),
                leaves_by=each.leaves_by)
        for each in route.legs
    ]  # fmt: skip
    moves = [MoveBody.model_validate(each, from_attributes=True) for each in moves_of(route)]
    return WayBody(length_m=route.length_m, duration_s=route.duration_s, legs=legs, moves=moves)


def level_in_building(each: Map) -> int:
    """The level of a map, by its name where no building tells it, else 0."""
    return each.facts.get("level", level_of(each.floor) or 0)


def passages_of_map(each: Map) -> list[Passage]:
    """The passages that touch the floor of a map."""
    return [passage_of(told) for told in each.facts.get("passages", [])]


def _floor(services: Services, session: Session, each: Map) -> WayFloor:
    """What was walked on a floor, nothing where its map knows no spots, and its named places."""
    row = session.get(MapFile, (each.id, MAP))
    points = points_of(session, services.settings, each.id)
    if row is None:
        return WayFloor(np.empty((0, 2)), points)
    with unfolded(services.settings, {MAP: row.sha256}) as folder:
        try:
            walked_m = read_map(folder).xy_m
        except StoreError as error:
            raise StoreError(str(error).replace(str(folder), each.name)) from error
    return WayFloor(walked_m, points)
