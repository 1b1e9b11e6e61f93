"""Routes of floor plans: an image below a map, and where on the map it lies."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.data.plan_pictures import PlanKind
from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.bodies import MapBody, body_of
from elfslam.serve.parsing.child import Bounds
from elfslam.serve.problems import Problem, problems
from elfslam.serve.receiving.completing import scratch
from elfslam.serve.receiving.tus import Quota, append
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.settings import Limits
from elfslam.serve.sharing.rights import Asks, Principal, Right, current_asker, map_for
from elfslam.serve.store import blobs
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed
from elfslam.serve.store.sending import sent_blob
from elfslam.serve.store.tables import MapFile

router = APIRouter(
    tags=["maps"], prefix="/maps/{map_id}/floor-plan", dependencies=[Depends(current_asker)]
)
"""Nobody's plan is read before it is known who asks."""
DRAWER = "elfslam.serve.maps.plan_drawing"
SHARING_S, FILE_FACTOR = 180.0, 4
"""How long a child may wait for a processor in all; what it draws may be larger than what came."""
PlanLevel = Annotated[str | None, Query(max_length=80)]
ALSO = "application/json"
"""What browsers call GeoJSON."""


class ImagePlacement(BaseModel):
    """How wide the image is, and where its lower left corner lies in the map."""

    width_m: float = Field(gt=0, le=10_000, allow_inf_nan=False)
    x_m: float = Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)
    y_m: float = Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)
    heading_rad: float = Field(0.0, ge=-100, le=100, allow_inf_nan=False)
    opacity: float = Field(0.5, ge=0, le=1, allow_inf_nan=False)


async def sends_plan(request: Request) -> None:
    """Refuse a request whose body is said to be something else."""
    if request.headers.get("content-type", "").partition(";")[0].strip() not in (*PlanKind, ALSO):
        raise Problem(415, f"wanted {', '.join(PlanKind)}; save the plan as one of these")


@router.put(
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


@router.get(
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


@router.delete("", status_code=204, operation_id="delete_floor_plan")
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


@router.put("/placement", operation_id="place_floor_plan")
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
