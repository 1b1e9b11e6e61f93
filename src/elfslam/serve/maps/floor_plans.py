"""Routes of floor plans: an image below a map, and where on the map it lies."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from elfslam.base.bounds import FARTHEST_M
from elfslam.data.plan_pictures import PlanKind
from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.bodies import MapBody, body_of
from elfslam.serve.maps.plan_pictures import picture_of
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Here
from elfslam.serve.sharing.rights import Asks, Right, current_asker, map_for
from elfslam.serve.store import blobs
from elfslam.serve.store.database import MapFile, reading, transaction
from elfslam.serve.store.holdings import drop_unnamed
from elfslam.serve.store.sending import scratch_file, sent_blob

router = APIRouter(
    tags=["maps"], prefix="/maps/{map_id}/floor-plan", dependencies=[Depends(current_asker)]
)
"""Nobody's plan is read before it is known who asks."""
PICTURES = (PlanKind.PNG, PlanKind.JPEG)
"""What a plan is kept and sent as, whatever it came as."""
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


async def image_body(request: Request) -> bytes:
    """The body of a request that carries a plan."""
    if request.headers.get("content-type", "").partition(";")[0].strip() not in (*PlanKind, ALSO):
        raise Problem(415, f"wanted {', '.join(PlanKind)}; save the plan as one of these")
    return await request.body()


@router.put(
    "",
    operation_id="put_floor_plan",
    responses=problems(415),
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                str(kind): {"schema": {"type": "string", "format": "binary"}} for kind in PlanKind
            },
        }
    },
)
def put_floor_plan(
    map_id: str,
    image: Annotated[bytes, Depends(image_body)],
    asker: Asks,
    services: Here,
    level: PlanLevel = None,
) -> MapBody:
    """Put a plan below a map; an older one goes, its placement stays.

    PNG and JPEG are kept as they are; the first page of a PDF, an SVG and GeoJSON (degrees or
    metres) are drawn as a PNG. `width_m` is told where the plan says how wide it is. Of GeoJSON
    with several levels one is chosen by its name: without `level` the refusal lists the `levels`.
    """
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        refuse_full(services, session, found.user_id)
    image, facts = picture_of(services.settings, image, level)
    store = services.settings.blobs_folder
    with scratch_file(services.settings, image) as file, blobs.locked(store):
        blob = blobs.put(store, file)
        with transaction(services.sessions) as session:
            found = map_for(session, asker, map_id, Right.EDIT)
            older = session.get(MapFile, (map_id, FLOOR_PLAN))
            named = [] if older is None else [older.sha256]
            session.merge(
                MapFile(
                    map_id=map_id, name=FLOOR_PLAN, sha256=blob.sha256, size_bytes=blob.size_bytes
                )
            )
            found.floor_plan = {"placement": None, **(found.floor_plan or {}), **facts}
            answer = body_of(session, asker, found)
    drop_unnamed(services, named)
    return answer


@router.get(
    "",
    operation_id="get_floor_plan",
    response_class=FileResponse,
    responses={200: {"content": {str(kind): {} for kind in PICTURES}}},
)
def get_floor_plan(map_id: str, asker: Asks, services: Here) -> FileResponse:
    """The image below a map."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id)
        file = session.get(MapFile, (map_id, FLOOR_PLAN))
    if file is None or found.floor_plan is None:
        raise _none()
    kind = found.floor_plan["type"]
    return sent_blob(services.settings, file.sha256, "floor plan", kind)


@router.delete("", status_code=204, operation_id="delete_floor_plan")
def delete_floor_plan(map_id: str, asker: Asks, services: Here) -> Response:
    """Take away the image below a map."""
    with transaction(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        file = session.get(MapFile, (map_id, FLOOR_PLAN))
        if file is None:
            raise _none()
        found.floor_plan = None
        session.delete(file)
    drop_unnamed(services, [file.sha256])
    return Response(status_code=204)


@router.put("/placement", operation_id="place_floor_plan")
def place_floor_plan(
    map_id: str, placement: ImagePlacement, asker: Asks, services: Here
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
