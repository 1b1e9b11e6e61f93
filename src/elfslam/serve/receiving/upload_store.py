"""Uploads as the server keeps them: a row, and a file whose length is the offset."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from elfslam.data.atomic_files import sync
from elfslam.serve.people.access import known_id, not_found
from elfslam.serve.problems import Problem, disk_full
from elfslam.serve.receiving import tus
from elfslam.serve.receiving.tus import Quota
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import refuse_full_disk
from elfslam.serve.store.database import reading, transaction
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
from elfslam.serve.texts import plain_line


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
        count = select(func.count()).select_from(Upload).filter_by(user_id=user.id, finished=False)
        if (session.scalar(count) or 0) >= limits.open_uploads:
            raise Problem(409, f"{limits.open_uploads} uploads are open; end one first")
        upload = Upload(
            id=upload_id,
            user_id=user.id,
            recording_id=wanted.recording_id,
            file_name=wanted.file_name,
            length_bytes=wanted.length_bytes,
            wants_map=wanted.wants_map,
        )
        session.add(upload)
        session.flush()
        _check_room(services, session, upload, wanted.length_bytes or 0)
        file.touch(mode=0o600)
        sync(file.parent)
    return upload


def _check_recording(session: Session, user: User, wanted: Wanted) -> None:
    if wanted.recording_id is None:
        return
    recording = session.get(Recording, known_id(wanted.recording_id, "recording"))
    if recording is None or recording.user_id != user.id:
        raise not_found("recording")
    if recording.state != RecordingState.RECEIVING:
        raise Problem(409, "this recording is complete; begin a new one")


def mine(services: Services, user: User, upload_id: str) -> Upload:
    """An upload of the user's. Raises Problem 404."""
    with reading(services.sessions) as session:
        upload = session.get(Upload, known_id(upload_id, "upload"))
    if upload is None or upload.user_id != user.id:
        raise not_found("upload")
    return upload


@dataclass(frozen=True)
class Appended:
    """What somebody wants to add: where, of how much in all if that was deferred, how much."""

    offset_bytes: int
    length_bytes: int | None
    claimed_bytes: int


def ready_to_append(
    services: Services, user: User, upload_id: str, wanted: Appended
) -> tuple[Upload, Quota]:
    """An upload and the room it has. Raises Problem 404, 409, 413, 507."""
    upload = _at_offset(services, user, upload_id, wanted.offset_bytes)
    if wanted.length_bytes is not None:
        _declare_length(services, upload, wanted.length_bytes)
    return upload, room_for(services, upload, wanted.claimed_bytes)


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
    limits, settings = services.settings.limits, services.settings
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
        "Upload-Expires": tus.http_date(expires_utc(services, upload)),
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
