"""The queue: who may change what state into what, and that nobody works twice on one job."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.serve.jobs import queue as jobs
from elfslam.serve.jobs.executors import Progress
from elfslam.serve.store.database import Sessions, open_database, reading, sessions_of, transaction
from elfslam.serve.store.schema import upgrade
from elfslam.serve.store.tables import Job, JobKind, JobState, User
from tests.serve.conftest import DATABASES

pytestmark = DATABASES
CLAIM_ALL = """
import sys
from elfslam.serve.store.database import open_database, sessions_of
from elfslam.serve.jobs.queue import claim
sessions = sessions_of(open_database(sys.argv[1]))
print("ready", flush=True)
sys.stdin.readline()
while (held := claim(sessions)) is not None:
    print(held.job_id)
"""


@pytest.fixture
def url(database_url: str, tmp_path: Path) -> str:
    """An empty database of either kind."""
    return database_url or f"sqlite:///{tmp_path / 'elfslam.sqlite'}"


@pytest.fixture
def sessions(url: str, tmp_path: Path) -> Iterator[Sessions]:
    """Makes sessions of that database."""
    engine = open_database(url)
    upgrade(engine, tmp_path / "backups")
    yield sessions_of(engine)
    engine.dispose()


def queued(sessions: Sessions, count: int, name: str = "walker") -> list[str]:
    with transaction(sessions) as session:
        user = User(name=name, token_sha256=name)
        session.add(user)
        session.flush()
        made = [jobs.queue_job(session, user.id, JobKind.MAP, {"n": n}) for n in range(count)]
        return [job.id for job in made]


def state_of(sessions: Sessions, job_id: str) -> Job:
    with reading(sessions) as session:
        return session.get_one(Job, job_id)


def claimed(sessions: Sessions) -> jobs.Claim:
    held = jobs.claim(sessions)
    assert held is not None
    return held


def ended(sessions: Sessions, held: jobs.Claim, problem: str | None = None) -> bool:
    with transaction(sessions) as session:
        return jobs.finish(session, held, {}, problem)


def test_jobs_are_claimed_once_each_and_the_oldest_first(sessions: Sessions) -> None:
    wanted = queued(sessions, 3)
    assert [claimed(sessions).job_id for _ in wanted] == wanted
    assert jobs.claim(sessions) is None
    job = state_of(sessions, wanted[0])
    assert (job.state, job.attempts) == (JobState.RUNNING, 1)
    assert job.started_utc is not None


def test_users_take_turns(sessions: Sessions) -> None:
    mine, theirs = queued(sessions, 3), queued(sessions, 2, "somebody else")
    order = [claimed(sessions).job_id for _ in (*mine, *theirs)]
    assert order == [mine[0], theirs[0], mine[1], theirs[1], mine[2]]


def test_processes_and_threads_that_claim_at_once_never_share_a_job(
    url: str, sessions: Sessions
) -> None:
    wanted = queued(sessions, 60)
    command = [sys.executable, "-c", CLAIM_ALL, url]
    others = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    mine: list[str] = []

    def claim_all() -> None:
        while (held := jobs.claim(sessions)) is not None:
            mine.append(held.job_id)

    threads = [threading.Thread(target=claim_all) for _ in range(2)]
    for process in others:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in others:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    for thread in threads:
        thread.start()
    theirs = [process.communicate()[0].split() for process in others]
    for thread in threads:
        thread.join()
    assert sorted([*mine, *theirs[0], *theirs[1]]) == sorted(wanted)


def test_a_cancelled_job_hears_nothing_more(sessions: Sessions) -> None:
    [job_id] = queued(sessions, 1)
    held = claimed(sessions)
    assert jobs.tell(sessions, held, Progress("echoes", 0.1))
    with transaction(sessions) as session:
        assert jobs.cancel(session, job_id)
        assert jobs.cancel(session, job_id)
    assert not jobs.holds(sessions, held)
    assert not jobs.tell(sessions, held, Progress("graph", 0.9))
    assert not ended(sessions, held)
    assert not jobs.give_back(sessions, held)
    job = state_of(sessions, job_id)
    assert (job.state, job.doing, job.share) == (JobState.CANCELLED, "", None)


def test_whoever_lost_a_job_cannot_end_it_for_the_next(sessions: Sessions) -> None:
    [job_id] = queued(sessions, 1)
    first = claimed(sessions)
    with transaction(sessions) as session:
        jobs.cancel(session, job_id)
        assert jobs.retry(session, job_id)
    second = claimed(sessions)
    assert not ended(sessions, first)
    assert jobs.holds(sessions, second)
    assert ended(sessions, second)
    assert state_of(sessions, job_id).state == JobState.DONE


def test_what_is_done_is_neither_cancelled_nor_retried(sessions: Sessions) -> None:
    [job_id] = queued(sessions, 1)
    assert ended(sessions, claimed(sessions))
    with transaction(sessions) as session:
        assert not jobs.cancel(session, job_id)
        assert not jobs.retry(session, job_id)


def test_a_failed_job_is_retried_as_if_new(sessions: Sessions) -> None:
    [job_id] = queued(sessions, 1)
    assert ended(sessions, claimed(sessions), "no loop")
    assert state_of(sessions, job_id).problem == "no loop"
    with transaction(sessions) as session:
        assert jobs.retry(session, job_id)
    job = state_of(sessions, job_id)
    assert (job.state, job.problem, job.attempts) == (JobState.QUEUED, None, 0)


def test_a_job_that_was_given_back_did_not_cost_an_attempt(sessions: Sessions) -> None:
    [job_id] = queued(sessions, 1)
    assert jobs.give_back(sessions, claimed(sessions))
    job = state_of(sessions, job_id)
    assert (job.state, job.attempts) == (JobState.QUEUED, 0)


def test_a_job_that_servers_died_over_waits_for_the_others_but_not_for_ever(
    sessions: Sessions,
) -> None:
    first, second = queued(sessions, 2)
    for attempt in (1, 2, 3):
        held = claimed(sessions)
        assert (held.job_id, held.attempt) == (first, attempt)
        assert jobs.queue_interrupted(sessions) == 1
    job = state_of(sessions, first)
    assert (job.state, job.claim, job.problem) == (JobState.QUEUED, None, None)
    just_up = jobs.claim(sessions, jobs.begun_at_most(0.0))
    assert just_up is not None
    assert just_up.job_id == second
    assert jobs.claim(sessions, jobs.begun_at_most(jobs.PAUSE_S - 1)) is None
    in_time = jobs.claim(sessions, jobs.begun_at_most(jobs.PAUSE_S))
    assert in_time is not None
    assert in_time.job_id == first


def test_however_often_a_job_was_begun_its_turn_comes(sessions: Sessions) -> None:
    [job_id] = queued(sessions, 1)
    for _ in range(50):
        claimed(sessions)
        jobs.queue_interrupted(sessions)
    held = jobs.claim(sessions, jobs.begun_at_most(jobs.LONGEST_PAUSE_S))
    assert held is not None
    assert (held.job_id, held.attempt) == (job_id, 51)
