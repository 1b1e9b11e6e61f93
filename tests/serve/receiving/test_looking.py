"""What is told and sent of a recording's sensors, and to whom."""

from __future__ import annotations

import base64
import io
import zipfile

import pytest
from starlette.testclient import TestClient

from elfslam.serve.services import Services

PIECE = {"Tus-Resumable": "1.0.0", "Content-Type": "application/offset+octet-stream"}


@pytest.fixture
def kept(owner: TestClient, walk_files: dict[str, bytes]) -> str:
    """The address of a small recording with sound and motion."""
    return sent(owner, walk_files)


def sent(client: TestClient, files: dict[str, bytes]) -> str:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    pairs = {"filename": b"walk.zip", "map": b"false"}
    told = ",".join(f"{name} {base64.b64encode(text).decode()}" for name, text in pairs.items())
    headers = {**PIECE, "Upload-Metadata": told, "Upload-Length": str(len(content.getvalue()))}
    made = client.post("/api/uploads", headers=headers, content=content.getvalue())
    return f"/api/recordings/{made.headers['elfslam-recording']}"


def test_curves_and_rates_are_told(owner: TestClient, kept: str) -> None:
    answer = owner.get(f"{kept}/sensors")
    assert answer.status_code == 200
    told = answer.json()
    assert [each["name"] for each in told["sensors"]] == ["audio", "imu"]
    assert told["sensors"][1]["rate_hz"] == 50.0
    assert {"acceleration", "sound level"} <= {each["name"] for each in told["curves"]}


def test_what_did_not_change_is_not_read_again(
    owner: TestClient, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tag = owner.get(f"{kept}/sensors").headers["etag"]
    monkeypatch.setattr("elfslam.serve.receiving.looking.READER", "elfslam.no_such_reader")
    again = owner.get(f"{kept}/sensors", headers={"If-None-Match": tag})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
    assert owner.get(f"{kept}/sensors").status_code == 503


def test_each_file_comes_as_it_was(
    owner: TestClient, kept: str, walk_files: dict[str, bytes]
) -> None:
    for name, data in walk_files.items():
        answer = owner.get(f"{kept}/files/{name}")
        assert (answer.status_code, answer.content) == (200, data)
        assert "attachment" in answer.headers["content-disposition"]
    assert answer.headers["x-content-type-options"] == "nosniff"
    table = owner.get(f"{kept}/files/accelerometer.csv")
    assert table.headers["content-type"].startswith("text/csv")


@pytest.mark.parametrize("name", ["wifi.csv", "..%2Faudio.flac", "recording.json%00", "x" * 300])
def test_what_is_no_file_of_it_is_not_found(owner: TestClient, kept: str, name: str) -> None:
    assert owner.get(f"{kept}/files/{name}").status_code == 404


def test_nobody_else_sees_any_of_it(guest: TestClient, kept: str) -> None:
    assert guest.get(f"{kept}/sensors").status_code == 404
    assert guest.get(f"{kept}/files/accelerometer.csv").status_code == 404


def test_what_is_not_there_yet_or_was_refused_says_so(
    owner: TestClient, services: Services, walk_files: dict[str, bytes]
) -> None:
    begun = owner.post("/api/recordings", json={"name": "walk"}).json()["id"]
    assert owner.get(f"/api/recordings/{begun}/sensors").status_code == 409
    nothing = sent(owner, {"notes.txt": b"hello"})
    answer = owner.get(f"{nothing}/sensors")
    assert answer.status_code == 409
    assert "of no known log" in answer.json()["detail"]
    damaged = sent(owner, {**walk_files, "gyroscope.csv": b"t_s,x,y,z\n0,1,2,what\n"})
    answer = owner.get(f"{damaged}/sensors")
    assert answer.status_code == 409
    assert answer.json()["detail"].startswith("gyroscope.csv: row 2")
    assert list(services.settings.work_folder.iterdir()) == []
