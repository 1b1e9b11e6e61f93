"""What one user may cost: bytes, counts, and the time and memory of reading."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from starlette.testclient import TestClient

from elfslam.serve.app import create_app
from elfslam.serve.parsing.children import Children
from elfslam.serve.people.access import new_token
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.problems import Problem
from elfslam.serve.receiving.reader import read_apart
from elfslam.serve.services import open_services
from elfslam.serve.settings import Limits, ServerSettings

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}
Limited = Callable[..., TestClient]


@pytest.fixture
def limited(settings: ServerSettings) -> Iterator[Limited]:
    """Makes the client of an owner with these limits."""
    engines = []

    def make(**limits: int) -> TestClient:
        app, token = (
            create_app(open_services(replace(settings, limits=Limits(**limits)))),
            new_token(),
        )
        engines.append(app.state.services.engine)
        set_owner_token(app.state.services, token)
        mine = {"Authorization": f"Bearer {token}"}
        return TestClient(app, client=("127.0.0.1", 1), base_url="http://127.0.0.1", headers=mine)

    yield make
    for engine in engines:
        engine.dispose()


def begun(client: TestClient) -> str:
    return str(client.post("/api/recordings", json={"name": "walk"}).json()["id"])


def upload(client: TestClient, walk: str, name: str = "wifi.csv", **length: str) -> tuple[int, str]:
    pairs = {"recording": walk, "filename": name}
    told = ",".join(f"{k} {base64.b64encode(v.encode()).decode()}" for k, v in pairs.items())
    headers = {**TUS, "Upload-Metadata": told, **(length or {"Upload-Defer-Length": "1"})}
    answer = client.post("/api/uploads", headers=headers)
    return answer.status_code, answer.headers.get("location", "")


def append(client: TestClient, place: str, offset: int, size: int) -> int:
    headers = {**PIECE, "Upload-Offset": str(offset)}
    return client.patch(place, headers=headers, content=bytes(size)).status_code


def test_a_file_has_a_size(limited: Limited) -> None:
    client = limited(file_bytes=1000)
    walk = begun(client)
    assert upload(client, walk, **{"Upload-Length": "1001"})[0] == 413
    _, place = upload(client, walk)
    assert append(client, place, 0, 900) == 204
    assert append(client, place, 900, 101) == 413
    assert append(client, place, 900, 100) == 204


def test_a_recording_has_a_size(limited: Limited) -> None:
    client = limited(recording_bytes=1000)
    walk = begun(client)
    first, second = upload(client, walk)[1], upload(client, walk, "emr.csv")[1]
    assert append(client, first, 0, 800) == 204
    assert append(client, second, 0, 300) == 413
    assert append(client, second, 0, 200) == 204
    assert append(client, upload(client, begun(client))[1], 0, 800) == 204


def test_a_user_has_a_size(limited: Limited) -> None:
    client = limited(user_bytes=1000)
    first, second = begun(client), begun(client)
    assert append(client, upload(client, first)[1], 0, 800) == 204
    assert upload(client, second, **{"Upload-Length": "300"})[0] == 413
    assert client.get("/api/me").json()["used_bytes"] == 800
    assert client.delete(f"/api/recordings/{first}").status_code == 204
    assert upload(client, second, **{"Upload-Length": "300"})[0] == 201


def test_counts_have_an_end(limited: Limited) -> None:
    client = limited(recordings=2, open_uploads=2, users=2)
    walk = begun(client)
    assert client.post("/api/recordings", json={"name": "w"}).status_code == 201
    assert client.post("/api/recordings", json={"name": "w"}).status_code == 409
    codes = [upload(client, walk, name)[0] for name in ("wifi.csv", "emr.csv", "audio.wav")]
    assert codes == [201, 201, 409]
    assert client.post("/api/users", json={"name": "a"}).status_code == 201
    assert client.post("/api/users", json={"name": "b"}).status_code == 409


def test_requests_that_are_no_uploads_are_small(limited: Limited) -> None:
    client = limited(request_bytes=100)
    assert client.post("/api/recordings", json={"name": "w" * 110}).status_code == 413
    pieces = (b'{"name": "', b"w" * 110, b'"}')
    sent = {"Content-Type": "application/json"}
    answer = client.post("/api/recordings", content=iter(pieces), headers=sent)
    assert answer.status_code == 413


def test_reading_has_an_end(tmp_path: Path) -> None:
    """Silence packs a thousandfold: a small file that becomes large when it is read."""
    (tmp_path / "recording.json").write_text('{"format_version": 1}')
    soundfile.write(tmp_path / "audio.flac", np.zeros(20 * 44_100), 44_100)
    assert (tmp_path / "audio.flac").stat().st_size < 20_000
    assert read_apart(Children(), tmp_path, Limits()).facts["duration_s"] == 20.0
    late = read_apart(Children(), tmp_path, Limits(reading_s=0.001))
    assert "takes longer than 0.001 s" in str(late.refusal)
    large = read_apart(Children(), tmp_path, Limits(reading_bytes=2**20))
    assert "needs more than 1 MB of memory" in str(large.refusal)


def test_a_reader_that_dies_is_no_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("elfslam.serve.receiving.reader.READER", "elfslam.no_such_reader:parse")
    with pytest.raises(Problem) as refused:
        read_apart(Children(), tmp_path, Limits())
    assert refused.value.status_code == 503
    assert "try again" in str(refused.value.detail)
