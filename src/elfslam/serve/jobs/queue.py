"""The queue of jobs: what may become of which state, each change one compare-and-set.

    queued -> running -> done | failed | cancelled      failed, cancelled -> queued (retry)

Whoever runs a job holds a `Claim`; whatever is told with a claim that was lost (to a cancel, a
deletion or another runner) changes nothing and says so.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import CursorResult, Select, and_, func, select, update
from sqlalchemy.orm import Session, aliased

from elfslam.serve.store.database import Sessions, reading, transaction
from elfslam.serve.store.tables import Job, JobKind, JobState, new_id, now_utc

if TYPE_CHECKING:
    from elfslam.serve.jobs.executors import Progress

AT_ONCE, PAUSE_S, LONGEST_PAUSE_S = 2, 10.0, 60.0
"""Begun more often than `AT_ONCE` and never ended: a job may be what kills the server. It waits
another pause for each time, so that the others are done first, but never for good."""
NO_LIMIT = 2**31 - 1
OPEN = (JobState.QUEUED, JobState.RUNNING)


@dataclass(frozen=True)
class Claim:
    """The right to work on a job, until somebody cancels it."""

    job_id: str
    token: str
    user_id: str
    kind: JobKind
    given: dict[str, Any]
    attempt: int
    """How often it was begun, this time among them."""


def queue_job(session: Session, user_id: str, kind: JobKind, given: dict[str, Any]) -> Job:
    """A new job, which a runner will find."""
    job = Job(id=new_id(), user_id=user_id, kind=kind, given=given, created_utc=now_utc())
    session.add(job)
    session.flush()
    return job


def begun_at_most(up_s: float) -> int:
    """How often a job may have been begun that a server begins which has run for so long."""
    return NO_LIMIT if up_s >= LONGEST_PAUSE_S else AT_ONCE + int(up_s / PAUSE_S)


def claim(sessions: Sessions, most_begun: int = NO_LIMIT) -> Claim | None:
    """The next job that was not begun more often, claimed for the caller alone; or nothing."""
    while True:
        with reading(sessions) as session:
            job = session.scalar(_next(most_begun))
        if job is None:
            return None
        token = new_id()
        begins = {
            "state": JobState.RUNNING,
            "claim": token,
            "attempts": Job.attempts + 1,
            "doing": "starting",
            "started_utc": now_utc(),
        }
        with transaction(sessions) as session:
            if _set(session, (Job.id == job.id, Job.state == JobState.QUEUED), begins):
                kind, attempt = JobKind(job.kind), job.attempts + 1
                return Claim(job.id, token, job.user_id, kind, job.given, attempt)


def _next(most_begun: int) -> Select[Job]:
    """The oldest job of the user none of whose jobs began for the longest time."""
    waits, other = and_(Job.state == JobState.QUEUED, Job.attempts <= most_begun), aliased(Job)
    oldest = func.min(Job.created_utc).label("oldest")
    users = select(Job.user_id, oldest).where(waits).group_by(Job.user_id).subquery()
    begun = select(func.max(other.started_utc)).where(other.user_id == users.c.user_id)
    last = begun.correlate(users).scalar_subquery()
    turns = select(users.c.user_id).order_by(last.is_not(None), last, users.c.oldest)
    turn = turns.limit(1).scalar_subquery()
    mine = select(Job).where(waits, Job.user_id == turn)
    return mine.order_by(Job.created_utc, Job.id).limit(1)


def tell(sessions: Sessions, held: Claim, progress: Progress) -> bool:
    """Say how far the work is; whether the claim still holds."""
    with transaction(sessions) as session:
        return _set(session, _held(held), asdict(progress))


def holds(sessions: Sessions, held: Claim) -> bool:
    """Whether the claim still holds."""
    with reading(sessions) as session:
        return session.scalar(select(Job.id).where(*_held(held))) is not None


def finish(session: Session, held: Claim, gave: dict[str, Any], problem: str | None = None) -> bool:
    """End a job, done or with the problem that stopped it; whether the claim still held.

    What the job gave is to be stored in the same transaction, after this.
    """
    end = {
        "state": JobState.DONE if problem is None else JobState.FAILED,
        "share": 1.0 if problem is None else None,
        "gave": gave,
        "problem": problem,
        **_ended(),
    }
    return _set(session, _held(held), end)


def give_back(sessions: Sessions, held: Claim) -> bool:
    """Queue a job again that was not at fault; whether the claim still held."""
    return _again(sessions, held, {"attempts": Job.attempts - 1})


def begin_again(sessions: Sessions, held: Claim) -> bool:
    """Queue a job again that may have been at fault; whether the claim still held."""
    return _again(sessions, held, {})


def _again(sessions: Sessions, held: Claim, besides: dict[str, Any]) -> bool:
    with transaction(sessions) as session:
        return _set(session, _held(held), {**_waiting(), **besides})


def cancel(session: Session, job_id: str) -> bool:
    """Cancel a job that waits or runs; whether it did either, or was cancelled before."""
    ended = {"state": JobState.CANCELLED, "share": None, **_ended()}
    done = _set(session, (Job.id == job_id, Job.state.in_(OPEN)), ended)
    return done or session.scalar(select(Job.state).where(Job.id == job_id)) == JobState.CANCELLED


def retry(session: Session, job_id: str) -> bool:
    """Queue a job again that failed or was cancelled; whether it was either.

    What it gave before is the caller's to delete, in the same transaction.
    """
    again = {**_waiting(), "attempts": 0, "gave": {}, "problem": None, "finished_utc": None}
    ended = Job.state.in_((JobState.FAILED, JobState.CANCELLED))
    return _set(session, (Job.id == job_id, ended), again)


def queue_interrupted(sessions: Sessions) -> int:
    """Queue again what ran when the server died; how many jobs that were.

    Only to be called where nobody can be running any job of this database.
    """
    running = Job.state == JobState.RUNNING
    with transaction(sessions) as session:
        return _count(session.execute(update(Job).where(running).values(_waiting())))


def _held(held: Claim) -> tuple[Any, ...]:
    return Job.id == held.job_id, Job.claim == held.token, Job.state == JobState.RUNNING


def _waiting() -> dict[str, Any]:
    return {"state": JobState.QUEUED, "claim": None, "doing": "", "share": None}


def _ended() -> dict[str, Any]:
    return {"claim": None, "doing": "", "finished_utc": now_utc()}


def _set(session: Session, where: tuple[Any, ...], values: dict[str, Any]) -> bool:
    statement = update(Job).where(*where).values(values)
    changed = session.execute(statement.execution_options(synchronize_session=False))
    return _count(changed) == 1


def _count(result: Any) -> int:
    assert isinstance(result, CursorResult)
    return int(result.rowcount)
