"""A real server in a process of its own, for benchmarks and tests, and what they ask of it."""

import base64
import json
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from elfslam.serve.settings import PAGES_FOLDER

NO_LIMITS: Mapping[str, float] = {}
START = """
import json, sys; from pathlib import Path
from elfslam.serve.network.running import Listening, run
from elfslam.serve.settings import Limits, ServerSettings
told = json.loads(sys.argv[1])
settings = ServerSettings(
    Path(told["data"]), told["database"], run_jobs=told["jobs"], limits=Limits(**told["limits"]),
    pages_folder=Path(told["pages"]),
)
run(settings, Listening("127.0.0.1", told["port"], plain_http=told["speaks"] == "http"), print)
"""
COMMAND = (sys.executable, "-c", "from elfslam.cli import main; main()", "serve", "--http")
TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}
PATIENCE_S = 180.0


@dataclass(frozen=True)
class Served:
    """A server that runs."""

    process: subprocess.Popen[bytes]
    url: str
    token: str
    data: Path

    @property
    def bearer(self) -> dict[str, str]:
        """The owner's header."""
        return {"Authorization": f"Bearer {self.token}"}

    @property
    def trusted(self) -> ssl.SSLContext | bool:
        """What a client of it has to trust."""
        authority = self.data / "authority" / "authority.pem"
        secure = self.url.startswith("https")
        return ssl.create_default_context(cafile=str(authority)) if secure else True

    def client(self) -> httpx.Client:
        """The owner's client."""
        return httpx.Client(
            base_url=self.url, headers=self.bearer, verify=self.trusted, timeout=PATIENCE_S
        )

    def kill(self) -> None:
        """End it as `kill -9` does."""
        self.process.kill()
        self.process.wait()


def command(
    data: Path,
    *,
    speaks: str = "http",
    jobs: bool = False,
    database: str = "",
    port: int = 0,
    pages: Path = PAGES_FOLDER,
    limits: Mapping[str, float] = NO_LIMITS,
) -> list[str]:
    """What runs a server of a data folder."""
    told = {"data": str(data), "speaks": speaks, "jobs": jobs, "database": database,
            "port": port, "pages": str(pages), "limits": {**limits}}  # fmt: skip
    return [sys.executable, "-c", START, json.dumps(told)]


def start(data: Path, **how: Any) -> Served:
    """A server of a data folder, as `command` has it, once it listens."""
    told = data / "authority" / "url"
    told.unlink(missing_ok=True)
    process = subprocess.Popen(command(data, **how), stdout=subprocess.DEVNULL)
    until_s = time.monotonic() + PATIENCE_S
    while not told.is_file():
        if process.poll() is not None or time.monotonic() > until_s:
            process.kill()
            raise SystemExit("the server does not start")
        time.sleep(0.01)
    token = (data / "authority" / "owner.token").read_text().strip()
    return Served(process, told.read_text().strip(), token, data)


@contextmanager
def serving(data: Path, *options: str, program: Sequence[str] = COMMAND) -> Iterator[str]:
    """`elfslam serve` on plain HTTP as long as the block lasts; gives the address that pairs."""
    arguments = [*program, "--port", "0", "--data", str(data), *options]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            if not address.startswith("http://127.0.0.1:"):
                raise RuntimeError(f"the server does not start: {address!r}")
            yield address
        finally:
            server.terminate()


def owner_of(address: str) -> httpx.Client:
    """The owner's client of a server, by the address that pairs."""
    url, token = address.partition("&")[0].split("/#token=")
    return httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=60)


def free_port() -> int:
    """A port of loopback on which nobody listens."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def metadata(**told: str) -> str:
    """Names and texts as Upload-Metadata."""
    coded = {name: base64.b64encode(text.encode()).decode() for name, text in told.items()}
    return ",".join(f"{name} {text}" for name, text in coded.items())
