"""A map of the owner's, its walkers, a broker of our own, and a receiver of webhooks."""

import json
import shutil
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.positions.values import LivePosition
from elfslam.serve.store.tables import now_utc
from studies.benchmarks.served import free_port
from tests.serve.conftest import Somebody
from tests.waiting import until

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
WALK = "0123456789abcdef"


@pytest.fixture
def map_id(owner: Somebody) -> str:
    """A map of the owner's."""
    return owner.put_map()


Message = Callable[..., dict[str, Any]]


@pytest.fixture
def message(map_id: str) -> Message:
    """What a phone sends: a fix at (1, 2), unless told otherwise."""

    def made(**more: Any) -> dict[str, Any]:
        outer = {name: more.pop(name) for name in ("map", "walk", "is_over") if name in more}
        fix = {"status": "OK", "x_m": 1.0, "y_m": 2.0, "heading_rad": 0.5, "sigma_m": 0.2, **more}
        return {"map": map_id, "walk": WALK, "positions": [fix], **outer}

    return made


def position(**more: Any) -> LivePosition:
    """Somebody's position in a map."""
    told: dict[str, Any] = {
        "map": "a" * 32, "walker": "b" * 32, "name": "Ada", "walk": WALK, "status": "OK",
        "time_utc": now_utc(), "x_m": 1.0, "y_m": 2.0,
    }  # fmt: skip
    return LivePosition(**{**told, **more})


@dataclass
class OwnBroker:
    """A mosquitto process."""

    folder: Path
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[bytes] | None = None

    def start(self, *more: str) -> None:
        """Start it, or start it again on the same port."""
        lines = ["user root", "persistence false", f"listener {self.port} 127.0.0.1", *more]
        if not any(line.startswith("allow_anonymous") for line in more):
            lines.append("allow_anonymous true")
        config = self.folder / "mosquitto.conf"
        config.write_text("\n".join(lines) + "\n")
        assert MOSQUITTO is not None
        log = (self.folder / "log").open("ab")
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(config)], stdout=log, stderr=log)
        log.close()
        until(self._listens, "the broker")

    def stop(self) -> None:
        """End it."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def _listens(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, (self.folder / "log").read_text()
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[OwnBroker]:
    """A broker that does not run yet; skips the test where there is none."""
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed (Debian: apt-get install mosquitto)")
    folder = tmp_path / "mosquitto"
    folder.mkdir()
    broker = OwnBroker(folder)
    yield broker
    broker.stop()


@dataclass
class Receiver:
    """A little HTTP server that takes webhooks, and answers as it is told."""

    url: str = ""
    statuses: list[int] = field(default_factory=list)
    got: list[tuple[str, dict[str, str], bytes]] = field(default_factory=list)

    @property
    def positions(self) -> list[dict[str, Any]]:
        """All that came, in the order in which it came."""
        return [each for _, _, body in self.got for each in json.loads(body)["positions"]]


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    """Listens on loopback; answers 204 unless `statuses` says otherwise, one after the other."""
    told = Receiver()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            told.got.append((self.path, dict(self.headers), body))
            self.send_response(told.statuses.pop(0) if told.statuses else 204)
            self.send_header("Location", "http://127.0.0.1:9/elsewhere")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with serving(Handler) as told.url:
        yield told


@contextmanager
def serving(handler: type[BaseHTTPRequestHandler]) -> Iterator[str]:
    """A server of requests on loopback, as a URL."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/positions"
    server.shutdown()
    thread.join()
    server.server_close()
