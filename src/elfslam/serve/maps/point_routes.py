"""Routes of points of interest: the rooms, doors and other places of a map that have a name."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter
from pydantic import AfterValidator, BaseModel, Field
from sqlalchemy.orm import Session

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.values import PointKind, PointOfInterest
from elfslam.data.named_places import (
    LONGEST_NAME,
    MOST,
    POINTS_OF_INTEREST,
    points_as_csv,
    read_points_file,
)
from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.people.access import not_found
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import ServicesDep
from elfslam.serve.settings import ServerSettings
from elfslam.serve.sharing.rights import Asks, Right, map_for
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.sending import scratch_file
from elfslam.serve.store.tables import MapFile
from elfslam.serve.texts import plain_line

router = APIRouter(tags=["maps"], prefix="/maps/{map_id}/points-of-interest")
NOTHING_YET = ""
"""The version of a map without points."""

Metres = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)]


def short_line(text: str) -> str:
    """The text as a plain line, whose composed form may be longer. Raises ValueError."""
    if len(line := plain_line(text)) > LONGEST_NAME:
        raise ValueError(f"wanted at most {LONGEST_NAME} characters, got {len(line)}")
    return line


class PointBody(BaseModel):
    """A place with a name, in the plane of the map."""

    name: str
    kind: PointKind = PointKind.OTHER
    x_m: Metres
    y_m: Metres


class GivenPoint(PointBody):
    """A place that is given a name."""

    name: Annotated[str, Field(max_length=LONGEST_NAME), AfterValidator(short_line)]


class PointsBody(BaseModel):
    """All points of interest of a map; `version` changes with them."""

    version: str
    points: list[PointBody]


class PointsChange(BaseModel):
    """The points that a map is to have, and the version that they were changed from."""

    version: str = Field(max_length=64)
    points: list[GivenPoint] = Field(max_length=MOST)


@router.get("", operation_id="get_points_of_interest")
def get_points_of_interest(map_id: str, asker: Asks, services: ServicesDep) -> PointsBody:
    """The rooms, doors and other places of a map that have a name."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id)
        try:
            return _body(session, services.settings, found.id)
        except FileNotFoundError as error:
            raise not_found("map") from error


@router.put("", operation_id="put_points_of_interest", responses=problems(409, 413))
def put_points_of_interest(
    map_id: str, given: PointsChange, asker: Asks, services: ServicesDep
) -> PointsBody:
    """Give a map these points of interest in place of all that it has.

    Refused (409) where they are not of the version any more that was changed.
    """
    store = services.settings.blobs_folder
    points = [PointOfInterest(**each.model_dump()) for each in given.points]
    table = points_as_csv(points).encode()
    with (
        scratch_file(services.settings, table) as file,
        blobs.locked(store),
        transaction(services.sessions) as session,
    ):
        found = map_for(session, asker, map_id, Right.EDIT)
        session.refresh(found, with_for_update=True)
        refuse_full(services, session, found.user_id)
        older = _of_version(session, map_id, given.version)
        dropped = [] if older is None else [older.sha256]
        _replace(session, map_id, older, blobs.put(store, file) if points else None)
        answer = _body(session, services.settings, map_id)
    drop_unnamed(services, dropped)
    return answer


def points_of(
    session: Session, settings: ServerSettings, map_id: str
) -> tuple[PointOfInterest, ...]:
    """The points of interest of a map. Raises FileNotFoundError where it was just deleted."""
    row = session.get(MapFile, (map_id, POINTS_OF_INTEREST))
    if row is None:
        return ()
    return read_points_file(blobs.found_blob(settings.blobs_folder, row.sha256))


def _of_version(session: Session, map_id: str, version: str) -> MapFile | None:
    """The table of a map's points, if it has one. Raises Problem 409 for another version."""
    row = session.get(MapFile, (map_id, POINTS_OF_INTEREST))
    if version != _version(row):
        raise Problem(409, "somebody else changed these places meanwhile; load them again")
    return row


def _replace(session: Session, map_id: str, older: MapFile | None, table: Blob | None) -> None:
    """Name another table, or none, as the points of a map."""
    if older is not None:
        session.delete(older)
        session.flush()
    if table is not None:
        session.add(MapFile(map_id=map_id, name=POINTS_OF_INTEREST, **asdict(table)))
        session.flush()


def _version(table: MapFile | None) -> str:
    return NOTHING_YET if table is None else table.sha256


def _body(session: Session, settings: ServerSettings, map_id: str) -> PointsBody:
    named = points_of(session, settings, map_id)
    points = [PointBody.model_validate(each, from_attributes=True) for each in named]
    version = _version(session.get(MapFile, (map_id, POINTS_OF_INTEREST)))
    return PointsBody(version=version, points=points)
