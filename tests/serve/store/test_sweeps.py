"""What is cleared away: leftovers of a kill, and uploads that were abandoned."""

from __future__ import annotations

import base64
import os
from datetime import UTC, datetime, timedelta

import pytest
from starlette.testclient import TestClient

from elfslam.base.errors import StoreError
from elfslam.serve.app import create_app
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.sweeps import expire_uploads, sweep

pytestmark = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)

TUS = {"Tus-Resumable": "1.0.0"}


def begun(client: TestClient) -> str:
    made = client.post("/api/recordings", json={"name": "walk"}).json()["id"]
    told = [
        f"{k} {base64.b64encode(v.encode()).decode()}"
        for k, v in {"recording": made, "filename": "wifi.csv"}.items()
    ]
    headers = {**TUS, "Upload-Metadata": ",".join(told), "Upload-Length": "9"}
    place = client.post("/api/uploads", headers=headers).headers["location"]
    return str(place).rpartition("/")[2]


def test_leftovers_of_a_kill_go_and_uploads_stay(owner: TestClient, services: Services) -> None:
    upload, settings = begun(owner), services.settings
    (settings.uploads_folder / ("0" * 32)).write_bytes(b"no row")
    (settings.uploads_folder / f"{upload}.piece").write_bytes(b"unchecked")
    (settings.work_folder / "reading-00").mkdir()
    put(settings.blobs_folder, settings.uploads_folder / ("0" * 32))
    sweep(services)
    assert [file.name for file in settings.uploads_folder.iterdir()] == [upload]
    assert list(settings.work_folder.iterdir()) == []
    assert list(settings.blobs_folder.glob("*/*")) == []


def test_abandoned_uploads_expire(owner: TestClient, services: Services) -> None:
    kept, left = begun(owner), begun(owner)
    old = datetime.now(UTC) - timedelta(days=services.settings.limits.upload_days + 1)
    os.utime(services.settings.uploads_folder / left, (old.timestamp(), old.timestamp()))
    with services.busy.alone([left]):
        assert expire_uploads(services, datetime.now(UTC)) == []
    assert expire_uploads(services, datetime.now(UTC)) == [left]
    assert owner.head(f"/api/uploads/{left}", headers=TUS).status_code == 404
    assert owner.head(f"/api/uploads/{kept}", headers=TUS).status_code == 200


def test_a_folder_has_one_server(settings: ServerSettings, owner: TestClient) -> None:
    with (
        pytest.raises(StoreError, match="another server"),
        TestClient(create_app(settings), client=("127.0.0.1", 1)),
    ):
        pass
