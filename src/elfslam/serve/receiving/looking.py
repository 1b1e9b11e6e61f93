"""Routes of what a recording holds: curves of its sensors, and its files one by one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import partial
from pathlib import PurePosixPath
from typing import Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Header, Response
from fastapi.responses import FileResponse
from sqlalchemy import select

from elfslam import __version__
from elfslam.base.errors import InputError
from elfslam.serve.people.access import Me, not_found
from elfslam.serve.problems import Problem, problems
from elfslam.serve.receiving.curves import Look
from elfslam.serve.receiving.reading import bounds_of
from elfslam.serve.receiving.recordings import my_recording
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.store.database import RecordingFile, RecordingState, User, reading
from elfslam.serve.store.folder_files import FILE_NAMES
from elfslam.serve.store.sending import sent_blob, unfolded

router = APIRouter(prefix="/recordings/{recording_id}", tags=["recordings"])
TYPES = {
    ".csv": "text/csv",
    ".tum": "text/plain",
    ".json": "application/json",
    ".flac": "audio/flac",
    ".wav": "audio/wav",
}
READER = "elfslam.serve.receiving.sensors"
BINARY = "application/octet-stream"
NEVER_OLD = {"Cache-Control": "private, no-cache"}
"""A browser may keep it, and asks each time whether it still is so."""


@router.get(
    "/sensors",
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
    named = await to_thread.run_sync(_files, services, user, recording_id)
    known = {"ETag": _tag(named), **NEVER_OLD}
    if known["ETag"] in if_none_match:
        return Response(status_code=304, headers=known)
    look = await services.reading.run(user.id, partial(_look, services, named))
    response.headers.update(known)
    return look


@router.get(
    "/files/{file_name}",
    operation_id="download_recording_file",
    response_class=FileResponse,
    responses={**problems(409), 200: {"content": {kind: {} for kind in TYPES.values()}}},
)
def download_recording_file(
    recording_id: str, file_name: str, user: Me, services: ServicesDep
) -> FileResponse:
    """One file of a recording's folder: a sensor's table, say."""
    named = _files(services, user, recording_id)
    if file_name not in FILE_NAMES or file_name not in named:
        raise not_found("file")
    with reading(services.sessions) as session:
        walk = my_recording(session, user, recording_id).name
    kind = TYPES.get(PurePosixPath(file_name).suffix, BINARY)
    told = f"{walk}-{file_name}".replace("/", "_")
    return sent_blob(services.settings, named[file_name], "file", kind, filename=told)


def _files(services: Services, user: User, recording_id: str) -> dict[str, str]:
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
            return dict(services.children.parse(READER, bounds, folder=str(folder)))
    except FileNotFoundError as gone:
        raise not_found("recording") from gone
    except InputError as refused:
        raise Problem(409, str(refused)) from refused
