"""A disk that fills: nothing acknowledged is lost, and it goes on when there is room."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from elfslam.serve.app import create_app
from elfslam.serve.people.access import new_token
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import open_services
from elfslam.serve.settings import Limits, ServerSettings
from tests.disks import mounted

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}
SIZE = 8 * 2**20


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 8 MiB; skips the test where none may be made."""
    with mounted(tmp_path / "disk", size=SIZE) as place:
        yield place


@pytest.fixture
def client(small_disk: Path, settings: ServerSettings) -> Iterator[TestClient]:
    limits = Limits(free_bytes=0)
    app = create_app(
        open_services(replace(settings, data_folder=small_disk / "data", limits=limits))
    )
    token = new_token()
    set_owner_token(app.state.services, token)
    mine = {"Authorization": f"Bearer {token}"}
    with TestClient(
        app, client=("127.0.0.1", 1), base_url="http://127.0.0.1", headers=mine
    ) as running:
        yield running


def begun(client: TestClient, length: int | None) -> tuple[int, str]:
    made = client.post("/api/recordings", json={"name": "walk"}).json()["id"]
    pairs = {"recording": made, "filename": "wifi.csv"}
    told = ",".join(f"{k} {base64.b64encode(v.encode()).decode()}" for k, v in pairs.items())
    known = {"Upload-Defer-Length": "1"} if length is None else {"Upload-Length": str(length)}
    answer = client.post("/api/uploads", headers={**TUS, "Upload-Metadata": told, **known})
    return answer.status_code, answer.headers.get("location", "")


def fill(file: Path) -> None:
    """Write until nothing more fits."""
    with file.open("wb", buffering=0) as stream:
        while True:
            stream.write(bytes(4096))


def test_what_cannot_fit_is_refused_before_it_comes(client: TestClient) -> None:
    assert begun(client, SIZE)[0] == 507
    assert list(client.get("/api/recordings").json()[0]["uploads"]) == []


def test_a_disk_that_fills_loses_nothing(client: TestClient, small_disk: Path) -> None:
    _, place = begun(client, None)
    filler, data = small_disk / "filler", bytes(range(256)) * 4096
    first = client.patch(place, headers={**PIECE, "Upload-Offset": "0"}, content=data)
    assert first.status_code == 204
    with pytest.raises(OSError, match="No space"):
        fill(filler)
    sent = {**PIECE, "Upload-Offset": str(len(data))}
    answer = client.patch(place, headers=sent, content=data)
    assert answer.status_code == 507
    assert "kept" in answer.json()["detail"]
    assert client.head(place, headers=TUS).headers["upload-offset"] == str(len(data))
    assert client.post("/api/recordings", json={"name": "no room" * 9}).status_code in (201, 507)
    filler.unlink()
    assert client.patch(place, headers=sent, content=data).status_code == 204
    kept = small_disk / "data" / "uploads" / place.rpartition("/")[2]
    assert kept.read_bytes() == data + data


def test_a_piece_that_fits_by_half_is_kept_by_half(client: TestClient, small_disk: Path) -> None:
    """The length was not known before: the disk fills while the piece is written."""
    _, place = begun(client, None)

    def pieces() -> Iterator[bytes]:
        for _ in range(12):
            yield bytes(2**20)

    sent = {**PIECE, "Upload-Offset": "0"}
    assert client.patch(place, headers=sent, content=pieces()).status_code == 507
    kept = small_disk / "data" / "uploads" / place.rpartition("/")[2]
    offset = int(client.head(place, headers=TUS).headers["upload-offset"])
    assert offset == kept.stat().st_size
