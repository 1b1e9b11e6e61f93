"""Routes of maps: look at them, take them home, delete them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel

from elfslam.base.enums import Format
from elfslam.base.errors import ElfslamError
from elfslam.serve.jobs.tasks import Named, file_name, folder_of_map
from elfslam.serve.maps.bodies import MapBody, bodies_of, body_of
from elfslam.serve.maps.exports import HEAVY, ExportOptions, exported, formats_of, placed
from elfslam.serve.maps.view import view_of
from elfslam.serve.people.access import Me, not_found
from elfslam.serve.positions.whose import settled_map
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.sharing.rights import Asks, Principal, Right, map_for, seen_by
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Map, reading, transaction
from elfslam.serve.store.derived import forget_maps
from elfslam.serve.store.quota import drop_unnamed
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
def list_maps(user: Me, services: ServicesDep) -> list[MapBody]:
    """Your maps, and those that are shared with you; the newest first."""
    with reading(services.sessions) as session:
        return bodies_of(session, Principal(user.id), seen_by(user.id))


@router.get("/maps/{map_id}", operation_id="get_map")
def get_map(map_id: str, asker: Asks, services: ServicesDep) -> MapBody:
    """One of your maps, or one that is shared with you."""
    with reading(services.sessions) as session:
        return body_of(session, asker, map_for(session, asker, map_id))


@router.delete("/maps/{map_id}", status_code=204, operation_id="delete_map")
def delete_map(map_id: str, asker: Asks, services: ServicesDep) -> Response:
    """Delete one of your maps, its job, and all fixes in it; the recordings stay."""
    with transaction(services.sessions) as session:
        named = forget_maps(session, [map_for(session, asker, map_id, Right.OWN).id])
    drop_unnamed(services, named)
    return Response(status_code=204)


@router.get("/maps/{map_id}/view", operation_id="view_map", responses={200: {"model": View}})
def view_map(map_id: str, asker: Asks, services: ServicesDep) -> Response:
    """What a viewer draws: walks, dead reckoning, closures, coverage."""
    with _folder(services, asker, map_id) as (found, named):
        light = {file: sha256 for file, sha256 in named.items() if file not in (*HEAVY, REPORT)}
        with unfolded(services.settings, light) as folder:
            try:
                view = view_of(folder)
            except ElfslamError as error:
                raise Problem(422, str(error).replace(str(folder), found.name)) from error
    content = json.dumps(view, allow_nan=False, separators=(",", ":"))
    return Response(content, media_type="application/json")


@router.get(
    "/maps/{map_id}/report.html",
    operation_id="get_report",
    response_class=FileResponse,
    responses={200: {"content": {"text/html": {}}}},
)
def get_report(map_id: str, asker: Asks, services: ServicesDep) -> FileResponse:
    """The report, as `elfslam map` and `elfslam merge` write it."""
    with _folder(services, asker, map_id) as (_, named):
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
def get_map_zip(map_id: str, asker: Asks, services: ServicesDep) -> StreamingResponse:
    """The folder of the map: `elfslam locate`, `merge`, `show` and `export` read it unpacked."""
    with _folder(services, asker, map_id) as (found, named):
        top, store = file_name(found.name), services.settings.blobs_folder
        files = {f"{top}/{file}": blobs.found_blob(store, sha256) for file, sha256 in named.items()}
        return sent(packed(files), f"{top}.zip", ZIP)


@router.get("/maps/{map_id}/exports", operation_id="list_exports")
def list_exports(map_id: str, asker: Asks, services: ServicesDep) -> list[Format]:
    """The formats that this map can be exported to."""
    with _folder(services, asker, map_id) as (_, named):
        return formats_of(named)


@router.get(
    "/maps/{map_id}/exports/{to}",
    operation_id="export_map",
    response_class=StreamingResponse,
    responses={200: {"content": {"application/octet-stream": {}}}, **problems(422)},
)
def export_map(
    map_id: str,
    to: Format,
    asked: Annotated[ExportOptions, Query()],
    asker: Asks,
    services: ServicesDep,
) -> StreamingResponse:
    """The map in the format of other programs; a .zip where that is several files.

    What the map knows (its venue and floor, and where on the Earth it lies) need not be told.
    """
    with _folder(services, asker, map_id) as (found, named):
        with reading(services.sessions) as session:
            known = placed(asked, found, settled_map(session, found).origin)
        return sent(*exported(services.settings, found.name, named, to, known))


@contextmanager
def _folder(services: Services, asker: Principal, map_id: str) -> Iterator[tuple[Map, Named]]:
    """A map that somebody may look at, and its files. Raises Problem 404, until the end."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id)
        named = folder_of_map(session, found.id)
    try:
        yield found, named
    except FileNotFoundError as error:
        raise not_found("map") from error
