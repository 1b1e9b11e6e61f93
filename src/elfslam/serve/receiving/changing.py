"""Routes that change recordings: a new name, and many deleted at once."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel

from elfslam.serve.people.access import Me
from elfslam.serve.receiving.recordings import RecordingBody, body_of, my_recording
from elfslam.serve.services import ServicesDep
from elfslam.serve.store.database import transaction
from elfslam.serve.store.quota import delete_recordings
from elfslam.serve.texts import Deleted, Line, Many

router = APIRouter(prefix="/recordings", tags=["recordings"])


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
