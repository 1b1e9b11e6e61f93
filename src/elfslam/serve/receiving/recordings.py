"""Routes of recordings: begin, complete, look at, look into, fetch, rename, delete."""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import partial
from pathlib import PurePosixPath
from typing import Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Header, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import AfterValidator, BaseModel, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from elfslam import __version__
from elfslam.base.errors import InputError
from elfslam.serve.people.access import Me, not_found, own
from elfslam.serve.problems import Problem, problems
from elfslam.serve.receiving.completing import FileBody, complete
from elfslam.serve.receiving.reader import SENSORS, Look, bounds_of
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.blobs import found_blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import delete_recordings, refuse_more_recordings, upload_bytes
from elfslam.serve.store.sending import BINARY, ZIP, sent, sent_blob, unfolded
from elfslam.serve.store.tables import (
    Recording,
    RecordingFacts,
    RecordingFile,
    RecordingState,
    Upload,
    User,
)
from elfslam.serve.store.zips import FILE_NAMES, packed
from elfslam.serve.texts import Deleted, Line, Many, StartPose

router = APIRouter(prefix="/recordings", tags=["recordings"])


class NewRecording(BaseModel):
    """A walk that begins."""

    name: Line
    device: Line = "unknown"
    start_pose: StartPose | None = None


class UploadBody(BaseModel):
    """A file that is on its way."""

    id: str
    file_name: str
    offset_bytes: int
    length_bytes: int | None


OF_THE_ROW = ("id", "name", "device", "state", "refusal", "facts", "created_utc")


class RecordingBody(BaseModel):
    """A recording, as its user sees it."""

    id: str
    name: str
    device: str
    state: RecordingState
    refusal: str | None
    facts: dict[str, Any]
    files: list[FileBody]
    uploads: list[UploadBody]
    created_utc: datetime


def _known_names(files: list[FileBody]) -> list[FileBody]:
    names = [file.name for file in files]
    if unknown := sorted(set(names) - FILE_NAMES):
        raise ValueError(f"{unknown[0]!r:.60} is no file of a recording folder")
    if len(set(names)) < len(names):
        raise ValueError("a file is named twice")
    return files


class Completion(BaseModel):
    """What should have come."""

    files: Annotated[
        list[FileBody],
        Field(min_length=1, max_length=len(FILE_NAMES)),
        AfterValidator(_known_names),
    ]
    map: bool = True


@router.post("", status_code=201, operation_id="begin_recording", responses=problems(409))
def begin_recording(given: NewRecording, user: Me, services: ServicesDep) -> RecordingBody:
    """Begin a recording, to which files are then uploaded."""
    with transaction(services.sessions) as session:
        refuse_more_recordings(services, session, user.id)
        facts: RecordingFacts = (
            {} if given.start_pose is None else {"start_pose": list(given.start_pose)}
        )
        recording = Recording(user_id=user.id, name=given.name, device=given.device, facts=facts)
        session.add(recording)
        session.flush()
        return body_of(services, session, recording)


@router.get("", operation_id="list_recordings")
def list_recordings(user: Me, services: ServicesDep) -> list[RecordingBody]:
    """Your recordings, the newest first."""
    newest = (Recording.created_utc.desc(), Recording.id)
    with reading(services.sessions) as session:
        mine = session.scalars(select(Recording).filter_by(user_id=user.id).order_by(*newest))
        return _bodies(services, session, mine.all())


@router.get("/{recording_id}", operation_id="get_recording")
def get_recording(recording_id: str, user: Me, services: ServicesDep) -> RecordingBody:
    """One recording and what is still on its way."""
    with reading(services.sessions) as session:
        return body_of(services, session, my_recording(session, user, recording_id))


@router.delete("/{recording_id}", status_code=204, operation_id="delete_recording")
def remove_recording(recording_id: str, user: Me, services: ServicesDep) -> None:
    """Delete a recording and its files."""
    with reading(services.sessions) as session:
        my_recording(session, user, recording_id)
    delete_recordings(services, user.id, [recording_id])


@router.post(
    "/{recording_id}/complete", operation_id="complete_recording", responses=problems(409, 423)
)
async def complete_recording(
    recording_id: str, given: Completion, user: Me, services: ServicesDep
) -> RecordingBody:
    """Say what the uploads should amount to: they are checked, read, kept, and mapped.

    Asked again it answers the same. 409 says which file has not come whole, 422 why the reader
    refused the folder.
    """
    work = partial(_complete, services, user, recording_id, given)
    return await services.reading.run(user.id, work)


@router.get(
    "/{recording_id}/recording.zip",
    operation_id="download_recording",
    response_class=StreamingResponse,
    responses={**problems(409), 200: {"content": {ZIP: {}}}},
)
def download_recording(recording_id: str, user: Me, services: ServicesDep) -> StreamingResponse:
    """The recording's folder as a .zip, which `elfslam map` reads."""
    with reading(services.sessions) as session:
        recording = my_recording(session, user, recording_id)
        files = list(_files(session, [recording]))
    if recording.state == RecordingState.RECEIVING:
        raise Problem(409, "this recording is still being received; complete it first")
    folder = services.settings.blobs_folder
    try:
        pieces = packed({file.name: found_blob(folder, file.sha256) for file in files})
    except FileNotFoundError as error:
        raise not_found("recording") from error
    return sent(pieces, f"{recording.name}.zip", ZIP)


def my_recording(session: Session, user: User, recording_id: str) -> Recording:
    """A recording of the user's. Raises Problem 404."""
    return own(session, Recording, recording_id, user, "recording")


def _complete(
    services: Services, user: User, recording_id: str, given: Completion
) -> RecordingBody:
    with reading(services.sessions) as session:
        my_recording(session, user, recording_id)
    complete(services, recording_id, given.files, wants_map=given.map)
    with reading(services.sessions) as session:
        recording = my_recording(session, user, recording_id)
        if recording.refusal is not None:
            raise Problem(422, recording.refusal)
        return body_of(services, session, recording)


def _files(session: Session, recordings: Sequence[Recording]) -> Iterable[RecordingFile]:
    ids = [recording.id for recording in recordings]
    mine = select(RecordingFile).where(RecordingFile.recording_id.in_(ids))
    return session.scalars(mine.order_by(RecordingFile.name))


def body_of(services: Services, session: Session, recording: Recording) -> RecordingBody:
    """A recording as the API tells it."""
    return _bodies(services, session, [recording])[0]


def _bodies(
    services: Services, session: Session, recordings: Sequence[Recording]
) -> list[RecordingBody]:
    """Recordings as the API tells them, in a few queries however many they are."""
    ids = [recording.id for recording in recordings]
    open_ones = select(Upload).filter_by(finished=False).where(Upload.recording_id.in_(ids))
    files, uploads = defaultdict(list), defaultdict(list)
    for file in _files(session, recordings):
        files[file.recording_id].append(FileBody.model_validate(file, from_attributes=True))
    for upload in session.scalars(open_ones.order_by(Upload.created_utc, Upload.id)):
        uploads[upload.recording_id].append(_on_its_way(services, upload))
    return [
        RecordingBody(
            **{name: getattr(each, name) for name in OF_THE_ROW},
            files=files[each.id],
            uploads=uploads[each.id],
        )
        for each in recordings
    ]


def _on_its_way(services: Services, upload: Upload) -> UploadBody:
    return UploadBody(
        id=upload.id,
        file_name=upload.file_name,
        offset_bytes=upload_bytes(services.settings, upload.id),
        length_bytes=upload.length_bytes,
    )


class RecordingChange(BaseModel):
    """What a recording is to be called."""

    name: Line


@router.patch("/{recording_id}", operation_id="rename_recording")
def rename_recording(
    recording_id: str, given: RecordingChange, user: Me, services: ServicesDep
) -> RecordingBody:
    """Call a recording otherwise; maps that were made of it keep their names."""
    with transaction(services.sessions) as session:
        recording = my_recording(session, user, recording_id)
        recording.name = given.name
        return body_of(services, session, recording)


@router.post("/delete", operation_id="delete_recordings")
def remove_recordings(given: Many, user: Me, services: ServicesDep) -> Deleted:
    """Delete many of your recordings at once; what is not there, or not yours, is passed over."""
    return Deleted(count=delete_recordings(services, user.id, given.ids))


TYPES = {
    ".csv": "text/csv",
    ".tum": "text/plain",
    ".json": "application/json",
    ".flac": "audio/flac",
    ".wav": "audio/wav",
}
NEVER_OLD = {"Cache-Control": "private, no-cache"}
"""A browser may keep it, and asks each time whether it still is so."""


@router.get(
    "/{recording_id}/sensors",
    operation_id="look_at_recording",
    response_model=Look,
    responses={**problems(409), 304: {"description": "It is as you know it"}},
)
async def look_at_recording(
    recording_id: str,
    user: Me,
    services: ServicesDep,
    response: Response,
    if_none_match: Annotated[str, Header()] = "",
) -> Any:
    """The sensors of a recording and their curves, some thousand numbers however long it is."""
    named = await to_thread.run_sync(_kept_files, services, user, recording_id)
    known = {"ETag": _tag(named), **NEVER_OLD}
    if known["ETag"] in if_none_match:
        return Response(status_code=304, headers=known)
    look = await services.reading.run(user.id, partial(_look, services, named))
    response.headers.update(known)
    return look


@router.get(
    "/{recording_id}/files/{file_name}",
    operation_id="download_recording_file",
    response_class=FileResponse,
    responses={**problems(409), 200: {"content": {kind: {} for kind in TYPES.values()}}},
)
def download_recording_file(
    recording_id: str, file_name: str, user: Me, services: ServicesDep
) -> FileResponse:
    """One file of a recording's folder: a sensor's table, say."""
    named = _kept_files(services, user, recording_id)
    if file_name not in FILE_NAMES or file_name not in named:
        raise not_found("file")
    with reading(services.sessions) as session:
        walk = my_recording(session, user, recording_id).name
    kind = TYPES.get(PurePosixPath(file_name).suffix, BINARY)
    told = f"{walk}-{file_name}".replace("/", "_")
    return sent_blob(services.settings, named[file_name], "file", kind, filename=told)


def _kept_files(services: Services, user: User, recording_id: str) -> dict[str, str]:
    """SHA-256 by the name of a file. Raises Problem 404, 409."""
    with reading(services.sessions) as session:
        recording = my_recording(session, user, recording_id)
        rows = session.scalars(select(RecordingFile).filter_by(recording_id=recording.id)).all()
    if recording.state == RecordingState.RECEIVING:
        raise Problem(409, "this recording is still being received; complete it first")
    if not rows:
        raise Problem(409, f"nothing of this recording was kept: {recording.refusal}")
    return {row.name: row.sha256 for row in rows}


def _tag(named: Mapping[str, str]) -> str:
    told = [__version__, *(f"{name} {sha256}" for name, sha256 in sorted(named.items()))]
    return f'"{hashlib.sha256(chr(10).join(told).encode()).hexdigest()[:32]}"'


def _look(services: Services, named: Mapping[str, str]) -> dict[str, Any]:
    """What a child sees. Raises Problem 404, 409, 503."""
    bounds = bounds_of(services.settings.limits)
    try:
        with unfolded(services.settings, named) as folder:
            return dict(services.children.parse(SENSORS, bounds, folder=str(folder)))
    except FileNotFoundError as gone:
        raise not_found("recording") from gone
    except InputError as refused:
        raise Problem(409, str(refused)) from refused
