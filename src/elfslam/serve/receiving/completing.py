"""From what was uploaded to a recording: checked, read, kept, and a map job queued.

Everything that counts happens in one commit. Whoever is killed before it finds the uploads as
they were and does it again; whoever is killed after it finds the recording, and the files of
uploads without a row are swept when the server starts.
"""

import secrets
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from elfslam.base.enums import Modality
from elfslam.serve.people.access import not_found
from elfslam.serve.problems import Problem
from elfslam.serve.receiving.reader import ReadFolder, Walk, read_apart, walks_apart
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.quota import drop_unnamed, recordings_left, upload_bytes
from elfslam.serve.store.tables import (
    Job,
    JobKind,
    Recording,
    RecordingFacts,
    RecordingFile,
    RecordingState,
    Upload,
)
from elfslam.serve.store.zips import stem_of
from elfslam.serve.texts import as_file_name, as_line

Begin = Callable[[Session], Recording | None]
SCRATCH = "reading-"
"""So begin the names of folders in work/ that recordings are read in."""


class FileBody(BaseModel):
    """One file of a recording's folder."""

    name: str
    size_bytes: int = Field(ge=0, le=2**53)
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


@dataclass(frozen=True)
class ReceivedFile:
    """A file that has come whole."""

    name: str
    path: Path
    blob: Blob


@dataclass(frozen=True)
class PendingRecording:
    """A recording to be kept: its files, and what they hold.

    `begin` gives the row of the recording that still waits for them, or None where none does.
    """

    come: list[ReceivedFile]
    found: ReadFolder
    begin: Begin


def complete(
    services: Services, recording_id: str, files: list[FileBody], *, wants_map: bool
) -> None:
    """Make a recording of its uploads. Raises Problem 409 where something is missing.

    What cannot be read becomes a refused recording. A recording that is complete stays as it is.
    """
    with reading(services.sessions) as session:
        state = session.scalar(select(Recording.state).filter_by(id=recording_id))
        uploads = list(session.scalars(select(Upload).filter_by(recording_id=recording_id)))
    if state != RecordingState.RECEIVING:
        return
    with services.busy.alone([recording_id, *(upload.id for upload in uploads)]):
        come = [_come(services.settings, promised, uploads) for promised in files]
        with scratch(services.settings) as folder:
            for file in come:
                blobs.link_or_copy(file.path, folder / file.name)
            found = read_apart(services.children, folder, services.settings.limits)
        begin = partial(_receiving, recording_id=recording_id)
        keep(services, [PendingRecording(come, found, begin)], wants_map=wants_map)
        for upload in uploads:
            (services.settings.uploads_folder / upload.id).unlink(missing_ok=True)


def _come(settings: ServerSettings, promised: FileBody, uploads: list[Upload]) -> ReceivedFile:
    """A promised file, found among the uploads. Raises Problem 409."""
    named = [upload for upload in uploads if upload.file_name == promised.name]
    sizes = {upload.id: upload_bytes(settings, upload.id) for upload in named}
    whole = [name for name, size in sizes.items() if size == promised.size_bytes]
    if not whole:
        most = max(sizes.values(), default=0)
        raise Problem(
            409, f"{promised.name}: {most} of {promised.size_bytes} bytes have come; send the rest"
        )
    for name in whole:
        path = settings.uploads_folder / name
        blob = blobs.blob_of(path)
        if blob.sha256 == promised.sha256:
            return ReceivedFile(promised.name, path, blob)
    raise Problem(
        409,
        f"{promised.name}: came with SHA-256 {blob.sha256:.12}…, promised {promised.sha256:.12}…; "
        "delete its upload and send it again",
    )


@contextmanager
def scratch(settings: ServerSettings) -> Iterator[Path]:
    """An empty folder that is gone afterwards."""
    folder = settings.work_folder / f"{SCRATCH}{secrets.token_hex(8)}"
    folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def keep(services: Services, parts: Sequence[PendingRecording], *, wants_map: bool) -> None:
    """Keep the files of recordings and say what they are, all in one commit."""
    files = [file for part in parts for file in part.come]
    folder = services.settings.blobs_folder
    try:
        with blobs.locked(folder):
            for file in files:
                blobs.place(folder, file.path, file.blob)
            with transaction(services.sessions) as session:
                for part in parts:
                    _keep_part(session, part, wants_map=wants_map)
    except BaseException:
        drop_unnamed(services, [file.blob.sha256 for file in files])
        raise
    services.jobs_wanted.set()


def _keep_part(session: Session, part: PendingRecording, *, wants_map: bool) -> None:
    recording = part.begin(session)
    if recording is None:
        return
    _describe(session, recording, part.come, part.found)
    if wants_map and not part.found.refusal:
        session.add(map_job(recording))


def _receiving(session: Session, recording_id: str) -> Recording | None:
    """The row of a recording, kept from others until the commit. Raises Problem 404."""
    recording = session.get(Recording, recording_id, with_for_update=True)
    if recording is None:
        raise not_found("recording")
    return recording if recording.state == RecordingState.RECEIVING else None


def _describe(
    session: Session, recording: Recording, come: list[ReceivedFile], found: ReadFolder
) -> None:
    for file in come:
        row = RecordingFile(recording_id=recording.id, name=file.name, **asdict(file.blob))
        session.add(row)
    size_bytes = sum(file.blob.size_bytes for file in come)
    facts: RecordingFacts = {**found.facts, **recording.facts, "bytes": size_bytes}
    facts.pop("name", None)
    facts.pop("device", None)
    recording.facts = facts
    recording.state = RecordingState.REFUSED if found.refusal else RecordingState.READY
    recording.refusal = found.refusal
    session.execute(delete(Upload).filter_by(recording_id=recording.id, finished=False))


def map_job(recording: Recording) -> Job:
    """The job that maps a recording; by motion where it is known that nothing chirped."""
    given: dict[str, Any] = {"recording": recording.id}
    if recording.facts.get("chirps") is False:
        given["by"] = [Modality.MOTION]
    start_pose = recording.facts.get("start_pose")
    if start_pose is not None:
        given["start_pose"] = start_pose
    return Job(user_id=recording.user_id, kind=JobKind.MAP, given=given)


MOST_WALKS = 200
"""In one file."""


async def finish_whole(services: Services, upload: Upload) -> Upload:
    """The upload, now that its recordings were made, ready or refused. Raises Problem 429."""
    return await services.reading.run(upload.user_id, partial(make_recordings, services, upload.id))


def make_recordings(services: Services, upload_id: str) -> Upload:
    """Make the recordings of an upload that has come whole; done already, it stays as it is."""
    upload = _row(services, upload_id)
    if upload.finished:
        return upload
    path = services.settings.uploads_folder / upload_id
    with scratch(services.settings) as folder:
        given, made = folder / "given", folder / "made"
        given.mkdir()
        made.mkdir()
        file = given / _safe_name(upload.file_name)
        blobs.link_or_copy(path, file)
        with reading(services.sessions) as session:
            left = recordings_left(services, session, upload.user_id)
        most = max(1, min(MOST_WALKS, left))  # somebody must be told why one was refused
        walks = walks_apart(services.children, file, made, most, services.settings.limits)
        keep(services, _parts(walks, made, upload_id), wants_map=upload.wants_map)
    path.unlink(missing_ok=True)
    return _row(services, upload_id)


def _safe_name(name: str) -> str:
    """The name of an upload as that of a file: importers call their walks so."""
    stem = as_line(stem_of(name), "walk").replace("/", "_").replace("\\", "_").lstrip(".")
    return f"{as_file_name(stem) or 'walk'}{name[len(stem_of(name)) :].lower()}"


def _parts(walks: Sequence[Walk], made: Path, upload_id: str) -> list[PendingRecording]:
    """What is to be kept: the first recording is the one that the upload knows."""
    parts = []
    for walk in walks:
        files = sorted((made / walk.place).iterdir()) if walk.place else []
        come = [
            ReceivedFile(file.name, file, blobs.blob_of(file)) for file in files if file.is_file()
        ]
        begin = partial(_begin, upload_id=upload_id, found=walk.found, alone=len(walks) == 1)
        parts.append(PendingRecording(come, walk.found, begin))
    return parts


def _row(services: Services, upload_id: str) -> Upload:
    with reading(services.sessions) as session:
        upload = session.get(Upload, upload_id)
    if upload is None:
        raise not_found("upload")
    return upload


def _begin(session: Session, *, upload_id: str, found: ReadFolder, alone: bool) -> Recording:
    """The row of a new recording; the upload belongs to the first. Raises Problem 404."""
    upload = session.get(Upload, upload_id, with_for_update=True)
    if upload is None:
        raise not_found("upload")
    stem = stem_of(upload.file_name)
    is_its_zip = alone and upload.file_name.lower().endswith(".zip")
    recording = Recording(
        user_id=upload.user_id,
        name=as_line(stem if is_its_zip else found.facts.get("name", stem), "walk"),
        device=as_line(found.facts.get("device", ""), "unknown"),
        facts={},
    )
    session.add(recording)
    session.flush()
    if not upload.finished:
        upload.recording_id, upload.finished = recording.id, True
    return recording
