"""What came of a recording or of a map, and goes with it: maps, jobs, fixes, positions.

A map of several recordings stays until the last of them goes. All that works on something that is
deleted loses its claim. Each function gives the SHA-256 of what its rows named, for
`holdings.drop_unnamed` after the commit.
"""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import delete, or_, select
from sqlalchemy.orm import Session

from elfslam.serve.jobs.queue import OPEN
from elfslam.serve.positions.tables import KeptPosition
from elfslam.serve.store.database import Job, JobFile, JobKind, Map, MapFile, MapPart


def forget_recording(session: Session, user_id: str, recording_id: str) -> list[str]:
    """Delete what came of a recording alone."""
    worked_on = select(Job.id).where(
        Job.user_id == user_id, Job.given["recording"].as_string() == recording_id
    )
    named: list[str] = []
    for each in session.scalars(select(Map).where(Map.user_id == user_id)).all():
        if recording_id in each.sources:
            each.sources = [source for source in each.sources if source != recording_id]
            named += [] if each.sources else forget_map(session, user_id, each.id)
    return named + _forget_jobs(session, session.scalars(worked_on).all())


def forget_map(
    session: Session, user_id: str, map_id: str, *, spared_job: str | None = None
) -> list[str]:
    """Delete a map, the job that made it unless that is spared, and where others were in it."""
    concerned = select(Job.id).where(
        Job.user_id == user_id,
        Job.id != (spared_job or ""),
        or_(Job.gave["map"].as_string() == map_id, Job.given["map"].as_string() == map_id),
    )
    merging = select(Job).where(
        Job.user_id == user_id, Job.kind == JobKind.MERGE, Job.state.in_(OPEN)
    )
    merges = [job.id for job in session.scalars(merging) if map_id in job.given["maps"]]
    named = _forget_jobs(session, [*session.scalars(concerned), *merges])
    for table in (MapFile, MapPart):
        named += session.scalars(select(table.sha256).filter_by(map_id=map_id))
    session.execute(delete(KeptPosition).where(KeptPosition.map_id == map_id))
    session.execute(delete(Map).where(Map.id == map_id))
    return named


def forget_given(session: Session, job: Job) -> list[str]:
    """Delete what a job gave, the job itself left as it is."""
    named = list(session.scalars(select(JobFile.sha256).filter_by(job_id=job.id)))
    session.execute(delete(JobFile).where(JobFile.job_id == job.id))
    if "map" in job.gave:
        named += forget_map(session, job.user_id, job.gave["map"], spared_job=job.id)
    return named


def _forget_jobs(session: Session, job_ids: Iterable[str]) -> list[str]:
    ids = list(job_ids)
    named = list(session.scalars(select(JobFile.sha256).where(JobFile.job_id.in_(ids))))
    session.execute(delete(Job).where(Job.id.in_(ids)))
    return named
