"""Resumable uploads: tus 1.0 with creation, deferred lengths, checksums and termination.

An upload is a row, and a file whose length is the offset. A byte that was acknowledged is on the
disk.
"""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Request, Response
from sqlalchemy import func, select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from elfslam.data.atomic_files import sync
from elfslam.serve.people.access import Me, not_found, own
from elfslam.serve.people.guards import TUS_VERSION, UPLOADS
from elfslam.serve.problems import WRONG_CHECKSUM, Problem, disk_full, problems
from elfslam.serve.receiving import tus
from elfslam.serve.receiving.completing import finish_whole
from elfslam.serve.receiving.tus import Quota, append
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import refuse_full_disk
from elfslam.serve.store.database import count_rows, reading, transaction
from elfslam.serve.store.quota import refuse_more_recordings, upload_bytes, used_bytes
from elfslam.serve.store.tables import (
    Recording,
    RecordingFile,
    RecordingState,
    Upload,
    User,
    new_id,
)
from elfslam.serve.store.zips import FILE_NAMES, WHOLE, is_whole
from elfslam.serve.texts import AsWhole, plain_line


@dataclass(frozen=True)
class Wanted:
    """An upload that somebody wants to begin."""

    file_name: str
    recording_id: str | None
    length_bytes: int | None
    wants_map: bool


def forget_upload(services: Services, upload_id: str) -> None:
    """Delete an upload, the row first."""
    with transaction(services.sessions) as session:
        upload = session.get(Upload, upload_id)
        if upload is not None:
            session.delete(upload)
    file_of(services.settings, upload_id).unlink(missing_ok=True)


def expires_utc(services: Services, upload: Upload) -> datetime:
    """When an upload is deleted if nothing is added to it."""
    file = file_of(services.settings, upload.id)
    touched = upload.created_utc
    if file.is_file():
        touched = datetime.fromtimestamp(file.stat().st_mtime, UTC)
    return touched + timedelta(days=services.settings.limits.upload_days)


def wanted_of(told: dict[str, str], length: int | None, defers: str | None) -> Wanted:
    """What the headers of a creation ask for. Raises Problem 400."""
    if (length is None) == (defers is None) or defers not in (None, "1"):
        raise Problem(400, "wanted either Upload-Length or Upload-Defer-Length: 1; send one")
    name, recording_id = told.get("filename", ""), told.get("recording")
    if is_whole(name) and recording_id is None:
        try:
            plain_line(name[:-1])
        except ValueError as error:
            raise Problem(400, f"filename {name!r:.60}: {error}; rename the file") from error
    elif name not in FILE_NAMES or recording_id is None:
        raise Problem(
            400,
            f"filename {name!r:.60}: wanted a file of a recording folder with its recording, "
            f"or all of a walk without one ({', '.join(WHOLE)})",
        )
    return Wanted(name, recording_id, length, told.get("map", "true") != "false")


def begin(services: Services, user: User, wanted: Wanted) -> Upload:
    """A new upload, its empty file on the disk. Raises Problem."""
    limits, upload_id = services.settings.limits, new_id()
    file = file_of(services.settings, upload_id)
    with transaction(services.sessions) as session:
        if wanted.recording_id is None:
            refuse_more_recordings(services, session, user.id)
        _check_recording(session, user, wanted)
        open_ones = Upload.user_id == user.id, Upload.finished.is_(False)
        if count_rows(session, Upload, *open_ones) >= limits.open_uploads:
            raise Problem(409, f"{limits.open_uploads} uploads are open; end one first")
        upload = Upload(id=upload_id, user_id=user.id, **asdict(wanted))
        session.add(upload)
        session.flush()
        _check_room(services, session, upload, wanted.length_bytes or 0)
        file.touch(mode=0o600)
        sync(file.parent)
    return upload


def _check_recording(session: Session, user: User, wanted: Wanted) -> None:
    if wanted.recording_id is None:
        return
    recording = own(session, Recording, wanted.recording_id, user, "recording")
    if recording.state != RecordingState.RECEIVING:
        raise Problem(409, "this recording is complete; begin a new one")


def mine(services: Services, user: User, upload_id: str) -> Upload:
    """An upload of the user's. Raises Problem 404."""
    with reading(services.sessions) as session:
        return own(session, Upload, upload_id, user, "upload")


def ready_to_append(
    services: Services,
    user: User,
    upload_id: str,
    offset_bytes: int,
    length_bytes: int | None,
    claimed_bytes: int,
) -> tuple[Upload, Quota]:
    """An upload that has come so far, and the room it has for so much more.

    The length counts where it was deferred. Raises Problem 404, 409, 413, 507.
    """
    upload = _at_offset(services, user, upload_id, offset_bytes)
    if length_bytes is not None:
        _declare_length(services, upload, length_bytes)
    return upload, room_for(services, upload, claimed_bytes)


def _at_offset(services: Services, user: User, upload_id: str, offset: int) -> Upload:
    """An upload that has come so far. Raises Problem 404, 409."""
    upload = mine(services, user, upload_id)
    come = _offset_bytes(services.settings, upload)
    if come != offset:
        raise Problem(
            409,
            f"Upload-Offset is {offset}, {come} bytes have come; go on from there",
            {"Upload-Offset": str(come)},
        )
    return upload


def _declare_length(services: Services, upload: Upload, length: int) -> None:
    """Keep the length that was deferred. Raises Problem 409, 413."""
    come = upload_bytes(services.settings, upload.id)
    if length < come:
        raise Problem(409, f"Upload-Length {length} is less than what has come; correct it")
    if upload.length_bytes not in (None, length):
        raise Problem(409, f"Upload-Length was {upload.length_bytes} before; it cannot change")
    with transaction(services.sessions) as session:
        kept = session.get(Upload, upload.id)
        if kept is None:
            raise not_found("upload")
        kept.length_bytes = upload.length_bytes = length
        _check_room(services, session, upload, length - come)


def room_for(services: Services, upload: Upload, claimed_bytes: int) -> Quota:
    """The room of an upload to which so much is to be added. Raises Problem 413, 507."""
    with reading(services.sessions) as session:
        most = _check_room(services, session, upload, claimed_bytes)
    limits = services.settings.limits
    return Quota(most, limits.free_bytes)


def _check_room(services: Services, session: Session, upload: Upload, more_bytes: int) -> int:
    """How many bytes fit. Raises Problem 413 or 507 where so much more does not."""
    settings, limits = services.settings, services.settings.limits
    come = upload_bytes(settings, upload.id)
    whole = limits.file_bytes if upload.length_bytes is None else upload.length_bytes
    left = {
        "this file": min(whole, limits.file_bytes) - come,
        "a recording": limits.recording_bytes - _recording_bytes(services, session, upload),
        "you": limits.user_bytes - used_bytes(services, session, upload.user_id),
    }
    what, most = min(left.items(), key=lambda item: item[1])
    if more_bytes > most:
        raise Problem(
            413, f"{more_bytes} bytes more are too many, {max(0, most)} are left for {what}"
        )
    try:
        refuse_full_disk(settings.uploads_folder, more_bytes, limits.free_bytes)
    except OSError as error:
        raise disk_full() from error
    return most


def _recording_bytes(services: Services, session: Session, upload: Upload) -> int:
    if upload.recording_id is None:
        return upload_bytes(services.settings, upload.id)
    files = select(func.sum(RecordingFile.size_bytes)).filter_by(recording_id=upload.recording_id)
    uploads = session.scalars(select(Upload.id).filter_by(recording_id=upload.recording_id))
    on_the_way = sum(upload_bytes(services.settings, name) for name in uploads)
    return int(session.scalar(files) or 0) + on_the_way


def headers_of(services: Services, upload: Upload) -> dict[str, str]:
    file = file_of(services.settings, upload.id)
    if file.is_file():
        sync(file)
    headers = {
        "Upload-Offset": str(_offset_bytes(services.settings, upload)),
        "Upload-Expires": format_datetime(expires_utc(services, upload), usegmt=True),
    }
    if is_whole(upload.file_name) and upload.recording_id:
        headers["Elfslam-Recording"] = upload.recording_id
    return headers


def _offset_bytes(settings: ServerSettings, upload: Upload) -> int:
    if upload.finished and upload.length_bytes is not None:
        return upload.length_bytes
    return upload_bytes(settings, upload.id)


def file_of(settings: ServerSettings, upload_id: str) -> Path:
    return settings.uploads_folder / upload_id


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
    wanted = wanted_of(tus.parse_metadata(upload_metadata), upload_length, upload_defer_length)
    checksum = tus.parse_checksum(upload_checksum)
    upload = await run_in_threadpool(begin, services, user, wanted)
    try:
        if content_type:
            await _append_at_once(services, upload, request, content_type, checksum)
        headers = await _headers_when_written(services, upload)
    except BaseException:
        forget_upload(services, upload.id)  # nobody heard of it
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
    upload = await run_in_threadpool(mine, services, user, upload_id)
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
        told = upload_offset, upload_length, _claimed(request)
        upload, room = await run_in_threadpool(ready_to_append, services, user, upload_id, *told)
        await append(file_of(services.settings, upload_id), request.receive, room, checksum)
    return Response(status_code=204, headers=await _headers_when_written(services, upload))


@router.delete(
    "/{upload_id}",
    status_code=204,
    operation_id="end_upload",
    responses=OWN_STATUSES,
    dependencies=SPEAKS_TUS,
)
def end_upload(upload_id: str, user: Me, services: ServicesDep) -> None:
    """Give an upload up; what had come is deleted."""
    mine(services, user, upload_id)
    with services.busy.alone([upload_id]):
        forget_upload(services, upload_id)


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
        room = await run_in_threadpool(room_for, services, upload, _claimed(request))
        await append(file_of(services.settings, upload.id), request.receive, room, checksum)


def _claimed(request: Request) -> int:
    return int(request.headers.get("content-length", "0"))


async def _headers_when_written(services: Services, upload: Upload) -> dict[str, str]:
    """Headers that say how far an upload has come; a whole recording is made when it is all."""
    whole = is_whole(upload.file_name) and upload.length_bytes is not None and not upload.finished
    if whole and upload_bytes(services.settings, upload.id) == upload.length_bytes:
        with services.busy.alone([upload.id]):
            upload = await finish_whole(services, upload)
    return await run_in_threadpool(headers_of, services, upload)
