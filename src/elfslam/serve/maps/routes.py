"""Routes of maps: look at them, change them, take them home in any format, delete them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import MISSING, asdict, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, Field
from sqlalchemy import select
from starlette.concurrency import run_in_threadpool

from elfslam.base.enums import Format
from elfslam.base.errors import ElfslamError, InputError, ParameterError
from elfslam.data.geographic import Origin, parse_origin
from elfslam.data.imdf import Venue
from elfslam.data.map_files import ENCODER, FACTS
from elfslam.data.plan_pictures import PlanKind
from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.jobs.tasks import FLOOR_PLAN, Named, file_name, folder_of_map
from elfslam.serve.maps.bodies import MapBody, bodies_of, body_of, level_of
from elfslam.serve.maps.view import view_of
from elfslam.serve.parsing.child import Bounds
from elfslam.serve.people.access import Me, not_found
from elfslam.serve.positions.routes import settled_map
from elfslam.serve.positions.values import MapOrigin
from elfslam.serve.problems import Problem, problems
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.receiving.tus import Quota, append
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.settings import Limits, ServerSettings
from elfslam.serve.sharing.rights import (
    TOO_LITTLE,
    Asks,
    Principal,
    Right,
    current_asker,
    map_for,
    right_in,
    seen_by,
)
from elfslam.serve.store import blobs
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed, forget_maps
from elfslam.serve.store.sending import BINARY, ZIP, pieces, sent, sent_blob, unfolded
from elfslam.serve.store.tables import Map, MapFile
from elfslam.serve.store.zips import packed
from elfslam.serve.texts import AsNumber, AsWhole, Deleted, Many, Metres
from elfslam.serve.texts import Line as TextLine

if TYPE_CHECKING:
    from elfslam.app.export import ExportContext

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
FILES = {
    Format.TUM: (".tum", "text/plain"),
    Format.G2O: (".g2o", "text/plain"),
    Format.ONNX: (".onnx", BINARY),
    Format.GEOJSON: (".geojson", "application/geo+json"),
    Format.IMDF: (".imdf.zip", ZIP),
    Format.ROS: (".yaml", ZIP),
    Format.PARQUET: (".parquet", BINARY),
}
"""How the file of a format ends, and what it is."""
HEAVY = ("echoes.npz", "features.npz")
"""Files of a run that no export reads; an hour's echoes fill much memory."""
OPTION = re.compile(r"--(\w+)")


class ExportOptions(BaseModel):
    """What no map knows and some formats ask for."""

    origin: str | None = Field(None, description="LAT,LON[,BEARING_DEG] of the map's origin")
    resolution_m: Annotated[float | None, AsNumber] = Field(
        None, description="side of a pixel of ros", allow_inf_nan=False
    )
    name: TextLine | None = Field(None, description="of the venue, for imdf; so are those below")
    category: TextLine | None = None
    address: TextLine | None = None
    locality: TextLine | None = None
    country: TextLine | None = None
    level: TextLine | None = None
    ordinal: Annotated[int | None, AsWhole] = Field(None, ge=-100, le=1000)
    level_short_name: TextLine | None = None
    province: TextLine | None = None
    postal_code: TextLine | None = None
    language: TextLine | None = None


def formats_of(named: Named) -> list[Format]:
    """What a map can become that consists of these files."""
    is_map = FACTS not in named
    lacking = {Format.TUM: is_map, Format.G2O: is_map, Format.ONNX: ENCODER not in named}
    return [each for each in Format if not lacking.get(each, False)]


def exported(
    settings: ServerSettings,
    found: Map,
    named: Named,
    to: Format,
    asked: ExportOptions,
    origin: MapOrigin | None,
) -> tuple[Iterator[bytes], str, str]:
    """A map as the pieces of a file, that file's name and media type. Raises Problem 422."""
    from elfslam.app.export import export

    suffix, media_type = FILES[to]
    light = {file: sha256 for file, sha256 in named.items() if file not in HEAVY}
    with unfolded(settings, light) as folder:
        made = folder.parent / "made"
        made.mkdir()
        out = made / f"{file_name(found.name)}{suffix}"
        try:
            export(folder, out, to, context_of(asked, to, found, origin))
        except ElfslamError as error:
            raise Problem(422, _in_words(error, folder, out, found.name)) from error
        files = {each.name: each for each in sorted(made.iterdir())}
        if len(files) > 1:
            return packed(files), f"{out.stem}.{to}.zip", ZIP
        return pieces(out.open("rb")), out.name, media_type


def context_of(
    asked: ExportOptions, to: Format, found: Map, known: MapOrigin | None
) -> ExportContext:
    """What was asked for, or else is known of the venue and of where the map lies.

    Raises ParameterError, naming what is missing.
    """
    from elfslam.app.export import ExportContext

    origin = None if known is None else Origin(**known.model_dump())
    if asked.origin is not None:
        origin = parse_origin(asked.origin)
    pixel_m = ExportContext.pixel_m if asked.resolution_m is None else asked.resolution_m
    return ExportContext(origin, _place(asked, found) if to is Format.IMDF else None, pixel_m)


def _place(asked: ExportOptions, found: Map) -> Venue:
    known = {"name": found.venue, "level": found.floor, "ordinal": level_of(found.floor)}
    given = known | asked.model_dump(exclude_none=True)
    told = {
        each.name: given[each.name] for each in fields(Venue) if given.get(each.name) is not None
    }
    needed = (each.name for each in fields(Venue) if each.default is MISSING)
    if missing := [name for name in needed if name not in told]:
        raise ParameterError(f"--{missing[0]}: imdf asks for {', '.join(missing)} of the venue")
    return Venue(**told)


def _in_words(error: ElfslamError, folder: Path, out: Path, name: str) -> str:
    """The line of an error without folders of this server, options as parts of a query."""
    line = str(error).replace(str(out), out.name).replace(str(folder), name)
    return OPTION.sub(r"\1", line).replace("resolution:", "resolution_m:")


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
def delete_map(map_id: str, asker: Asks, services: ServicesDep) -> None:
    """Delete one of your maps, its job, and all fixes in it; the recordings stay."""
    with transaction(services.sessions) as session:
        named = forget_maps(session, [map_for(session, asker, map_id, Right.OWN).id])
    drop_unnamed(services, named)


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
            origin = settled_map(session, found).origin
        return sent(*exported(services.settings, found, named, to, asked, origin))


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


class MapChange(BaseModel):
    """What a map is to be called and where it lies; what is left out stays, null is nowhere."""

    name: TextLine | None = None
    venue: TextLine | None = None
    floor: TextLine | None = None


class PlaceChange(BaseModel):
    """A venue, or one floor of it, and what it is to be called."""

    venue: TextLine
    floor: TextLine | None = None
    name: TextLine


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


# --- floor plans: an image below a map, and where on the map it lies ---

plan_router = APIRouter(
    tags=["maps"], prefix="/maps/{map_id}/floor-plan", dependencies=[Depends(current_asker)]
)
"""Nobody's plan is read before it is known who asks."""
DRAWER = "elfslam.serve.maps.plan_drawing:parse"
SHARING_S, FILE_FACTOR = 180.0, 4
"""How long a child may wait for a processor in all; what it draws may be larger than what came."""
PlanLevel = Annotated[str | None, Query(max_length=80)]
ALSO = "application/json"
"""What browsers call GeoJSON."""


class ImagePlacement(BaseModel):
    """How wide the image is, and where its lower left corner lies in the map."""

    width_m: float = Field(gt=0, le=10_000, allow_inf_nan=False)
    x_m: Metres
    y_m: Metres
    heading_rad: float = Field(0.0, ge=-100, le=100, allow_inf_nan=False)
    opacity: float = Field(0.5, ge=0, le=1, allow_inf_nan=False)


async def sends_plan(request: Request) -> None:
    """Refuse a request whose body is said to be something else."""
    if request.headers.get("content-type", "").partition(";")[0].strip() not in (*PlanKind, ALSO):
        raise Problem(415, f"wanted {', '.join(PlanKind)}; save the plan as one of these")


@plan_router.put(
    "",
    operation_id="put_floor_plan",
    responses=problems(415),
    dependencies=[Depends(sends_plan)],
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                str(kind): {"schema": {"type": "string", "format": "binary"}} for kind in PlanKind
            },
        }
    },
)
async def put_floor_plan(
    map_id: str, request: Request, asker: Asks, services: ServicesDep, level: PlanLevel = None
) -> MapBody:
    """Put a plan below a map; an older one goes, its placement stays.

    PNG and JPEG are kept as they are; the first page of a PDF, an SVG and GeoJSON (degrees or
    metres) are drawn as a PNG. `width_m` is told where the plan says how wide it is. Of GeoJSON
    with several levels one is chosen by its name: without `level` the refusal lists the `levels`.
    """
    await run_in_threadpool(_refuse, services, asker, map_id)
    limits, user = services.settings.limits, asker.user_id or map_id
    with services.drawing.place(user), scratch(services.settings) as folder:
        file = folder / "plan"
        room = Quota(limits.floor_plan_bytes, limits.free_bytes)
        await append(file, request.receive, room, None)
        return await services.drawing.run(user, partial(_put, services, asker, map_id, file, level))


def _refuse(services: Services, asker: Principal, map_id: str) -> None:
    """Raise Problem where no plan may be put below a map."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        refuse_full(services, session, found.user_id)


def _put(
    services: Services, asker: Principal, map_id: str, file: Path, level: str | None
) -> MapBody:
    """Draw the plan in a file and put it below a map."""
    facts = _drawn(services, file, level)
    store = services.settings.blobs_folder
    with blobs.locked(store):
        blob = blobs.put(store, file)
        with transaction(services.sessions) as session:
            found = map_for(session, asker, map_id, Right.EDIT)
            older = session.get(MapFile, (map_id, FLOOR_PLAN))
            named = [] if older is None else [older.sha256]
            session.merge(MapFile(map_id=map_id, name=FLOOR_PLAN, **asdict(blob)))
            found.floor_plan = {"placement": None, **(found.floor_plan or {}), **facts}
            answer = body_of(session, asker, found)
    drop_unnamed(services, named)
    return answer


def _drawn(services: Services, file: Path, level: str | None) -> dict[str, Any]:
    """Type and size of the picture that a child makes of a plan.

    Raises Problem 422, with the levels where one is to be chosen.
    """
    try:
        bounds = bounds_of(services.settings.limits)
        return dict(services.children.parse(DRAWER, bounds, file=str(file), level=level))
    except InputError as refused:
        raise Problem(422, f"the plan {refused}", levels=refused.choices) from refused


def bounds_of(limits: Limits) -> Bounds:
    """What drawing a plan may cost."""
    return Bounds(
        processor_s=limits.drawing_s,
        wall_s=limits.drawing_s + SHARING_S,
        memory_bytes=limits.drawing_bytes,
        file_bytes=limits.floor_plan_bytes * FILE_FACTOR,
        advice="simplify it, or save it as a smaller PNG",
    )


@plan_router.get(
    "",
    operation_id="get_floor_plan",
    response_class=FileResponse,
    responses={200: {"content": {str(kind): {} for kind in (PlanKind.PNG, PlanKind.JPEG)}}},
)
def get_floor_plan(map_id: str, asker: Asks, services: ServicesDep) -> FileResponse:
    """The image below a map."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id)
        file = session.get(MapFile, (map_id, FLOOR_PLAN))
    if file is None or found.floor_plan is None:
        raise _none()
    kind = found.floor_plan["type"]
    return sent_blob(services.settings, file.sha256, "floor plan", kind)


@plan_router.delete("", status_code=204, operation_id="delete_floor_plan")
def delete_floor_plan(map_id: str, asker: Asks, services: ServicesDep) -> None:
    """Take away the image below a map."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        file = session.get(MapFile, (map_id, FLOOR_PLAN))
        if file is None:
            raise _none()
        found.floor_plan = None
        session.delete(file)
    drop_unnamed(services, [file.sha256])


@plan_router.put("/placement", operation_id="place_floor_plan")
def place_floor_plan(
    map_id: str, placement: ImagePlacement, asker: Asks, services: ServicesDep
) -> MapBody:
    """Say where the image lies."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        if found.floor_plan is None:
            raise _none()
        found.floor_plan = {**found.floor_plan, "placement": placement.model_dump()}
        return body_of(session, asker, found)


def _none() -> Problem:
    return Problem(404, "this map has no floor plan; send an image first")
