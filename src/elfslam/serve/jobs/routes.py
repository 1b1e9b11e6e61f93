"""Routes of jobs: what is to be done in the background, how far it is, and what came of it."""

import math
from datetime import datetime
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Body
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field, field_validator, model_validator
from sqlalchemy import select
from sqlalchemy.orm import Session

from elfslam.base.enums import LONGEST_S, Modality, Mode, parse_stretch, refusal_of
from elfslam.base.errors import ParameterError
from elfslam.serve.jobs import queue as jobs
from elfslam.serve.jobs.executors import FIXES
from elfslam.serve.people.access import Me, known_id, own
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.sharing.rights import Principal, Right, map_for
from elfslam.serve.store.database import count_rows, reading, transaction
from elfslam.serve.store.quota import drop_unnamed, forget_given, used_bytes
from elfslam.serve.store.sending import sent_blob
from elfslam.serve.store.tables import (
    Job,
    JobFile,
    JobKind,
    JobState,
    Recording,
    RecordingState,
    User,
)
from elfslam.serve.texts import Id, Line, StartPose

router = APIRouter(tags=["jobs"])
MOST_MAPS = 100
Seconds = Annotated[float, Field(ge=0, le=LONGEST_S, allow_inf_nan=False)]


class MapWanted(BaseModel):
    """Make a map of a recording; `by` nothing means by echoes where there is sound.

    Only what lies between `from_s` and `until_s` is mapped, where they are given.
    """

    kind: Literal["map"]
    recording: Id
    by: list[Modality] = Field(default_factory=list, max_length=len(Modality))
    start_pose: StartPose | None = None
    from_s: Seconds | None = None
    until_s: Seconds | None = None

    @field_validator("by")
    @classmethod
    def _known_together(cls, by: list[Modality]) -> list[Modality]:
        if refusal := refusal_of(by):
            raise ValueError(refusal)
        return by

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        try:
            parse_stretch(self.from_s, self.until_s)
        except ParameterError as error:
            raise ValueError(str(error).replace("--", "")) from error
        return self


class MergeWanted(BaseModel):
    """Make one floor map of several runs, or of a floor map and runs, all of which you may edit."""

    kind: Literal["merge"]
    maps: list[Id] = Field(min_length=2, max_length=MOST_MAPS)
    name: Line | None = None


class LocateWanted(BaseModel):
    """Say where a recording was in a map."""

    kind: Literal["locate"]
    recording: Id
    map: Id
    mode: Mode = Mode.ONE_SHOT


Wanted = Annotated[MapWanted | MergeWanted | LocateWanted, Body(discriminator="kind")]


class JobBody(BaseModel):
    """A job, and how far it is."""

    id: str
    kind: JobKind
    state: JobState
    given: dict[str, Any]
    gave: dict[str, Any]
    doing: str
    share: float | None
    attempts: int
    problem: str | None
    created_utc: datetime
    started_utc: datetime | None
    finished_utc: datetime | None


@router.post("/jobs", status_code=202, operation_id="queue_job", responses=problems(409, 507))
def queue_job(wanted: Wanted, user: Me, services: ServicesDep) -> JobBody:
    """Queue a job: map a recording, merge maps, or locate a recording in a map."""
    with transaction(services.sessions) as session:
        _check_given(session, user, wanted)
        refuse_too_many(services, session, user)
        given = wanted.model_dump(mode="json", exclude={"kind"})
        job = jobs.queue_job(session, user.id, JobKind(wanted.kind), given)
    services.jobs_wanted.set()
    return body_of(job)


@router.get("/jobs", operation_id="list_jobs")
def list_jobs(
    user: Me, services: ServicesDep, recording: str | None = None, state: JobState | None = None
) -> list[JobBody]:
    """Your jobs, the newest first; those of one recording, or in one state."""
    found = select(Job).where(Job.user_id == user.id)
    if recording is not None:
        found = found.where(Job.given["recording"].as_string() == known_id(recording, "recording"))
    if state is not None:
        found = found.where(Job.state == state)
    with reading(services.sessions) as session:
        rows = session.scalars(found.order_by(Job.created_utc.desc(), Job.id))
        return [body_of(job) for job in rows]


@router.get("/jobs/{job_id}", operation_id="get_job")
def get_job(job_id: str, user: Me, services: ServicesDep) -> JobBody:
    """One of your jobs."""
    with reading(services.sessions) as session:
        return body_of(_mine(session, user, job_id))


@router.post("/jobs/{job_id}/cancel", operation_id="cancel_job", responses=problems(409))
def cancel_job(job_id: str, user: Me, services: ServicesDep) -> JobBody:
    """Stop a job that waits or runs; nothing of it is left."""
    with transaction(services.sessions) as session:
        job = _mine(session, user, job_id)
        if not jobs.cancel(session, job.id):
            raise Problem(409, f"the job has {job.state} already and cannot be cancelled")
        session.refresh(job)
        return body_of(job)


@router.post("/jobs/{job_id}/retry", operation_id="retry_job", responses=problems(409))
def retry_job(job_id: str, user: Me, services: ServicesDep) -> JobBody:
    """Queue a job again that failed or was cancelled; what it left is deleted."""
    with transaction(services.sessions) as session:
        job = _mine(session, user, job_id)
        refuse_too_many(services, session, user)
        named = forget_given(session, job) if job.state == JobState.FAILED else []
        if not jobs.retry(session, job.id):
            raise Problem(
                409, f"the job is {job.state}; only what failed or was cancelled is retried"
            )
        session.refresh(job)
        answer = body_of(job)
    drop_unnamed(services, named)
    services.jobs_wanted.set()
    return answer


@router.get(
    "/jobs/{job_id}/fixes.csv",
    operation_id="get_fixes",
    response_class=FileResponse,
    responses={200: {"content": {"text/csv": {}}}},
)
def get_fixes(job_id: str, user: Me, services: ServicesDep) -> FileResponse:
    """Where a recording was, as `elfslam locate` writes it."""
    with reading(services.sessions) as session:
        _mine(session, user, job_id)
        file = session.get(JobFile, (job_id, FIXES))
    if file is None:
        raise Problem(404, "this job gave no fixes; wait for it, or look at its problem")
    return sent_blob(services.settings, file.sha256, "fix", "text/csv", filename=FIXES)


def body_of(job: Job) -> JobBody:
    """A job as the API tells it."""
    return JobBody.model_validate(job, from_attributes=True)


def refuse_too_many(services: Services, session: Session, user: User) -> None:
    """Raise Problem 429 or 413 where a user may not queue another job."""
    limits = services.settings.limits
    if count_rows(session, Job, Job.user_id == user.id, Job.state.in_(jobs.OPEN)) >= limits.jobs:
        raise Problem(
            429, f"{limits.jobs} jobs wait already; let some end first", {"Retry-After": "60"}
        )
    refuse_full(services, session, user.id)


def refuse_full(services: Services, session: Session, user_id: str) -> None:
    """Raise Problem 413 where a user may keep nothing more here."""
    limits = services.settings.limits
    if used_bytes(services, session, user_id) >= limits.user_bytes:
        full = math.floor(limits.user_bytes / 2**30)
        raise Problem(413, f"the {full} GiB of a user are full; delete something first")


def _check_given(
    session: Session, user: User, wanted: MapWanted | MergeWanted | LocateWanted
) -> None:
    """Refuse what is not there, not yours and not shared with you, or not ready."""
    asker = Principal(user.id)
    if isinstance(wanted, MergeWanted):
        if len(set(wanted.maps)) < len(wanted.maps):
            raise Problem(422, "maps: one is named twice; name each map once")
        for map_id in wanted.maps:
            map_for(session, asker, map_id, Right.EDIT)
        return
    recording = own(session, Recording, wanted.recording, user, "recording")
    if recording.state != RecordingState.READY:
        raise Problem(409, f"the recording is {recording.state}; it must be ready first")
    if isinstance(wanted, LocateWanted):
        map_for(session, asker, wanted.map)


def _mine(session: Session, user: User, job_id: str) -> Job:
    return own(session, Job, job_id, user, "job")
