"""Whole recordings and other programs' logs: read and kept when the last byte is in."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from sqlalchemy.orm import Session

from elfslam.serve.people.access import not_found
from elfslam.serve.receiving.completing import PendingRecording, ReceivedFile, keep, scratch
from elfslam.serve.receiving.reading import ReadFolder, Walk, walks_apart
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Recording, Upload, reading
from elfslam.serve.store.folder_files import stem_of
from elfslam.serve.store.quota import recordings_left
from elfslam.serve.texts import as_line

MOST_WALKS = 200
"""In one file."""
MOST_NAME = 60
"""Characters; file systems count bytes, and take 255."""


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
        most = _most_walks(services, upload.user_id)
        walks = walks_apart(services.children, file, made, most, services.settings.limits)
        keep(services, _parts(walks, made, upload_id), wants_map=upload.wants_map)
    path.unlink(missing_ok=True)
    return _row(services, upload_id)


def _safe_name(name: str) -> str:
    """The name of an upload as that of a file: importers call their walks so."""
    stem = as_line(stem_of(name), "walk").replace("/", "_").replace("\\", "_").lstrip(".")
    return f"{stem[:MOST_NAME] or 'walk'}{name[len(stem_of(name)) :].lower()}"


def _most_walks(services: Services, user_id: str) -> int:
    """One at least: somebody must be told why it was refused."""
    with reading(services.sessions) as session:
        return max(1, min(MOST_WALKS, recordings_left(services, session, user_id)))


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
