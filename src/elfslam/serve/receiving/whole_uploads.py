"""Whole recordings as one .zip: unpacked, read and kept when the last byte is in."""

from __future__ import annotations

from functools import partial

from anyio import to_thread
from sqlalchemy.orm import Session

from elfslam.serve.people.access import not_found
from elfslam.serve.receiving.completing import Come, keep, scratch
from elfslam.serve.receiving.reading import ReadFolder, read_apart
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Recording, Upload, reading
from elfslam.serve.texts import as_line


async def finish_whole(services: Services, upload_id: str) -> Upload:
    """The upload, now that its recording was made, ready or refused."""
    return await to_thread.run_sync(make_recording, services, upload_id, limiter=services.readers)


def make_recording(services: Services, upload_id: str) -> Upload:
    """Make the recording of an upload that has come whole; done already, it stays as it is."""
    upload = _row(services, upload_id)
    if upload.finished:
        return upload
    path = services.settings.uploads_folder / upload_id
    with scratch(services.settings) as folder:
        found = read_apart(folder, services.settings.limits, path)
        files = [file for file in sorted(folder.iterdir()) if file.is_file()]
        come = [Come(file.name, file, blobs.blob_of(file)) for file in files]
        begin = partial(_begin, upload_id=upload_id, found=found)
        keep(services, come, found, begin, wants_map=upload.wants_map)
    path.unlink(missing_ok=True)
    return _row(services, upload_id)


def _row(services: Services, upload_id: str) -> Upload:
    with reading(services.sessions) as session:
        upload = session.get(Upload, upload_id)
    if upload is None:
        raise not_found("upload")
    return upload


def _begin(session: Session, *, upload_id: str, found: ReadFolder) -> Recording:
    """The row of a new recording, to which the upload belongs from now on. Raises Problem 404."""
    upload = session.get(Upload, upload_id, with_for_update=True)
    if upload is None:
        raise not_found("upload")
    stem = upload.file_name.rpartition(".")[0]
    recording = Recording(
        user_id=upload.user_id,
        name=as_line(stem, "walk"),
        device=as_line(found.facts.get("device", ""), "unknown"),
        facts={},
    )
    session.add(recording)
    session.flush()
    upload.recording_id, upload.finished = recording.id, True
    return recording
