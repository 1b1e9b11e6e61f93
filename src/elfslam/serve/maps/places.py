"""Routes of named places: the rooms and doors of a map, and the ways between them."""

from dataclasses import asdict
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query
from pydantic import AfterValidator, BaseModel, Field
from sqlalchemy.orm import Session

from elfslam.app.way import WayFloor, position_of, route_between
from elfslam.base.building import Passage
from elfslam.base.errors import NoAnswerError, StoreError
from elfslam.base.values import LevelPassage, PointKind, PointOfInterest
from elfslam.data import named_places
from elfslam.data.building_files import passage_of
from elfslam.data.map_files import MAP, read_map
from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.maps.bodies import level_of
from elfslam.serve.people.access import not_found
from elfslam.serve.problems import Problem, problems
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.settings import ServerSettings
from elfslam.serve.sharing.rights import Asks, Right, floors_of, map_for
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.sending import unfolded
from elfslam.serve.store.tables import Map, MapFile
from elfslam.serve.texts import Metres, plain_line
from elfslam.stages.ways import moves_of

router = APIRouter(tags=["maps"], prefix="/maps/{map_id}")
NOTHING_YET = ""
"""The version of a map without points."""


def short_line(text: str) -> str:
    """The text as a plain line, whose composed form may be longer. Raises ValueError."""
    if len(line := plain_line(text)) > named_places.LONGEST_NAME:
        raise ValueError(f"wanted at most {named_places.LONGEST_NAME} characters, got {len(line)}")
    return line


class PointBody(BaseModel):
    """A place with a name, in the plane of the map."""

    name: str
    kind: PointKind = PointKind.OTHER
    x_m: Metres
    y_m: Metres


class GivenPoint(PointBody):
    """A place that is given a name."""

    name: Annotated[str, Field(max_length=named_places.LONGEST_NAME), AfterValidator(short_line)]


class PointsBody(BaseModel):
    """All points of interest of a map; `version` changes with them."""

    version: str
    points: list[PointBody]


class PointsChange(BaseModel):
    """The points that a map is to have, and the version that they were changed from."""

    version: str = Field(max_length=64)
    points: list[GivenPoint] = Field(max_length=named_places.MOST)


@router.get("/points-of-interest", operation_id="get_points_of_interest")
def get_points_of_interest(map_id: str, asker: Asks, services: ServicesDep) -> PointsBody:
    """The rooms, doors and other places of a map that have a name."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id)
        try:
            return _body(session, services.settings, found.id)
        except FileNotFoundError as error:
            raise not_found("map") from error


@router.put(
    "/points-of-interest", operation_id="put_points_of_interest", responses=problems(409, 413)
)
def put_points_of_interest(
    map_id: str, given: PointsChange, asker: Asks, services: ServicesDep
) -> PointsBody:
    """Give a map these points of interest in place of all that it has.

    Refused (409) where they are not of the version any more that was changed.
    """
    store = services.settings.blobs_folder
    points = [PointOfInterest(**each.model_dump()) for each in given.points]
    with (
        scratch(services.settings) as folder,
        blobs.locked(store),
        transaction(services.sessions) as session,
    ):
        found = map_for(session, asker, map_id, Right.EDIT)
        session.refresh(found, with_for_update=True)
        refuse_full(services, session, found.user_id)
        older = _of_version(session, map_id, given.version)
        dropped = [] if older is None else [older.sha256]
        named_places.write_points(points, folder)
        table = blobs.put(store, folder / named_places.POINTS_OF_INTEREST) if points else None
        _replace(session, map_id, older, table)
        answer = _body(session, services.settings, map_id)
    drop_unnamed(services, dropped)
    return answer


def points_of(
    session: Session, settings: ServerSettings, map_id: str
) -> tuple[PointOfInterest, ...]:
    """The points of interest of a map. Raises FileNotFoundError where it was just deleted."""
    row = session.get(MapFile, (map_id, named_places.POINTS_OF_INTEREST))
    if row is None:
        return ()
    return named_places.read_points_file(blobs.found_blob(settings.blobs_folder, row.sha256))


def _of_version(session: Session, map_id: str, version: str) -> MapFile | None:
    """The table of a map's points, if it has one. Raises Problem 409 for another version."""
    row = session.get(MapFile, (map_id, named_places.POINTS_OF_INTEREST))
    if version != _version(row):
        raise Problem(409, "somebody else changed these places meanwhile; load them again")
    return row


def _replace(session: Session, map_id: str, older: MapFile | None, table: Blob | None) -> None:
    """Name another table, or none, as the points of a map."""
    if older is not None:
        session.delete(older)
        session.flush()
    if table is not None:
        session.add(MapFile(map_id=map_id, name=named_places.POINTS_OF_INTEREST, **asdict(table)))
        session.flush()


def _version(table: MapFile | None) -> str:
    return NOTHING_YET if table is None else table.sha256


def _body(session: Session, settings: ServerSettings, map_id: str) -> PointsBody:
    named = points_of(session, settings, map_id)
    points = [PointBody.model_validate(each, from_attributes=True) for each in named]
    version = _version(session.get(MapFile, (map_id, named_places.POINTS_OF_INTEREST)))
    return PointsBody(version=version, points=points)


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


@router.get("/way", operation_id="get_way")
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
