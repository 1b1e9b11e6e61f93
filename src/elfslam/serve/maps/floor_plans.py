"""Routes of floor plans: an image below a map, and where on the map it lies."""

from __future__ import annotations

import io
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import FileResponse
from PIL import Image, UnidentifiedImageError
from pydantic import BaseModel, Field

from elfslam.serve.jobs.routes import refuse_full
from elfslam.serve.jobs.tasks import FLOOR_PLAN
from elfslam.serve.maps.bodies import MapBody, body_of
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
"""Nobody's image is read before it is known who asks."""
TYPES = {"PNG": "image/png", "JPEG": "image/jpeg"}
MOST_PIXELS = 40_000_000
TOO_MANY_PIXELS = Problem(
    422, f"the image has more than {MOST_PIXELS // 10**6} million pixels; make it smaller"
)
ORIENTATION, ON_ITS_SIDE = 0x0112, (5, 6, 7, 8)
"""Of EXIF: browsers turn such images by a quarter."""
FARTHEST_M = 1e6


class ImagePlacement(BaseModel):
    """How wide the image is, and where its lower left corner lies in the map."""

    width_m: float = Field(gt=0, le=10_000, allow_inf_nan=False)
    x_m: float = Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)
    y_m: float = Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)
    heading_rad: float = Field(0.0, ge=-100, le=100, allow_inf_nan=False)
    opacity: float = Field(0.5, ge=0, le=1, allow_inf_nan=False)


async def image_body(request: Request) -> bytes:
    """The body of a request that carries an image."""
    if request.headers.get("content-type", "").partition(";")[0].strip() not in TYPES.values():
        raise Problem(415, f"wanted {' or '.join(TYPES.values())}; save the plan as one of these")
    return await request.body()


@router.put(
    "",
    operation_id="put_floor_plan",
    responses=problems(415),
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                kind: {"schema": {"type": "string", "format": "binary"}} for kind in TYPES.values()
            },
        }
    },
)
def put_floor_plan(
    map_id: str, image: Annotated[bytes, Depends(image_body)], asker: Asks, services: Here
) -> MapBody:
    """Put an image (PNG or JPEG) below a map; an older one goes, its placement stays."""
    with reading(services.sessions) as session:
        found = map_for(session, asker, map_id, Right.EDIT)
        refuse_full(services, session, found.user_id)
    facts = facts_of_image(image)
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
    responses={200: {"content": {kind: {} for kind in TYPES.values()}}},
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


def facts_of_image(content: bytes) -> dict[str, Any]:
    """Type and size of a whole PNG or JPEG, as a browser shows it. Raises Problem 422."""
    try:
        with Image.open(io.BytesIO(content), formats=list(TYPES)) as image:
            width, height = image.size
            if width * height > MOST_PIXELS:
                raise TOO_MANY_PIXELS
            image.load()
            turned = image.getexif().get(ORIENTATION) in ON_ITS_SIDE
            kind = TYPES[str(image.format)]
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as cause:
        raise TOO_MANY_PIXELS from cause
    except (OSError, ValueError, SyntaxError) as cause:
        why = "something else" if isinstance(cause, UnidentifiedImageError) else "a damaged one"
        raise Problem(422, f"wanted a PNG or JPEG image, got {why}; save the plan again") from cause
    size = (height, width) if turned else (width, height)
    return {"width_px": size[0], "height_px": size[1], "type": kind}


def _none() -> Problem:
    return Problem(404, "this map has no floor plan; send an image first")
