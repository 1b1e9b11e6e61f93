"""Databases with changed bytes: refused in one line, or as good as they were; no file is gone."""

from __future__ import annotations

import os
import random
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, core, given, settings
from hypothesis import strategies as st
from starlette.testclient import TestClient

from elfslam.base.errors import StoreError
from elfslam.serve.app import create_app
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.database import transaction
from elfslam.serve.store.opening import alone_with, files_of
from elfslam.serve.store.tables import Job, Map, Recording, RecordingFile, Upload

pytestmark = pytest.mark.hostile
CASES = int(os.environ.get("HOSTILE_CASES", "200"))
ROUTES = ("me", "users", "recordings", "uploads", "jobs", "maps")
DAMAGES = ("text", "bytes", "zeros", "cut", "page", "header", "longer")
SQLITE = "elfslam.sqlite"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with a row of every kind, at rest."""
    given_settings = ServerSettings(tmp_path_factory.mktemp("whole") / "data", run_jobs=False)
    with alone_with(given_settings):
        services = open_services(given_settings, alone=True)
    user = set_owner_token(services, "token")
    file = given_settings.work_folder / "content"
    file.write_bytes(b"a walk")
    blob = put(given_settings.blobs_folder, file)
    file.unlink()
    with transaction(services.sessions) as session:
        for number in range(30):
            facts: dict[str, Any] = {"duration_s": 12.5, "bytes": number}
            walk = Recording(user_id=user.id, name=f"walk {number}", state="ready", facts=facts)
            session.add(walk)
            session.flush()
            session.add(
                RecordingFile(
                    recording_id=walk.id, name="f", sha256=blob.sha256, size_bytes=blob.size_bytes
                )
            )
            session.add(Job(user_id=user.id, kind="map", given={"recording": walk.id}))
            session.add(Map(user_id=user.id, name="Hall", kind="run", sources=[walk.id]))
            session.add(Upload(user_id=user.id, recording_id=walk.id, file_name="wifi.csv"))
    services.engine.dispose()
    return given_settings.data_folder


def damaged(content: bytes, kind: str, seed: int) -> bytes:
    """The content of a database file, changed in one way."""
    changed, generator = bytearray(content), random.Random(seed)
    at = generator.randrange(len(changed))
    if kind == "cut":
        return content[:at]
    if kind == "longer":
        return content + generator.randbytes(at)
    if kind == "header":
        changed[generator.randrange(100)] = generator.randrange(256)
    elif kind == "page":
        start = at // 4096 * 4096
        changed[start : start + 4096] = generator.randbytes(4096)
    elif kind == "zeros":
        changed[at : at + 200] = bytes(200)
    elif kind == "bytes":
        for _ in range(generator.randint(1, 300)):
            changed[generator.randrange(len(changed))] = generator.randrange(256)
    else:
        words = (b"walk ", b"duration_s", b"2026-", b"ready", b'["', b'{"recording"', b"map")
        found = changed.find(generator.choice(words), at)
        changed[found : found + 2] = b"\xff\xfe"
    return bytes(changed)


@settings(
    max_examples=max(10, CASES // 4),
    deadline=None,
    derandomize=core.global_force_seed is None,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@given(kind=st.sampled_from(DAMAGES), seed=st.integers(0, 2**32))
def test_a_damaged_database(whole: Path, kind: str, seed: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "data"
        shutil.copytree(whole, folder)
        for left in folder.glob(f"{SQLITE}-*"):
            left.unlink()
        file = folder / SQLITE
        file.write_bytes(damaged(file.read_bytes(), kind, seed))
        store = ServerSettings(folder, run_jobs=False)
        before, said = files_of(store), ""
        try:
            with alone_with(store):
                services = open_services(store, alone=True)
        except StoreError as error:
            said = str(error)
        else:
            answers_honestly(services)
        assert "\n" not in said
        assert files_of(store) == before


def answers_honestly(services: Any) -> None:
    """A store that opens answers, or says that its database is damaged."""
    client = TestClient(
        create_app(services), base_url="http://127.0.0.1", client=("127.0.0.1", 1),
        headers={"Authorization": "Bearer token"}, raise_server_exceptions=False,
    )  # fmt: skip
    for route in ROUTES:
        answer = client.get(f"/api/{route}")
        assert answer.status_code < 500 or answer.status_code == 503, answer.text
    services.engine.dispose()
