"""Recordings: completed when all has come, refused in words, fetched whole, deleted for good."""

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from sqlalchemy import select

from elfslam.data.recordings import read_recording
from elfslam.serve.problems import Problem
from elfslam.serve.receiving.completing import PendingRecording, ReceivedFile, keep
from elfslam.serve.receiving.reader import ReadFolder
from elfslam.serve.services import Services
from elfslam.serve.store.blobs import blob_of
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Job, JobKind, Map
from studies.benchmarks.served import TUS
from tests.serve.conftest import DATABASES, Somebody
from tests.serve.uploading import begun, created, recording_of, send_all, zipped

Files = Mapping[str, bytes]


def completion(files: Files, **more: Any) -> dict[str, Any]:
    return {
        "files": [
            {"name": name, "size_bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in files.items()
        ],
        **more,
    }


def jobs(services: Services) -> list[Job]:
    with reading(services.sessions) as session:
        return list(session.scalars(select(Job)))


def blobs_of(services: Services) -> list[Path]:
    return list(services.settings.blobs_folder.glob("*/*"))


@DATABASES
def test_a_walk_goes_in_and_comes_out(
    owner: Somebody, guest: Somebody, services: Services, walk_files: Files, tmp_path: Path
) -> None:
    name = begun(owner, device="phone", start_pose=[1, 2, 0.5])
    send_all(owner, name, walk_files)
    answer = owner.post(f"/api/recordings/{name}/complete", json=completion(walk_files))
    assert answer.status_code == 200, answer.text
    ready = answer.json()
    assert ready["state"] == "ready"
    assert ready["facts"]["duration_s"] == pytest.approx(0.8)
    assert ready["facts"]["bytes"] == sum(map(len, walk_files.values()))
    assert ready["facts"]["sensors"] == ["imu"]
    ((from_s, until_s),) = ready["facts"]["spans_s"]["motion"]
    assert (from_s, until_s) == (0.0, 0.78)
    assert ready["uploads"] == []
    assert {file["name"] for file in ready["files"]} == set(walk_files)
    assert [job.given for job in jobs(services)] == [
        {"recording": name, "start_pose": [1.0, 2.0, 0.5]}
    ]
    assert list(services.settings.uploads_folder.iterdir()) == []
    assert list(services.settings.work_folder.iterdir()) == []

    again = owner.post(f"/api/recordings/{name}/complete", json=completion(walk_files))
    assert again.json() == ready
    assert len(jobs(services)) == 1

    fetched = owner.get(f"/api/recordings/{name}/recording.zip")
    (tmp_path / "walk.zip").write_bytes(fetched.content)
    assert read_recording(tmp_path / "walk.zip").device == "test phone"
    assert owner.get("/api/me").json()["used_bytes"] == ready["facts"]["bytes"]

    for method, path in (("GET", ""), ("DELETE", ""), ("GET", "/recording.zip")):
        assert guest.request(method, f"/api/recordings/{name}{path}").status_code == 404
    wanted = completion(walk_files)
    assert guest.post(f"/api/recordings/{name}/complete", json=wanted).status_code == 404
    assert guest.get("/api/recordings").json() == []

    assert owner.delete(f"/api/recordings/{name}").status_code == 204
    assert blobs_of(services) == []
    assert owner.get("/api/recordings").json() == []


def test_what_two_share_stays_until_both_are_gone(
    owner: Somebody, guest: Somebody, services: Services, walk_files: Files
) -> None:
    names = []
    for client in (owner, guest):
        names.append(begun(client))
        send_all(client, names[-1], walk_files)
        wanted = completion(walk_files, map=False)
        assert client.post(f"/api/recordings/{names[-1]}/complete", json=wanted).is_success
    assert jobs(services) == []
    assert len(blobs_of(services)) == len(walk_files)
    owner.delete(f"/api/recordings/{names[0]}")
    assert len(blobs_of(services)) == len(walk_files)
    theirs = guest.id
    assert owner.delete(f"/api/users/{theirs}").status_code == 204
    assert blobs_of(services) == []


def test_what_is_missing_is_said(owner: Somebody, walk_files: Files) -> None:
    name = begun(owner)
    send_all(owner, name, {"recording.json": walk_files["recording.json"][:-1]})
    wanted = completion({"recording.json": walk_files["recording.json"]})
    answer = owner.post(f"/api/recordings/{name}/complete", json=wanted)
    assert answer.status_code == 409
    size = len(walk_files["recording.json"])
    assert f"recording.json: {size - 1} of {size} bytes" in answer.json()["detail"]
    assert owner.get(f"/api/recordings/{name}").json()["state"] == "receiving"


def test_a_file_that_came_changed_is_said(owner: Somebody, services: Services) -> None:
    name = begun(owner)
    send_all(owner, name, {"recording.json": b"{}"})
    answer = owner.post(
        f"/api/recordings/{name}/complete", json=completion({"recording.json": b"[]"})
    )
    assert answer.status_code == 409
    assert "SHA-256" in answer.json()["detail"]
    assert blobs_of(services) == []


def test_what_cannot_be_read_is_refused_in_the_readers_words(
    owner: Somebody, services: Services, walk_files: Files
) -> None:
    name = begun(owner)
    files = {**walk_files, "gyroscope.csv": walk_files["gyroscope.csv"].replace(b"t_s,x", b"t_s,q")}
    send_all(owner, name, files)
    wanted = completion(files)
    answer = owner.post(f"/api/recordings/{name}/complete", json=wanted)
    assert answer.status_code == 422
    detail = answer.json()["detail"]
    assert detail.startswith("gyroscope.csv")
    assert str(services.settings.data_folder) not in detail
    kept = owner.get(f"/api/recordings/{name}").json()
    assert (kept["state"], kept["refusal"]) == ("refused", detail)
    assert owner.post(f"/api/recordings/{name}/complete", json=wanted).json() == answer.json()
    assert jobs(services) == []


def test_a_wrong_rate_is_refused(owner: Somebody) -> None:
    sound = io.BytesIO()
    soundfile.write(sound, np.zeros(22_050), 22_050, format="WAV")
    files = {"recording.json": b'{"format_version": 1}', "audio.wav": sound.getvalue()}
    name = begun(owner)
    send_all(owner, name, files)
    answer = owner.post(f"/api/recordings/{name}/complete", json=completion(files))
    assert answer.status_code == 422
    assert "22050" in answer.json()["detail"]


def test_names_and_completions_that_are_none(owner: Somebody) -> None:
    poses = (b"[1e999, 0, 0]", b"[NaN, 0, 0]", b"[1, 2]")
    names = (b"\\ud800", b"a\\u0000b", b"  ", b"walk\\u202e", b"w" * 200)
    bodies = [b'{"name": "' + name + b'"}' for name in names]
    for body in (
        *bodies,
        *(b'{"name": "w", "start_pose": ' + pose + b"}" for pose in poses),
        b"[]",
    ):
        headers = {"Content-Type": "application/json"}
        answer = owner.post("/api/recordings", content=body, headers=headers)
        assert answer.status_code == 422, body
    assert owner.get("/api/recordings").json() == []
    recording, good = begun(owner), {"name": "wifi.csv", "size_bytes": 1, "sha256": "0" * 64}
    wrong = ({"name": "x.csv"}, {"size_bytes": -1}, {"sha256": "../../etc"})
    for files in ([], [good, good], *([{**good, **each}] for each in wrong)):
        answer = owner.post(f"/api/recordings/{recording}/complete", json={"files": files})
        assert answer.status_code == 422, files


@DATABASES
def test_a_name_is_only_a_name(owner: Somebody) -> None:
    name = "Robert'); DROP TABLE recordings;-- ../../é"
    begun(owner, name=name)
    assert [mine["name"] for mine in owner.get("/api/recordings").json()] == [name]


@DATABASES
def test_a_whole_recording_as_a_zip(owner: Somebody, services: Services, walk_files: Files) -> None:
    packed = zipped(walk_files, "walk/")
    upload = created(owner, len(packed), packed, filename="Café, 2.zip").headers
    head = owner.head(upload["location"], headers=TUS).headers
    assert head["upload-offset"] == head["upload-length"]
    made = owner.get(f"/api/recordings/{head['elfslam-recording']}").json()
    assert (made["state"], made["device"]) == ("ready", "test phone")
    assert made["name"] == "Café, 2", "as it was uploaded, whatever the walk itself is called"
    assert len(jobs(services)) == 1
    assert list(services.settings.uploads_folder.iterdir()) == []


def test_a_zip_whose_recording_was_not_made_before_a_kill(owner: Somebody) -> None:
    data = b"PK\x03\x04 not quite"
    place = created(owner, len(data), filename="w.zip").headers["location"]
    (owner.services.settings.uploads_folder / place.rpartition("/")[2]).write_bytes(data)
    first = owner.head(place, headers=TUS).headers["elfslam-recording"]
    assert owner.head(place, headers=TUS).headers["elfslam-recording"] == first
    [kept] = owner.get("/api/recordings").json()
    assert (kept["state"], kept["files"]) == ("refused", [])
    assert "not whole" in kept["refusal"]


@DATABASES
def test_a_recording_deleted_while_it_is_kept_leaves_nothing(services: Services) -> None:
    path = services.settings.uploads_folder / "x"
    path.write_bytes(b"x")

    def gone(_session: object) -> None:
        raise Problem(404, "gone")

    come = ReceivedFile("wifi.csv", path, blob_of(path))
    with pytest.raises(Problem):
        keep(services, [PendingRecording([come], ReadFolder(), gone)], wants_map=True)
    assert blobs_of(services) == []


def test_a_recording_is_renamed(owner: Somebody, guest: Somebody) -> None:
    name = begun(owner)
    address = f"/api/recordings/{name}"
    assert owner.patch(address, json={"name": " Flur "}).json()["name"] == "Flur"
    assert guest.patch(address, json={"name": "mine"}).status_code == 404
    for wrong in ({"name": ""}, {"name": None}, {}, {"name": "a\u0000b"}):
        assert owner.patch(address, json=wrong).status_code == 422
    assert owner.get(address).json()["name"] == "Flur"


@DATABASES
def test_many_recordings_are_deleted_at_once_with_what_came_of_them_alone(
    owner: Somebody, guest: Somebody, services: Services
) -> None:
    mine, theirs = [begun(owner, f"walk {k}") for k in range(4)], begun(guest)
    alone = owner.put_map("alone", sources=mine[:1])
    both = owner.put_map("both", sources=mine[1:3])
    more = owner.put_map("more", sources=mine[2:])
    with transaction(services.sessions) as session:
        user_id = owner.id
        for each in mine:
            session.add(Job(user_id=user_id, kind=JobKind.MAP, given={"recording": each}))
    sent = {"ids": [*mine[:3], theirs, "0" * 32]}
    assert owner.post("/api/recordings/delete", json=sent).json() == {"count": 3}
    assert [each["id"] for each in owner.get("/api/recordings").json()] == [mine[3]]
    assert [each["id"] for each in guest.get("/api/recordings").json()] == [theirs]
    with reading(services.sessions) as session:
        kept = {row.id: row.sources for row in session.scalars(select(Map))}
        jobs = [job.given["recording"] for job in session.scalars(select(Job))]
    assert kept == {more: mine[3:]}
    assert jobs == mine[3:]
    assert {alone, both}.isdisjoint(kept)


@pytest.fixture
def kept(owner: Somebody, walk_files: Files) -> str:
    """The address of a small recording with sound and motion."""
    return sent(owner, walk_files)


def sent(client: Somebody, files: dict[str, bytes]) -> str:
    return f"/api/recordings/{recording_of(client, 'walk.zip', zipped(files), map='false')}"


def test_curves_and_rates_are_told(owner: Somebody, kept: str) -> None:
    answer = owner.get(f"{kept}/sensors")
    assert answer.status_code == 200
    told = answer.json()
    assert [each["name"] for each in told["sensors"]] == ["audio", "imu"]
    assert told["sensors"][1]["rate_hz"] == 50.0
    assert {"acceleration", "sound level"} <= {each["name"] for each in told["curves"]}


def test_what_did_not_change_is_not_read_again(
    owner: Somebody, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tag = owner.get(f"{kept}/sensors").headers["etag"]
    monkeypatch.setattr("elfslam.serve.receiving.recordings.SENSORS", "elfslam.no_such:parse")
    again = owner.get(f"{kept}/sensors", headers={"If-None-Match": tag})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
    assert owner.get(f"{kept}/sensors").status_code == 503


def test_each_file_comes_as_it_was(owner: Somebody, kept: str, walk_files: Files) -> None:
    for name, data in walk_files.items():
        answer = owner.get(f"{kept}/files/{name}")
        assert (answer.status_code, answer.content) == (200, data)
        assert "attachment" in answer.headers["content-disposition"]
    assert answer.headers["x-content-type-options"] == "nosniff"
    table = owner.get(f"{kept}/files/accelerometer.csv")
    assert table.headers["content-type"].startswith("text/csv")


def test_what_is_no_file_of_it_is_not_found_and_nobody_else_sees_any(
    owner: Somebody, guest: Somebody, kept: str
) -> None:
    for name in ("wifi.csv", "..%2Faudio.flac", "recording.json%00", "x" * 300):
        assert owner.get(f"{kept}/files/{name}").status_code == 404, name
    assert guest.get(f"{kept}/sensors").status_code == 404
    assert guest.get(f"{kept}/files/accelerometer.csv").status_code == 404


def test_what_is_not_there_yet_or_was_refused_says_so(owner: Somebody, walk_files: Files) -> None:
    assert owner.get(f"/api/recordings/{begun(owner)}/sensors").status_code == 409
    nothing = sent(owner, {"notes.txt": b"hello"})
    answer = owner.get(f"{nothing}/sensors")
    assert answer.status_code == 409
    assert "of no known log" in answer.json()["detail"]
    damaged = sent(owner, {**walk_files, "gyroscope.csv": b"t_s,x,y,z\n0,1,2,what\n"})
    answer = owner.get(f"{damaged}/sensors")
    assert answer.status_code == 409
    assert answer.json()["detail"].startswith("gyroscope.csv: row 2")
    assert list(owner.services.settings.work_folder.iterdir()) == []
