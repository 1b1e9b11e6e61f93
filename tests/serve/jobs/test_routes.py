"""Jobs over HTTP: what may be asked for, by whom, and what goes with what is deleted."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import func, select

from elfslam.serve.jobs import queue as jobs
from elfslam.serve.jobs.executors import Result
from elfslam.serve.jobs.runner import keep
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits, ServerSettings
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Base, Job, Recording, new_id
from tests.serve.conftest import DATABASES, Json, Somebody, allow

pytestmark = DATABASES
FACTS: Json = {"counts": {"OK": 1}}


@pytest.fixture
def settings(tmp_path: Path, database_url: str) -> ServerSettings:
    """A server that queues jobs and works on none."""
    limits = replace(Limits(), jobs=5)
    return ServerSettings(
        tmp_path / "data", database_url, limits, secure_cookie=False, run_jobs=False
    )


@pytest.fixture
def work(services: Services, tmp_path: Path) -> Callable[[str | None], Json]:
    """Claims the oldest job and ends it as its process would, with a small file or two."""

    def worked(problem: str | None = None) -> Json:
        held = jobs.claim(services.sessions)
        assert held is not None
        out = tmp_path / held.token / "out"
        (out / "trajectories").mkdir(parents=True)
        (out / "fixes.csv").write_text(f"fixes of {held.job_id}\n")
        (out / "trajectories" / "one.tum").write_text(f"trajectory of {held.job_id}\n")
        assert keep(services, held, out.parent, Result(FACTS, problem))
        with reading(services.sessions) as session:
            job = session.get_one(Job, held.job_id)
            return {"id": job.id, "state": job.state, **job.gave}

    return worked


Work = Callable[..., Json]


def ask(client: Somebody, **given: object) -> Json:
    answer = client.post("/api/jobs", json=given)
    assert answer.status_code == 202, answer.text
    return dict(answer.json())


def refused(client: Somebody, status: int, **given: object) -> str:
    answer = client.post("/api/jobs", json=given)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    return str(answer.json()["detail"])


def mapped(client: Somebody, work: Work, name: str = "mute") -> tuple[str, str]:
    """The ids of a recording and of its map."""
    recording = client.remember(name)
    ask(client, kind="map", recording=recording)
    return recording, work()["map"]


def left(client: Somebody) -> tuple[int, int]:
    """How many rows, but for those of users, and files a server has."""
    tables = [each for each in Base.metadata.sorted_tables if each.name != "users"]
    with reading(client.services.sessions) as session:
        rows = sum(session.scalar(select(func.count()).select_from(each)) or 0 for each in tables)
    return rows, len(list(client.services.settings.blobs_folder.glob("*/*")))


def test_a_job_is_told_as_it_was_asked_for(owner: Somebody) -> None:
    recording = owner.remember("mute")
    job = ask(owner, kind="map", recording=recording, by=["elf", "wifi"], start_pose=[1, 2, 0.5])
    assert job["given"] == {
        "recording": recording, "by": ["elf", "wifi"], "start_pose": [1.0, 2.0, 0.5],
        "from_s": None, "until_s": None,
    }  # fmt: skip
    assert (job["state"], job["attempts"], job["share"], job["gave"]) == ("queued", 0, None, {})
    assert job["created_utc"].endswith(("Z", "+00:00"))
    assert owner.get(f"/api/jobs/{job['id']}").json() == job
    assert owner.get("/api/jobs", params={"recording": recording}).json() == [job]
    assert owner.get("/api/jobs", params={"recording": new_id()}).json() == []
    assert owner.get("/api/jobs", params={"state": "queued"}).json() == [job]
    assert owner.get("/api/jobs", params={"state": "done"}).json() == []
    assert owner.get("/api/jobs", params={"state": "lost"}).status_code == 422


def test_what_a_map_lacks_is_told_with_its_job(owner: Somebody, tmp_path: Path) -> None:
    recording = owner.remember("mute")
    job = ask(owner, kind="map", recording=recording, from_s=2.5)
    held = jobs.claim(owner.services.sessions)
    assert held is not None
    assert held.given["from_s"] == 2.5
    (tmp_path / "job" / "out").mkdir(parents=True)
    missing = [{"what": "motion", "from_s": 4.0, "until_s": 7.0}]
    facts = {"missing": missing, "kept_s": [2.5, 1e6]}
    assert keep(owner.services, held, tmp_path / "job", Result(facts, None))
    told = owner.get(f"/api/jobs/{job['id']}").json()
    assert told["gave"]["missing"] == missing
    assert owner.get(f"/api/maps/{told['gave']['map']}").json()["facts"] == facts


def test_what_cannot_be_done_is_refused_in_a_line(owner: Somebody, work: Work) -> None:
    recording, made = mapped(owner, work)
    assert "recording" in refused(owner, 404, kind="map", recording=new_id())
    assert "no such map" in refused(owner, 404, kind="locate", recording=recording, map=new_id())
    assert "no such map" in refused(owner, 404, kind="merge", maps=[made, new_id()])
    assert "twice" in refused(owner, 422, kind="merge", maps=[made, made])
    refused(owner, 422, kind="merge", maps=[made])
    refused(owner, 422, kind="paint", recording=recording)
    refused(owner, 422, kind="map", recording="../../etc/passwd")
    refused(owner, 422, kind="map", recording=recording, by=["smell"])
    assert "once" in refused(owner, 422, kind="map", recording=recording, by=["elf", "elf"])
    assert "alone" in refused(owner, 422, kind="map", recording=recording, by=["elf", "motion"])
    refused(owner, 422, kind="map", recording=recording, start_pose=[1e9, 0, 0])
    assert "before the second" in refused(
        owner, 422, kind="map", recording=recording, from_s=9, until_s=9
    )
    refused(owner, 422, kind="map", recording=recording, from_s=-1)
    refused(owner, 422, kind="map", recording=recording, until_s=1e9)
    refused(owner, 422, kind="locate", recording=recording, map=made, mode="dowsing")
    with transaction(owner.services.sessions) as session:
        session.get_one(Recording, recording).state = "receiving"
    assert "must be ready" in refused(owner, 409, kind="map", recording=recording)


def test_too_many_jobs_and_too_many_bytes_are_refused(owner: Somebody, guest: Somebody) -> None:
    recording = owner.remember("mute")
    for _ in range(5):
        ask(owner, kind="map", recording=recording)
    assert "5 jobs wait" in refused(owner, 429, kind="map", recording=recording)
    theirs = guest.remember("mute")
    ask(guest, kind="map", recording=theirs)
    allow(owner.services, user_bytes=9)
    assert "are full" in refused(guest, 413, kind="map", recording=theirs)


def test_nobody_else_sees_a_job_or_uses_what_is_not_theirs(
    owner: Somebody, guest: Somebody, work: Work
) -> None:
    recording, made = mapped(owner, work)
    job = ask(owner, kind="map", recording=recording)
    assert guest.get("/api/jobs").json() == []
    for path in ("", "/fixes.csv"):
        assert guest.get(f"/api/jobs/{job['id']}{path}").status_code == 404
    for verb in ("cancel", "retry"):
        assert guest.post(f"/api/jobs/{job['id']}/{verb}").status_code == 404
    theirs = guest.remember("mute")
    refused(guest, 404, kind="map", recording=recording)
    refused(guest, 404, kind="locate", recording=theirs, map=made)
    assert owner.get(f"/api/jobs/{job['id']}").json()["state"] == "queued"


def test_a_queued_job_is_cancelled_and_retried(owner: Somebody, work: Work) -> None:
    job = ask(owner, kind="map", recording=owner.remember("mute"))
    place = f"/api/jobs/{job['id']}"
    assert owner.post(f"{place}/retry").status_code == 409
    assert owner.post(f"{place}/cancel").json()["state"] == "cancelled"
    assert owner.post(f"{place}/cancel").json()["state"] == "cancelled"
    assert owner.post(f"{place}/retry").json()["state"] == "queued"
    work()
    assert "done already" in owner.post(f"{place}/cancel").json()["detail"]
    assert owner.post(f"{place}/retry").status_code == 409


def test_a_retry_deletes_what_the_failure_left(owner: Somebody, work: Work) -> None:
    ask(owner, kind="map", recording=owner.remember("mute"))
    before = left(owner)
    failed = work("no loop closed")
    assert failed["state"] == "failed"
    assert owner.get(f"/api/maps/{failed['map']}").status_code == 200
    assert owner.post(f"/api/jobs/{failed['id']}/retry").json()["gave"] == {}
    assert left(owner) == before
    assert owner.get(f"/api/maps/{failed['map']}").status_code == 404


def test_fixes_are_told_and_sent(owner: Somebody, work: Work) -> None:
    recording, made = mapped(owner, work)
    job = ask(owner, kind="locate", recording=recording, map=made)
    assert owner.get(f"/api/jobs/{job['id']}/fixes.csv").status_code == 404
    done = work()
    assert (done["fixes"], done["counts"]) == (job["id"], {"OK": 1})
    answer = owner.get(f"/api/jobs/{job['id']}/fixes.csv")
    assert answer.text == f"fixes of {job['id']}\n"
    assert answer.headers["content-type"].startswith("text/csv")


def test_a_deleted_recording_takes_along_all_that_came_of_it(owner: Somebody, work: Work) -> None:
    before = left(owner)
    recording, made = mapped(owner, work)
    ask(owner, kind="locate", recording=recording, map=made)
    work()
    ask(owner, kind="map", recording=recording)
    running = jobs.claim(owner.services.sessions)
    assert running is not None
    assert owner.delete(f"/api/recordings/{recording}").status_code == 204
    assert left(owner) == before
    assert not jobs.holds(owner.services.sessions, running)


def test_a_merged_map_stays_until_its_last_recording_goes(owner: Somebody, work: Work) -> None:
    before = left(owner)
    (first, one), (second, two) = (mapped(owner, work, name) for name in ("mute", "open"))
    ask(owner, kind="merge", maps=[one, two])
    floor = work()["map"]
    told = owner.get(f"/api/maps/{floor}").json()
    assert (told["name"], told["sources"]) == ("mute + open", [first, second])
    owner.delete(f"/api/recordings/{first}")
    assert owner.get(f"/api/maps/{one}").status_code == 404
    assert owner.get(f"/api/maps/{floor}").json()["sources"] == [second]
    owner.delete(f"/api/maps/{two}")
    assert owner.get(f"/api/maps/{floor}").status_code == 200
    owner.delete(f"/api/recordings/{second}")
    assert left(owner) == before


def test_a_deleted_map_takes_along_fixes_and_merges_that_wait(owner: Somebody, work: Work) -> None:
    (first, one), (_, two) = (mapped(owner, work, name) for name in ("mute", "open"))
    before = left(owner)
    again = ask(owner, kind="map", recording=first)
    third = work()["map"]
    ask(owner, kind="locate", recording=first, map=third)
    work()
    waiting = ask(owner, kind="merge", maps=[third, two])
    assert owner.delete(f"/api/maps/{third}").status_code == 204
    assert left(owner) == before
    assert owner.get(f"/api/jobs/{waiting['id']}").status_code == 404
    assert owner.get(f"/api/jobs/{again['id']}").status_code == 404
    assert owner.get(f"/api/maps/{one}").status_code == 200


def test_a_deleted_user_leaves_nothing(owner: Somebody, guest: Somebody, work: Work) -> None:
    before = left(owner)
    recording, made = mapped(guest, work)
    ask(guest, kind="locate", recording=recording, map=made)
    work()
    owner.delete(f"/api/users/{guest.get('/api/me').json()['id']}")
    assert left(owner) == before


def test_whoever_lost_the_claim_leaves_no_files(owner: Somebody, tmp_path: Path) -> None:
    job = ask(owner, kind="map", recording=owner.remember("mute"))
    before = left(owner)
    held = jobs.claim(owner.services.sessions)
    assert held is not None
    owner.post(f"/api/jobs/{job['id']}/cancel")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "map.npz").write_text("too late")
    assert not keep(owner.services, held, tmp_path, Result(FACTS))
    assert left(owner) == before
