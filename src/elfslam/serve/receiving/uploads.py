"""Routes of resumable uploads: tus 1.0 with creation, deferred lengths, checksums and termination.

The offset of an upload is the length of its file. A byte that was acknowledged is on the disk.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Request, Response
from starlette.concurrency import run_in_threadpool

from elfslam.serve.people.access import Me
from elfslam.serve.people.guards import TUS_VERSION, UPLOADS
from elfslam.serve.problems import WRONG_CHECKSUM, problems
from elfslam.serve.receiving import tus
from elfslam.serve.receiving import upload_store as store
from elfslam.serve.receiving.completing import finish_whole
from elfslam.serve.receiving.tus import append
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.quota import upload_bytes
from elfslam.serve.store.tables import Upload
from elfslam.serve.store.zips import is_whole
from elfslam.serve.texts import AsWhole

router = APIRouter(prefix="/uploads", tags=["uploads"])
LARGEST = 2**53
OWN_STATUSES = problems(408, 409, 412, 415, 423, WRONG_CHECKSUM)


def _described(**headers: str) -> dict[str, Any]:
    """Headers of a response, for the OpenAPI description."""
    return {
        name.replace("_", "-"): {"description": text, "schema": {"type": "string"}}
        for name, text in headers.items()
    }


TOLD = _described(
    Upload_Offset="bytes that are on the disk",
    Upload_Length="bytes in all, where that was said",
    Upload_Expires="when it is deleted if nothing is added",
    Elfslam_Recording="the recording that came of a whole file, the first of several",
)
BEGUN = {**TOLD, **_described(Location="where the bytes go")}


async def speaks_tus(tus_resumable: Annotated[str, Header()] = "") -> None:
    """Refuse a client of another version of the protocol."""
    tus.check_version(tus_resumable)


SPEAKS_TUS = [Depends(speaks_tus)]
COUNT = Header(ge=0, le=LARGEST)
Bytes = Annotated[int | None, AsWhole, COUNT]


@router.options("", status_code=204, operation_id="describe_uploads")
def describe_uploads(_user: Me, services: ServicesDep) -> Response:
    """What of the tus protocol is spoken here."""
    return Response(
        status_code=204,
        headers={
            "Tus-Version": TUS_VERSION,
            "Tus-Max-Size": str(services.settings.limits.file_bytes),
            "Tus-Extension": tus.EXTENSIONS,
            "Tus-Checksum-Algorithm": ",".join(tus.ALGORITHMS),
        },
    )


@router.post(
    "",
    status_code=201,
    operation_id="begin_upload",
    response_class=Response,
    responses={**OWN_STATUSES, 201: {"headers": BEGUN, "description": "Send the bytes there"}},
    dependencies=SPEAKS_TUS,
)
async def begin_upload(
    request: Request,
    user: Me,
    services: ServicesDep,
    upload_metadata: Annotated[str, Header()] = "",
    upload_length: Bytes = None,
    upload_defer_length: Annotated[str | None, Header()] = None,
    upload_checksum: Annotated[str | None, Header()] = None,
    content_type: Annotated[str, Header()] = "",
) -> Response:
    """Begin the upload of one file; `Location` says where its bytes go.

    `Upload-Metadata` is of tus: pairs by commas, a key, a space, and the value in base64, such as
    `filename d2Fsay56aXA=` for walk.zip.

    `Upload-Metadata` names the `recording` and the `filename`, or else a `filename` that ends in
    .zip, .tar.xz, .txt or .mat: a whole recording, or the log of another program. It is told by its
    content which, and each walk in it becomes a recording.
    """
    wanted = store.wanted_of(
        tus.parse_metadata(upload_metadata), upload_length, upload_defer_length
    )
    checksum = tus.parse_checksum(upload_checksum)
    upload = await run_in_threadpool(store.begin, services, user, wanted)
    try:
        if content_type:
            await _append_at_once(services, upload, request, content_type, checksum)
        headers = await _headers_when_written(services, upload)
    except BaseException:
        store.forget_upload(services, upload.id)  # nobody heard of it
        raise
    return Response(status_code=201, headers={"Location": f"{UPLOADS}/{upload.id}", **headers})


@router.head(
    "/{upload_id}",
    operation_id="look_at_upload",
    response_class=Response,
    responses={**OWN_STATUSES, 200: {"headers": TOLD, "description": "How far it has come"}},
    dependencies=SPEAKS_TUS,
)
async def look_at_upload(upload_id: str, user: Me, services: ServicesDep) -> Response:
    """How much of an upload is on the disk: go on from there."""
    upload = await run_in_threadpool(store.mine, services, user, upload_id)
    headers = await _headers_when_written(services, upload)
    length = upload.length_bytes
    headers |= {"Upload-Defer-Length": "1"} if length is None else {"Upload-Length": str(length)}
    told = {"filename": upload.file_name}
    if upload.recording_id and not is_whole(upload.file_name):
        told["recording"] = upload.recording_id
    return Response(headers={**headers, "Upload-Metadata": tus.metadata(told)})


@router.patch(
    "/{upload_id}",
    status_code=204,
    operation_id="append_to_upload",
    responses={**OWN_STATUSES, 204: {"headers": TOLD, "description": "It is on the disk"}},
    dependencies=SPEAKS_TUS,
    openapi_extra={
        "requestBody": {
            "content": {tus.CONTENT_TYPE: {"schema": {"type": "string", "format": "binary"}}}
        }
    },
)
async def append_to_upload(
    upload_id: str,
    request: Request,
    user: Me,
    services: ServicesDep,
    upload_offset: Annotated[int, AsWhole, COUNT],
    upload_length: Bytes = None,
    upload_checksum: Annotated[str | None, Header()] = None,
    content_type: Annotated[str, Header()] = "",
) -> Response:
    """Add bytes at the offset; the answer comes when they are safe on the disk."""
    tus.check_content_type(content_type)
    checksum = tus.parse_checksum(upload_checksum)
    with services.busy.alone([upload_id]):
        upload, room = await run_in_threadpool(
            store.ready_to_append,
            services,
            user,
            upload_id,
            store.Appended(upload_offset, upload_length, _claimed(request)),
        )
        await append(store.file_of(services.settings, upload_id), request.receive, room, checksum)
    return Response(status_code=204, headers=await _headers_when_written(services, upload))


@router.delete(
    "/{upload_id}",
    status_code=204,
    operation_id="end_upload",
    responses=OWN_STATUSES,
    dependencies=SPEAKS_TUS,
)
def end_upload(upload_id: str, user: Me, services: ServicesDep) -> Response:
    """Give an upload up; what had come is deleted."""
    store.mine(services, user, upload_id)
    with services.busy.alone([upload_id]):
        store.forget_upload(services, upload_id)
    return Response(status_code=204)


async def _append_at_once(
    services: Services,
    upload: Upload,
    request: Request,
    content_type: str,
    checksum: tus.Checksum | None,
) -> None:
    """The body of a creation."""
    tus.check_content_type(content_type)
    with services.busy.alone([upload.id]):
        room = await run_in_threadpool(store.room_for, services, upload, _claimed(request))
        await append(store.file_of(services.settings, upload.id), request.receive, room, checksum)


def _claimed(request: Request) -> int:
    return int(request.headers.get("content-length", "0"))


async def _headers_when_written(services: Services, upload: Upload) -> dict[str, str]:
    """Headers that say how far an upload has come; a whole recording is made when it is all."""
    whole = is_whole(upload.file_name) and upload.length_bytes is not None and not upload.finished
    if whole and upload_bytes(services.settings, upload.id) == upload.length_bytes:
        with services.busy.alone([upload.id]):
            upload = await finish_whole(services, upload)
    return await run_in_threadpool(store.headers_of, services, upload)
