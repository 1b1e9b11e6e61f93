"""Jobs from the queue to a map, whatever happens on the way."""

from __future__ import annotations

import io
import os
import signal
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from elfslam.app.map import MapJob
from elfslam.app.settings import Settings
from elfslam.base.values import FixStatus
from elfslam.data.position_files import read_fixes
from elfslam.data.recordings import read_recording, write_recording
from elfslam.serve.app import create_app
from elfslam.serve.services import Services, open_services
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map, Recording, RecordingState
from elfslam.stages.chirp import describe_chirp
from tests.serve.jobs.conftest import start
from tests.serve.planting import plant_files
from tests.stages.pressure import with_stairs
from tests.waiting import until

pytestmark = pytest.mark.real

Json = dict[str, Any]
Remember = Callable[[TestClient, str], str]
Wait = Callable[[TestClient, str], Json]
AS_THE_COMMAND = MapJob((), None, "compact", Settings(), overwrite=False)
DATED = {"run.json", "timings.json", "report.html"}
"""Files of a run that say when it was made, or how long it took."""


def ignore(what: str, share: float | None) -> None:
    """Nobody watches."""


def when(client: TestClient, job_id: str, wanted: Callable[[Json], bool]) -> Json:
    """The job, as soon as it is as wanted."""

    def as_wanted() -> Json | None:
        job: Json = client.get(f"/api/jobs/{job_id}").json()
        return job if wanted(job) else None

    job = until(as_wanted, "the job as wanted")
    assert job is not None
    return job


def works(job: Json) -> bool:
    return bool(job["state"] == "running" and job["doing"] not in ("", "starting"))


def unpacked(client: TestClient, map_id: str, folder: Path) -> Path:
    packed = client.get(f"/api/maps/{map_id}/map.zip").content
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        archive.extractall(folder)
    [top] = folder.iterdir()
    return top


def children_of(services: Services) -> list[int]:
    """The processes that work in a folder of these services."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = entry.read_bytes()
        except OSError:
            continue
        if (
            b"elfslam.serve.jobs.work" in line
            and str(services.settings.work_folder).encode() in line
        ):
            found.append(int(entry.parent.name))
    return found


def left_over(services: Services) -> list[str]:
    return [item.name for item in services.settings.work_folder.iterdir()]


def test_a_stretch_of_a_walk_becomes_a_map_beside_that_of_the_whole(
    owner: TestClient, remember: Remember, ended: Wait
) -> None:
    recording = remember(owner, "one")
    whole, part = (
        ended(owner, start(owner, kind="map", recording=recording, by=["motion"], **stretch))
        for stretch in ({}, {"from_s": 5, "until_s": 12.5})
    )
    maps = [owner.get(f"/api/maps/{job['gave']['map']}").json() for job in (whole, part)]
    assert maps[0]["sources"] == maps[1]["sources"] == [recording]
    assert "kept_s" not in maps[0]["facts"]
    assert maps[1]["facts"]["kept_s"] == [5.0, 12.5]
    assert 5 < maps[1]["facts"]["duration_s"] < 7.5 < maps[0]["facts"]["duration_s"]
    none = ended(owner, start(owner, kind="map", recording=recording, from_s=900))
    assert (none["state"], none["gave"]) == ("failed", {})
    assert "wanted motion from 900" in none["problem"]


def test_a_walk_over_two_floors_becomes_a_map_a_floor_in_one_frame(
    owner: TestClient, services: Services, walks: Path, tmp_path: Path, ended: Wait
) -> None:
    climbed = with_stairs(read_recording(walks / "one"), 11.0, 8.0)
    write_recording(climbed, tmp_path / "climbed", chirp_description=describe_chirp())
    user_id = owner.get("/api/me").json()["id"]
    row = Recording(user_id=user_id, name="The tower", state=RecordingState.READY)
    recording = plant_files(services, row, tmp_path / "climbed")
    job = ended(owner, start(owner, kind="map", recording=recording, by=["motion"]))
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


def test_the_walk_of_the_demonstration_is_merged_into_its_floor(
    owner: TestClient, ended: Wait
) -> None:
    made = owner.post("/api/demonstration").json()
    upstairs = [each["id"] for each in made if each["level"] == 1]
    job = ended(owner, start(owner, kind="merge", maps=upstairs))
    assert job["problem"] is None
    merged = owner.get(f"/api/maps/{job['gave']['map']}").json()
    assert (merged["facts"]["walks"], merged["facts"]["refused"]) == (2, {})
    assert (merged["venue"], merged["level"]) == ("Demonstration building", 1)
    assert merged["facts"]["level"] == 1
    way = {"start": "Kitchen", "goal": "Reception"}
    found = owner.get(f"/api/maps/{merged['id']}/way", params=way).raise_for_status().json()
    assert found["legs"][0]["map"] == merged["id"], "it is the floor of the building now"


def test_a_walk_is_located_on_the_floor_that_sounds_like_it(
    owner: TestClient, remember: Remember, keep_map: Remember, ended: Wait, tmp_path: Path,
    services: Services,
) -> None:  # fmt: skip
    made = owner.post("/api/demonstration").json()
    entrance = next(each for each in made if each["facts"].get("level") == 0)
    above = keep_map(owner, "one")
    with transaction(services.sessions) as session:
        row = session.get_one(Map, above)
        row.facts = {**row.facts, "level": 2, "frame": entrance["facts"]["frame"]}
        mute = Map(user_id=row.user_id, name="unheard", kind="run", facts={**row.facts, "level": 3})
        session.add(mute)
    given = {"recording": remember(owner, "two"), "map": entrance["id"]}
    job = ended(owner, start(owner, kind="locate", **given))
    assert job["problem"] is None
    (tmp_path / "fixes.csv").write_bytes(owner.get(f"/api/jobs/{job['id']}/fixes.csv").content)
    fixes = read_fixes(tmp_path / "fixes.csv")
    assert fixes.level is not None
    assert set(fixes.level[fixes.status == FixStatus.OK]) == {2}


def test_maps_are_merged_and_a_walk_is_located(
    owner: TestClient, remember: Remember, ended: Wait, tmp_path: Path, services: Services
) -> None:
    recordings = [remember(owner, name) for name in ("one", "two")]
    runs = [ended(owner, start(owner, kind="map", recording=each)) for each in recordings]
    for job, recording in zip(runs, recordings, strict=True):
        assert (job["state"], job["problem"], job["share"]) == ("done", None, 1.0)
        made = owner.get(f"/api/maps/{job['gave']['map']}").json()
        assert (made["sources"], made["facts"]["status"]) == ([recording], "OK")
    maps = [job["gave"]["map"] for job in reversed(runs)]
    door = {"name": "Door", "kind": "door", "x_m": 0.0, "y_m": 0.0}
    named = {"version": "", "points": [door]}
    owner.put(f"/api/maps/{maps[1]}/points-of-interest", json=named).raise_for_status()
    merged = ended(owner, start(owner, kind="merge", maps=maps, name="the studio"))
    assert merged["problem"] is None
    floor = owner.get(f"/api/maps/{merged['gave']['map']}").json()
    assert (floor["name"], floor["kind"]) == ("the studio", "floor")
    assert floor["sources"] == recordings
    kept = owner.get(f"/api/maps/{floor['id']}/points-of-interest").json()["points"]
    assert [each["name"] for each in kept] == ["Door"]
    assert floor["facts"]["walks"] == 2
    told = [owner.get(f"/api/maps/{each}").json()["facts"]["distance_m"] for each in maps]
    assert floor["facts"]["distance_m"] == pytest.approx(sum(told), rel=0.1)
    again = ended(owner, start(owner, kind="merge", maps=[floor["id"], maps[0]]))
    assert "in the map already" in again["problem"]
    located = ended(owner, start(owner, kind="locate", recording=recordings[1], map=floor["id"]))
    assert located["problem"] is None
    (tmp_path / "fixes.csv").write_bytes(owner.get(f"/api/jobs/{located['id']}/fixes.csv").content)
    assert len(read_fixes(tmp_path / "fixes.csv").t_s) == sum(located["gave"]["counts"].values())
    until(lambda: left_over(services) == [], "an empty folder of work")


def test_a_walk_elsewhere_is_located_nowhere(
    owner: TestClient, remember: Remember, keep_map: Remember, ended: Wait, tmp_path: Path
) -> None:
    where = {"recording": remember(owner, "away"), "map": keep_map(owner, "one")}
    job = ended(owner, start(owner, kind="locate", mode="one-shot", **where))
    assert job["state"] == "failed"
    assert job["problem"] == "away: nowhere in one; is it the same place?"
    (tmp_path / "fixes.csv").write_bytes(owner.get(f"/api/jobs/{job['id']}/fixes.csv").content)
    fixes = read_fixes(tmp_path / "fixes.csv")
    assert len(fixes.t_s) == job["gave"]["counts"]["UNKNOWN_PLACE"] > 50


def test_a_walk_without_a_loop_fails_honestly_and_leaves_its_dead_reckoning(
    owner: TestClient, remember: Remember, ended: Wait
) -> None:
    job = ended(owner, start(owner, kind="map", recording=remember(owner, "open")))
    assert job["state"] == "failed"
    assert "no loop closure held" in job["problem"]
    made = owner.get(f"/api/maps/{job['gave']['map']}").json()
    assert made["facts"]["status"] == "NO_CLOSURES"
    again = owner.post(f"/api/jobs/{job['id']}/retry").json()
    assert (again["state"], again["gave"]) == ("queued", {})
    assert owner.get(f"/api/maps/{made['id']}").status_code == 404
    assert ended(owner, job["id"])["state"] == "failed"
    assert len(owner.get("/api/maps").json()) == 1


def test_what_a_recording_lacks_is_said_in_a_line_without_our_folders(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    job = ended(owner, start(owner, kind="map", recording=remember(owner, "mute"), by=["wifi"]))
    assert (job["state"], job["gave"]) == ("failed", {})
    assert job["problem"] == "mute: no Wi-Fi scans; map it by something else"
    until(lambda: left_over(services) == [], "an empty folder of work")


def test_a_cancel_in_the_middle_leaves_nothing(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    before = sorted(services.settings.blobs_folder.glob("*/*"))
    recording = remember(owner, "one")
    job_id = start(owner, kind="map", recording=recording)
    assert 0 < when(owner, job_id, works)["share"] < 1
    [process] = children_of(services)
    assert owner.post(f"/api/jobs/{job_id}/cancel").json()["state"] == "cancelled"
    until(lambda: process not in children_of(services), "the end of the process")
    until(lambda: left_over(services) == [], "an empty folder of work")
    assert owner.get("/api/maps").json() == []
    assert owner.post(f"/api/jobs/{job_id}/retry").json()["state"] == "queued"
    assert ended(owner, job_id)["state"] == "done"
    owner.delete(f"/api/recordings/{recording}")
    assert sorted(services.settings.blobs_folder.glob("*/*")) == before


def test_the_crash_of_a_job_hurts_nobody_and_is_retried(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    job_id = start(owner, kind="map", recording=remember(owner, "mute"))
    when(owner, job_id, lambda job: bool(children_of(services)))
    os.kill(children_of(services)[0], signal.SIGKILL)
    job = ended(owner, job_id)
    assert job["state"] == "failed"
    assert "it was killed" in job["problem"]
    when(owner, job_id, lambda job: not left_over(services))
    owner.post(f"/api/jobs/{job_id}/retry")
    job = ended(owner, job_id)
    assert (job["state"], job["attempts"]) == ("done", 1)


def test_a_server_that_stops_gives_its_job_to_the_next(
    app: FastAPI, remember: Remember, ended: Wait, owner: TestClient, services: Services,
    anyone: TestClient,
) -> None:  # fmt: skip
    job_id = start(owner, kind="map", recording=remember(owner, "mute"))
    when(owner, job_id, lambda job: bool(children_of(services)))
    token = owner.headers["Authorization"]
    anyone.__exit__(None, None, None)
    assert children_of(services) == []
    assert left_over(services) == []
    with TestClient(
        create_app(open_services(services.settings)),
        client=("127.0.0.1", 50_000),
        base_url="http://127.0.0.1",
    ) as after:
        after.headers["Authorization"] = token
        job = ended(after, job_id)
    assert (job["state"], job["attempts"]) == ("done", 1)
    anyone.__enter__()
