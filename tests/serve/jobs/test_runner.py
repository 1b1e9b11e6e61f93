"""Jobs from the queue to a map, whatever happens on the way or is lacking, and several at once."""

import os
import signal
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.base.values import FixStatus
from elfslam.data.position_files import read_fixes
from elfslam.data.recordings import read_recording, write_recording
from elfslam.serve.app import create_app
from elfslam.serve.jobs.executors import DISK_FULL
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map
from elfslam.stages.chirp import describe_chirp
from tests.disks import mounted
from tests.serve.conftest import Json, Somebody, allow, asking, job_when
from tests.serve.jobs.conftest import Keep
from tests.stages.pressure import with_stairs
from tests.waiting import until

pytestmark = pytest.mark.real

MEBIBYTE = 2**20
LONGER_S = 12.0
"""SQLite waits for 10 s for somebody who writes."""


def works(job: Json) -> bool:
    return bool(job["state"] == "running" and job["doing"] not in ("", "starting"))


def left_over(services: Services) -> list[str]:
    return [item.name for item in services.settings.work_folder.iterdir()]


def test_a_stretch_of_a_walk_becomes_a_map_beside_that_of_the_whole(owner: Somebody) -> None:
    recording = owner.remember("one")
    whole, part = (
        owner.done(kind="map", recording=recording, by=["motion"], **stretch)
        for stretch in ({}, {"from_s": 5, "until_s": 12.5})
    )
    maps = [owner.get(f"/api/maps/{job['gave']['map']}").json() for job in (whole, part)]
    assert maps[0]["sources"] == maps[1]["sources"] == [recording]
    assert "kept_s" not in maps[0]["facts"]
    assert maps[1]["facts"]["kept_s"] == [5.0, 12.5]
    assert 5 < maps[1]["facts"]["duration_s"] < 7.5 < maps[0]["facts"]["duration_s"]
    none = owner.done(kind="map", recording=recording, from_s=900)
    assert (none["state"], none["gave"]) == ("failed", {})
    assert "wanted motion from 900" in none["problem"]


def test_a_walk_over_two_floors_becomes_a_map_a_floor_in_one_frame(
    owner: Somebody, walks: Path, tmp_path: Path
) -> None:
    climbed = with_stairs(read_recording(walks / "one"), 11.0, 8.0)
    write_recording(climbed, tmp_path / "climbed", chirp_description=describe_chirp())
    recording = owner.remember("The tower", tmp_path / "climbed")
    job = owner.done(kind="map", recording=recording, by=["motion"])
    assert job["problem"] is None
    lower, upper = (
        owner.get(f"/api/maps/{each}").json()
        for each in (job["gave"]["map"], *job["gave"]["floors"])
    )
    assert [each["level"] for each in (lower, upper)] == [0, 1]
    for each in (lower, upper):
        assert (each["venue"], each["facts"]["frame"]) == ("The tower", lower["id"])
        assert [passage["kind"] for passage in each["facts"]["passages"]] == ["stairs"]
        assert {"run.json", "trajectory.tum", "report.html"} <= {f["name"] for f in each["files"]}
    assert lower["facts"]["duration_s"] == pytest.approx(10.0, abs=2)
    owner.delete(f"/api/recordings/{recording}").raise_for_status()
    assert owner.get("/api/maps").json() == []


def test_the_walk_of_the_demonstration_is_merged_into_its_floor(owner: Somebody) -> None:
    made = owner.post("/api/demonstration").json()
    upstairs = [each["id"] for each in made if each["level"] == 1]
    job = owner.done(kind="merge", maps=upstairs)
    assert job["problem"] is None
    merged = owner.get(f"/api/maps/{job['gave']['map']}").json()
    assert (merged["facts"]["walks"], merged["facts"]["refused"]) == (2, {})
    assert (merged["venue"], merged["level"]) == ("Demonstration building", 1)
    assert merged["facts"]["level"] == 1
    way = {"start": "Kitchen", "goal": "Reception"}
    found = owner.get(f"/api/maps/{merged['id']}/way", params=way).raise_for_status().json()
    assert found["legs"][0]["map"] == merged["id"], "it is the floor of the building now"


def test_a_walk_is_located_on_the_floor_that_sounds_like_it(
    owner: Somebody, keep_map: Keep, tmp_path: Path, services: Services
) -> None:
    made = owner.post("/api/demonstration").json()
    entrance = next(each for each in made if each["facts"].get("level") == 0)
    above = keep_map(owner, "one")
    with transaction(services.sessions) as session:
        row = session.get_one(Map, above)
        row.facts = {**row.facts, "level": 2, "frame": entrance["facts"]["frame"]}
        mute = Map(user_id=row.user_id, name="unheard", kind="run", facts={**row.facts, "level": 3})
        session.add(mute)
    given = {"recording": owner.remember("two"), "map": entrance["id"]}
    job = owner.done(kind="locate", **given)
    assert job["problem"] is None
    (tmp_path / "fixes.csv").write_bytes(owner.get(f"/api/jobs/{job['id']}/fixes.csv").content)
    fixes = read_fixes(tmp_path / "fixes.csv")
    assert fixes.level is not None
    assert set(fixes.level[fixes.status == FixStatus.OK]) == {2}


def test_maps_are_merged_and_a_walk_is_located(owner: Somebody, tmp_path: Path) -> None:
    recordings = [owner.remember(name) for name in ("one", "two")]
    runs = [owner.done(kind="map", recording=each) for each in recordings]
    for job, recording in zip(runs, recordings, strict=True):
        assert (job["state"], job["problem"], job["share"]) == ("done", None, 1.0)
        made = owner.get(f"/api/maps/{job['gave']['map']}").json()
        assert (made["sources"], made["facts"]["status"]) == ([recording], "OK")
    maps = [job["gave"]["map"] for job in reversed(runs)]
    door = {"name": "Door", "kind": "door", "x_m": 0.0, "y_m": 0.0}
    named = {"version": "", "points": [door]}
    owner.put(f"/api/maps/{maps[1]}/points-of-interest", json=named).raise_for_status()
    merged = owner.done(kind="merge", maps=maps, name="the studio")
    assert merged["problem"] is None
    floor = owner.get(f"/api/maps/{merged['gave']['map']}").json()
    assert (floor["name"], floor["kind"]) == ("the studio", "floor")
    assert floor["sources"] == recordings
    kept = owner.get(f"/api/maps/{floor['id']}/points-of-interest").json()["points"]
    assert [each["name"] for each in kept] == ["Door"]
    assert floor["facts"]["walks"] == 2
    told = [owner.get(f"/api/maps/{each}").json()["facts"]["distance_m"] for each in maps]
    assert floor["facts"]["distance_m"] == pytest.approx(sum(told), rel=0.1)
    again = owner.done(kind="merge", maps=[floor["id"], maps[0]])
    assert "in the map already" in again["problem"]
    located = owner.done(kind="locate", recording=recordings[1], map=floor["id"])
    assert located["problem"] is None
    (tmp_path / "fixes.csv").write_bytes(owner.get(f"/api/jobs/{located['id']}/fixes.csv").content)
    assert len(read_fixes(tmp_path / "fixes.csv").t_s) == sum(located["gave"]["counts"].values())
    until(lambda: left_over(owner.services) == [], "an empty folder of work")


def test_a_walk_elsewhere_is_located_nowhere(
    owner: Somebody, keep_map: Keep, tmp_path: Path
) -> None:
    where = {"recording": owner.remember("away"), "map": keep_map(owner, "one")}
    job = owner.done(kind="locate", mode="one-shot", **where)
    assert job["state"] == "failed"
    assert job["problem"] == "away: nowhere in one; is it the same place?"
    (tmp_path / "fixes.csv").write_bytes(owner.get(f"/api/jobs/{job['id']}/fixes.csv").content)
    fixes = read_fixes(tmp_path / "fixes.csv")
    assert len(fixes.t_s) == job["gave"]["counts"]["UNKNOWN_PLACE"] > 50


def test_a_walk_without_a_loop_fails_honestly_and_leaves_its_dead_reckoning(
    owner: Somebody,
) -> None:
    job = owner.done(kind="map", recording=owner.remember("open"))
    assert job["state"] == "failed"
    assert "no loop closure held" in job["problem"]
    made = owner.get(f"/api/maps/{job['gave']['map']}").json()
    assert made["facts"]["status"] == "NO_CLOSURES"
    again = owner.post(f"/api/jobs/{job['id']}/retry").json()
    assert (again["state"], again["gave"]) == ("queued", {})
    assert owner.get(f"/api/maps/{made['id']}").status_code == 404
    assert owner.ended(job["id"])["state"] == "failed"
    assert len(owner.get("/api/maps").json()) == 1


def test_what_a_recording_lacks_is_said_in_a_line_without_our_folders(owner: Somebody) -> None:
    job = owner.done(kind="map", recording=owner.remember("mute"), by=["wifi"])
    assert (job["state"], job["gave"]) == ("failed", {})
    assert job["problem"] == "mute: no Wi-Fi scans; map it by something else"
    until(lambda: left_over(owner.services) == [], "an empty folder of work")


def test_a_cancel_in_the_middle_leaves_nothing(owner: Somebody, services: Services) -> None:
    before = sorted(services.settings.blobs_folder.glob("*/*"))
    recording = owner.remember("one")
    job_id = owner.start(kind="map", recording=recording)
    assert 0 < job_when(owner, job_id, works)["share"] < 1
    [process] = processes_of(services)
    assert owner.post(f"/api/jobs/{job_id}/cancel").json()["state"] == "cancelled"
    until(lambda: process not in processes_of(services), "the end of the process")
    until(lambda: left_over(services) == [], "an empty folder of work")
    assert owner.get("/api/maps").json() == []
    assert owner.post(f"/api/jobs/{job_id}/retry").json()["state"] == "queued"
    assert owner.ended(job_id)["state"] == "done"
    owner.delete(f"/api/recordings/{recording}")
    assert sorted(services.settings.blobs_folder.glob("*/*")) == before


def test_the_crash_of_a_job_hurts_nobody_and_is_retried(owner: Somebody) -> None:
    job_id = owner.start(kind="map", recording=owner.remember("mute"))
    job_when(owner, job_id, lambda job: bool(processes_of(owner.services)))
    os.kill(min(processes_of(owner.services)), signal.SIGKILL)
    job = owner.ended(job_id)
    assert job["state"] == "failed"
    assert "it was killed" in job["problem"]
    job_when(owner, job_id, lambda job: not left_over(owner.services))
    owner.post(f"/api/jobs/{job_id}/retry")
    job = owner.ended(job_id)
    assert (job["state"], job["attempts"]) == ("done", 1)


def test_a_server_that_stops_gives_its_job_to_the_next(
    owner: Somebody, services: Services, anyone: Somebody
) -> None:
    job_id = owner.start(kind="map", recording=owner.remember("mute"))
    job_when(owner, job_id, lambda job: bool(processes_of(services)))
    token = owner.headers["Authorization"]
    anyone.__exit__(None, None, None)
    assert processes_of(services) == set()
    assert left_over(services) == []
    with asking(create_app(open_services(services.settings))) as after:
        after.headers["Authorization"] = token
        job = after.ended(job_id)
    assert (job["state"], job["attempts"]) == ("done", 1)
    anyone.__enter__()


@pytest.fixture(params=[2, 5], ids=["for what is given", "for what is made"])
def small_work(settings: ServerSettings, request: pytest.FixtureRequest) -> Iterator[Path]:
    """The folder of scratch on a disk too small for a job; skips the test where none is made."""
    with mounted(settings.work_folder, size=request.param * MEBIBYTE) as place:
        yield place


def test_a_full_disk_fails_the_job_until_there_is_room(small_work: Path, owner: Somebody) -> None:
    job_id = owner.start(kind="map", recording=owner.remember("one"))
    job = owner.ended(job_id)
    assert (job["state"], job["problem"], job["gave"]) == ("failed", DISK_FULL, {})
    until(lambda: left_over(owner.services) == [], "an empty folder of work")
    subprocess.run(["umount", str(small_work)], check=True)
    owner.post(f"/api/jobs/{job_id}/retry")
    assert owner.ended(job_id)["state"] == "done"


def test_a_database_that_is_busy_for_long_stops_no_job(owner: Somebody, services: Services) -> None:
    job_id = owner.start(kind="map", recording=owner.remember("mute"))
    other = sqlite3.connect(services.settings.data_folder / "elfslam.sqlite", isolation_level=None)
    while owner.get(f"/api/jobs/{job_id}").json()["state"] == "queued":
        time.sleep(0.02)
    other.execute("BEGIN IMMEDIATE")
    time.sleep(LONGER_S)
    assert owner.get(f"/api/jobs/{job_id}").json()["state"] == "running"
    other.execute("ROLLBACK")
    other.close()
    job = owner.ended(job_id)
    assert (job["state"], job["attempts"]) == ("done", 1)


def test_a_job_that_takes_too_much_memory_fails_alone(owner: Somebody, services: Services) -> None:
    allow(services, job_bytes=MEBIBYTE)
    job = owner.done(kind="map", recording=owner.remember("one"))
    assert job["state"] == "failed"
    assert "than the 0.00098 GiB" in job["problem"] or "ended in the middle" in job["problem"]
    until(lambda: left_over(services) == [], "an empty folder of work")


def test_a_job_that_takes_too_long_is_stopped(owner: Somebody, services: Services) -> None:
    allow(services, job_s=0.01)
    job = owner.done(kind="map", recording=owner.remember("mute"))
    assert job["state"] == "failed"
    assert "took longer" in job["problem"]


def processes_of(services: Services) -> set[int]:
    """Those that work on jobs: what they say of trouble goes into the folder of one."""
    work, found = str(services.settings.work_folder), set()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if os.readlink(entry / "fd" / "2").startswith(work):
                found.add(int(entry.name))
        except OSError:
            continue
    return found


def held(services: Services) -> set[int]:
    """Those that work, each stopped where it is: none is done before another has begun."""
    working = processes_of(services)
    for process in working:
        os.kill(process, signal.SIGSTOP)
    return working


def killed(services: Services, times: int) -> None:
    """Kill the next processes that work, each once."""
    gone = set[int]()

    def enough() -> bool:
        for process in processes_of(services) - gone:
            os.kill(process, signal.SIGKILL)
            gone.add(process)
        return len(gone) >= times

    until(enough, f"{times} processes", between=lambda: time.sleep(0.005))


class TestSeveral:
    """Two processes of this machine work."""

    @pytest.fixture
    def settings(self, settings: ServerSettings) -> ServerSettings:
        return replace(settings, on="2")

    def test_two_jobs_at_once_and_one_killed_is_done_again(self, owner: Somebody) -> None:
        jobs = [owner.start(kind="map", recording=owner.remember(name)) for name in ("one", "two")]
        until(lambda: len(held(owner.services)) == 2, "two processes at work")
        unlucky, lucky = sorted(processes_of(owner.services))
        os.kill(unlucky, signal.SIGKILL)
        os.kill(lucky, signal.SIGCONT)
        found = [owner.ended(job) for job in jobs]
        assert [job["state"] for job in found] == ["done", "done"]
        assert sorted(job["attempts"] for job in found) == [1, 2]
        assert len(owner.get("/api/maps").json()) == 2
        assert list(owner.services.settings.work_folder.iterdir()) == []

    def test_a_job_whose_process_dies_three_times_is_given_up(self, owner: Somebody) -> None:
        job = owner.start(kind="map", recording=owner.remember("one"))
        killed(owner.services, 3)
        found = owner.ended(job)
        assert (found["state"], found["attempts"]) == ("failed", 3)
        assert "it was killed" in found["problem"]
        assert owner.get("/api/maps").json() == []
