"""A real server process, killed without warning: whatever it worked on is done all the same."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from elfslam.serve.access import new_token
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.users import set_owner_token

Json = dict[str, Any]
SERVE = """
import sys
import uvicorn
from pathlib import Path
from elfslam.serve.app import create_app
from elfslam.serve.settings import ServerSettings
app = create_app(ServerSettings(Path(sys.argv[1]), secure_cookie=False))
uvicorn.run(app, host="127.0.0.1", port=int(sys.argv[2]), log_level="warning")
"""
PATIENCE_S = 120.0
DATED = {"run.json", "timings.json", "report.html"}


@dataclass
class Server:
    """A server of a data folder, started again and again."""

    folder: Path
    token: str
    port: int

    @contextmanager
    def running(self) -> Iterator[tuple[subprocess.Popen[bytes], httpx.Client]]:
        """The process, and a client of its owner; killed at the end if it still runs."""
        process = subprocess.Popen([sys.executable, "-c", SERVE, str(self.folder), str(self.port)])
        base = f"http://127.0.0.1:{self.port}"
        header = {"Authorization": f"Bearer {self.token}"}
        try:
            with httpx.Client(base_url=base, headers=header, timeout=60) as client:
                until(lambda: answers(client))
                yield process, client
        finally:
            process.kill()
            process.wait()


@pytest.fixture
def server(tmp_path: Path) -> Server:
    folder, token = tmp_path / "data", new_token()
    services = open_services(ServerSettings(folder))
    set_owner_token(services, token)
    services.engine.dispose()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    return Server(folder, token, port)


def answers(client: httpx.Client) -> bool:
    try:
        return client.get("/api/version").status_code == 200
    except httpx.TransportError:
        return False


def until(true: Callable[[], bool]) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < until_s
        time.sleep(0.05)


def ended(client: httpx.Client, job_id: str) -> Json:
    def has_ended() -> bool:
        return job()["state"] not in ("queued", "running")

    def job() -> Json:
        answer: Json = client.get(f"/api/jobs/{job_id}").json()
        return answer

    until(has_ended)
    return job()


def upload(client: httpx.Client, packed: bytes) -> str:
    """A whole recording as a .zip by tus; the id of the recording."""
    metadata = "filename d2Fsay56aXA="  # walk.zip
    created = client.post(
        "/api/uploads",
        headers={
            "Tus-Resumable": "1.0.0",
            "Upload-Length": str(len(packed)),
            "Upload-Metadata": metadata,
        },
    )
    assert created.status_code == 201, created.text
    where, tus = created.headers["Location"], {"Tus-Resumable": "1.0.0"}
    sent = client.patch(
        where,
        content=packed,
        headers={
            **tus,
            "Upload-Offset": "0",
            "Content-Type": "application/offset+octet-stream",
        },
    )
    assert sent.status_code == 204, sent.text
    return client.head(where, headers=tus).headers["Elfslam-Recording"]
