"""What users hold: how much it is, and how it is deleted so that nothing is left.

What came of recordings or of maps goes with them: maps, jobs, fixes, positions. A map of several
recordings stays until the last of them goes. All that works on something that is deleted loses its
claim, whoever's it is: others may work on maps that are shared with them. The functions that forget
give the SHA-256 of what their rows named, for `drop_unnamed` after the commit.
"""

from collections.abc import Iterable

from sqlalchemy import delete, func, or_, select
from sqlalchemy.orm import Session

from elfslam.serve.jobs.queue import OPEN
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.database import count_rows, reading, transaction
from elfslam.serve.store.tables import (
    Job,
    JobFile,
    JobKind,
    KeptPosition,
    Map,
    MapFile,
    MapPart,
    Recording,
    RecordingFile,
    Upload,
    User,
)

NAMERS = (RecordingFile, MapFile, MapPart, JobFile)
"""The tables whose rows name blobs."""


def upload_bytes(settings: ServerSettings, upload_id: str) -> int:
    """How much of an upload has come."""
    try:
        return (settings.uploads_folder / upload_id).stat().st_size
    except FileNotFoundError:
        return 0


def used_bytes(services: Services, session: Session, user_id: str) -> int:
    """What lies here of a user: recordings, maps, what jobs made, and what is on its way."""
    kept = 0
    for table, of in ((RecordingFile, Recording), (MapFile, Map), (MapPart, Map), (JobFile, Job)):
        mine = select(func.sum(table.size_bytes)).join(of).where(of.user_id == user_id)
        kept += int(session.scalar(mine) or 0)
    uploads = session.scalars(select(Upload.id).filter_by(user_id=user_id))
    return kept + sum(upload_bytes(services.settings, name) for name in uploads)


def recordings_left(services: Services, session: Session, user_id: str) -> int:
    """How many recordings a user may still have."""
    most = services.settings.limits.recordings
    return most - count_rows(session, Recording, Recording.user_id == user_id)


def refuse_more_recordings(services: Services, session: Session, user_id: str) -> None:
    """Raise Problem 409 where a user has as many as they may."""
    if recordings_left(services, session, user_id) <= 0:
        most = services.settings.limits.recordings
        raise Problem(409, f"you have {most} recordings; delete one first")


def drop_unnamed(services: Services, sha256s: Iterable[str]) -> None:
    """Delete those blobs that no row names any more; call it after the commit."""
    folder = services.settings.blobs_folder
    with blobs.locked(folder), reading(services.sessions) as session:
        blobs.delete(folder, [name for name in set(sha256s) if not is_named(session, name)])


def is_named(session: Session, sha256: str) -> bool:
    """Whether a row names a blob."""
    return any(
        session.scalar(select(table.sha256).filter_by(sha256=sha256).limit(1)) for table in NAMERS
    )


def named_blobs(session: Session) -> set[str]:
    """Every blob that a row names."""
    return {sha256 for table in NAMERS for sha256 in session.scalars(select(table.sha256))}


def delete_recordings(services: Services, user_id: str, recording_ids: Iterable[str]) -> int:
    """Delete recordings of a user with all that came of them alone; how many there were."""
    wanted = set(recording_ids)
    with transaction(services.sessions) as session:
        mine = select(Recording.id).where(Recording.user_id == user_id, Recording.id.in_(wanted))
        ids = list(session.scalars(mine))
        named = forget_recordings(session, user_id, ids)
        files = select(RecordingFile.sha256).where(RecordingFile.recording_id.in_(ids))
        named += session.scalars(files)
        uploads = list(session.scalars(select(Upload.id).where(Upload.recording_id.in_(ids))))
        session.execute(delete(Recording).where(Recording.id.in_(ids)))
    _clear(services, uploads, named)
    return len(ids)


def delete_user(services: Services, user_id: str) -> None:
    """Delete a user and all that is theirs, and what others were doing with their maps."""
    with transaction(services.sessions) as session:
        named = forget_maps(session, session.scalars(select(Map.id).filter_by(user_id=user_id)))
        of_recordings = select(RecordingFile.sha256).join(Recording).filter_by(user_id=user_id)
        of_jobs = select(JobFile.sha256).join(Job).filter_by(user_id=user_id)
        for table in (of_recordings, of_jobs):
            named += session.scalars(table)
        uploads = list(session.scalars(select(Upload.id).filter_by(user_id=user_id)))
        session.execute(delete(User).where(User.id == user_id))
    services.positions.forget(user_id)
    _clear(services, uploads, named)


def _clear(services: Services, uploads: Iterable[str], named: Iterable[str]) -> None:
    for name in uploads:
        (services.settings.uploads_folder / name).unlink(missing_ok=True)
    drop_unnamed(services, named)


AT_ONCE = 1000
"""A statement names no more maps than databases take."""


def forget_recordings(session: Session, user_id: str, recording_ids: Iterable[str]) -> list[str]:
    """Delete what came of some recordings alone."""
    gone, orphans = set(recording_ids), []
    worked_on = select(Job.id).where(
        Job.user_id == user_id, Job.given["recording"].as_string().in_(gone)
    )
    for each in session.scalars(select(Map).where(Map.user_id == user_id)).all():
        if gone & set(each.sources):
            each.sources = [source for source in each.sources if source not in gone]
            orphans += [] if each.sources else [each.id]
    return forget_maps(session, orphans) + _forget_jobs(session, session.scalars(worked_on).all())


def forget_maps(
    session: Session, map_ids: Iterable[str], *, spared_job: str | None = None
) -> list[str]:
    """Delete maps, the jobs that made them unless one is spared, and where others were in them."""
    ids, named = list(map_ids), []
    for begin in range(0, len(ids), AT_ONCE):
        named += _forget_some(session, set(ids[begin : begin + AT_ONCE]), spared_job or "")
    return named


def _forget_some(session: Session, gone: set[str], spared_job: str) -> list[str]:
    concerned = select(Job.id).where(
        Job.id != spared_job,
        or_(Job.gave["map"].as_string().in_(gone), Job.given["map"].as_string().in_(gone)),
    )
    merging = select(Job).where(Job.kind == JobKind.MERGE, Job.state.in_(OPEN))
    merges = [job.id for job in session.scalars(merging) if gone & set(job.given["maps"])]
    named = _forget_jobs(session, [*session.scalars(concerned), *merges])
    for table in (MapFile, MapPart):
        named += session.scalars(select(table.sha256).where(table.map_id.in_(gone)))
    session.execute(delete(KeptPosition).where(KeptPosition.map_id.in_(gone)))
    session.execute(delete(Map).where(Map.id.in_(gone)))
    return named


def forget_given(session: Session, job: Job) -> list[str]:
    """Delete what a job gave, the job itself left as it is."""
    named = list(session.scalars(select(JobFile.sha256).filter_by(job_id=job.id)))
    session.execute(delete(JobFile).where(JobFile.job_id == job.id))
    if "map" in job.gave:
        named += forget_maps(
            session, [job.gave["map"], *job.gave.get("floors", [])], spared_job=job.id
        )
    return named


def _forget_jobs(session: Session, job_ids: Iterable[str]) -> list[str]:
    ids = list(job_ids)
    named = list(session.scalars(select(JobFile.sha256).where(JobFile.job_id.in_(ids))))
    session.execute(delete(Job).where(Job.id.in_(ids)))
    return named
