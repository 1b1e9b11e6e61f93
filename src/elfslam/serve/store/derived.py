"""What came of recordings or of maps, and goes with them: maps, jobs, fixes, positions.

A map of several recordings stays until the last of them goes. All that works on something that is
deleted loses its claim, whoever's it is: others may work on maps that are shared with them. Each
function gives the SHA-256 of what its rows named, for `holdings.drop_unnamed` after the commit.
"""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import delete, or_, select
from sqlalchemy.orm import Session

from elfslam.serve.jobs.queue import OPEN
from elfslam.serve.positions.tables import KeptPosition
from elfslam.serve.store.database import Job, JobFile, JobKind, Map, MapFile, MapPart

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
        named += forget_maps(session, [job.gave["map"]], spared_job=job.id)
    return named


def _forget_jobs(session: Session, job_ids: Iterable[str]) -> list[str]:
    ids = list(job_ids)
    named = list(session.scalars(select(JobFile.sha256).where(JobFile.job_id.in_(ids))))
    session.execute(delete(Job).where(Job.id.in_(ids)))
    return named
