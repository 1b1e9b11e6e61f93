"""Routes of maps: look at them, take them home, delete them."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel
from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session

from elfslam.base.choices import Format
from elfslam.base.errors import ElfslamError
from elfslam.serve.jobs.tasks import FLOOR_PLAN, Named, file_name, folder_of_map
from elfslam.serve.maps.exports import HEAVY, ExportOptions, exported, formats_of
from elfslam.serve.maps.view import view_of
from elfslam.serve.people.access import Me, known_id, not_found
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Here, Services
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Map, MapFile, User, reading, transaction
from elfslam.serve.store.derived import forget_map
from elfslam.serve.store.holdings import drop_unnamed
from elfslam.serve.store.sending import ZIP, sent, sent_blob, unfolded
from elfslam.serve.store.zips import packed

router = APIRouter(tags=["maps"])
REPORT = "report.html"
REPORT_POLICY = "; ".join(
    (
        "sandbox allow-scripts allow-downloads",
        "default-src 'none'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval'",
        "style-src 'unsafe-inline'",
        "img-src data: blob:",
        "font-src data:",
        "frame-ancestors 'self'",
    )
)
"""A report is a page of its own: its scripts draw, and reach neither the server nor the cookie."""


class MapFileBody(BaseModel):
    """A file of a map's folder."""

    name: str
    size_bytes: int
    sha256: str


class MapBody(BaseModel):
    """A map; `sources` are the recordings that it came from and that are still here."""

    id: str
    name: str
    kind: str
    sources: list[str]
    facts: dict[str, Any]
    floor_plan: dict[str, Any] | None
    files: list[MapFileBody]
    created_utc: datetime


class WalkView(BaseModel):
    """A line with its times, which may be unknown and then are none, and sigmas per axis."""

    name: str
    t_s: list[float]
    xy_m: list[tuple[float, float]]
    sigma_m: list[float]


class Line(BaseModel):
    """A line."""

    name: str
    xy_m: list[tuple[float, float]]


class Coverage(BaseModel):
    """Square by square, rows along y: how many walks passed, and how sure places are there."""

    corner_m: tuple[float, float]
    cell_m: float
    shape: tuple[int, int]
    walks: list[list[int]]
    sigma_m: list[list[float | None]]


class View(BaseModel):
    """What is drawn of a map."""

    kind: str
    bounds_m: tuple[float, float, float, float]
    walks: list[WalkView]
    dead_reckoning: list[Line]
    closures: list[tuple[float, float, float, float]]
    coverage: Coverage | None


@router.get("/maps", operation_id="list_maps")
def list_maps(user: Me, services: Here) -> list[MapBody]:
    """Your maps, the newest first."""
    found = select(Map).where(Map.user_id == user.id).order_by(Map.created_utc.desc(), Map.id)
    with reading(services.sessions) as session:
        files = _files(session, Map.user_id == user.id)
        return [_body(each, files[each.id]) for each in session.scalars(found)]


@router.get("/maps/{map_id}", operation_id="get_map")
def get_map(map_id: str, user: Me, services: Here) -> MapBody:
    """One of your maps."""
    with reading(services.sessions) as session:
        return body_of(session, my_map(session, user, map_id))


@router.delete("/maps/{map_id}", status_code=204, operation_id="delete_map")
def delete_map(map_id: str, user: Me, services: Here) -> Response:
    """Delete a map, its job, and all fixes in it; the recordings stay."""
    with transaction(services.sessions) as session:
        named = forget_map(session, user.id, my_map(session, user, map_id).id)
    drop_unnamed(services, named)
    return Response(status_code=204)


@router.get("/maps/{map_id}/view", operation_id="view_map", responses={200: {"model": View}})
def view_map(map_id: str, user: Me, services: Here) -> Response:
    """What a viewer draws: walks, dead reckoning, closures, coverage."""
    with _folder(services, user, map_id) as (name, named):
        light = {file: sha256 for file, sha256 in named.items() if file not in (*HEAVY, REPORT)}
        with unfolded(services.settings, light) as folder:
            try:
                view = view_of(folder)
            except ElfslamError as error:
                raise Problem(422, str(error).replace(str(folder), name)) from error
    content = json.dumps(view, allow_nan=False, separators=(",", ":"))
    return Response(content, media_type="application/json")


@router.get(
    "/maps/{map_id}/report.html",
    operation_id="get_report",
    response_class=FileResponse,
    responses={200: {"content": {"text/html": {}}}},
)
def get_report(map_id: str, user: Me, services: Here) -> FileResponse:
    """The report, as `elfslam map` and `elfslam merge` write it."""
    with _folder(services, user, map_id) as (_, named):
        if REPORT not in named:
            raise Problem(404, "this map has no report")
    policy = {"Content-Security-Policy": REPORT_POLICY}
    kind = "text/html; charset=utf-8"
    return sent_blob(services.settings, named[REPORT], "report", kind, headers=policy)


@router.get(
    "/maps/{map_id}/map.zip",
    operation_id="get_map_zip",
    response_class=StreamingResponse,
    responses={200: {"content": {ZIP: {}}}},
)
def get_map_zip(map_id: str, user: Me, services: Here) -> StreamingResponse:
    """The folder of the map: `elfslam locate`, `merge`, `show` and `export` read it unpacked."""
    with _folder(services, user, map_id) as (name, named):
        top, store = file_name(name), services.settings.blobs_folder
        files = {f"{top}/{file}": blobs.blob_path(store, sha256) for file, sha256 in named.items()}
        return sent(packed(files), f"{top}.zip", ZIP)


@router.get("/maps/{map_id}/exports", operation_id="list_exports")
def list_exports(map_id: str, user: Me, services: Here) -> list[Format]:
    """The formats that this map can be exported to."""
    with _folder(services, user, map_id) as (_, named):
        return formats_of(named)


@router.get(
    "/maps/{map_id}/exports/{to}",
    operation_id="export_map",
    response_class=StreamingResponse,
    responses={200: {"content": {"application/octet-stream": {}}}, **problems(422)},
)
def export_map(
    map_id: str, to: Format, asked: Annotated[ExportOptions, Query()], user: Me, services: Here
) -> StreamingResponse:
    """The map in the format of other programs; a .zip where that is several files."""
    with _folder(services, user, map_id) as (name, named):
        return sent(*exported(services.settings, name, named, to, asked))


def body_of(session: Session, each: Map) -> MapBody:
    """A map as the API tells it."""
    return _body(each, _files(session, Map.id == each.id)[each.id])


def _body(each: Map, files: list[MapFileBody]) -> MapBody:
    told = {name: getattr(each, name) for name in MapBody.model_fields if name != "files"}
    return MapBody(**told, files=files)


def _files(session: Session, of_maps: ColumnElement[bool]) -> dict[str, list[MapFileBody]]:
    """The files of some maps' folders, by the map."""
    rows = select(MapFile).join(Map).where(of_maps, MapFile.name != FLOOR_PLAN)
    found: dict[str, list[MapFileBody]] = defaultdict(list)
    for row in session.scalars(rows.order_by(MapFile.name)):
        found[row.map_id].append(MapFileBody.model_validate(row, from_attributes=True))
    return found


def my_map(session: Session, user: User, map_id: str) -> Map:
    """A map of the user's. Raises Problem 404."""
    found = session.get(Map, known_id(map_id, "map"))
    if found is None or found.user_id != user.id:
        raise not_found("map")
    return found


@contextmanager
def _folder(services: Services, user: User, map_id: str) -> Iterator[tuple[str, Named]]:
    """The name of a map of the user's, and its files. Raises Problem 404, until the end."""
    with reading(services.sessions) as session:
        found = my_map(session, user, map_id)
        named = folder_of_map(session, found.id)
    try:
        yield found.name, named
    except FileNotFoundError as error:
        raise not_found("map") from error
