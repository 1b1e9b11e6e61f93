"""A real server in a process of its own, and what benchmarks ask of it."""

from __future__ import annotations

import base64
import hashlib
import ssl
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np

from elfslam.base.values import Audio, Imu, Recording
from elfslam.data.recordings import write_recording

START = """
import sys; from pathlib import Path
from elfslam.serve.network.running import Listening, run
from elfslam.serve.settings import ServerSettings
settings = ServerSettings(Path(sys.argv[1]), run_jobs=sys.argv[3] == "jobs")
run(settings, Listening("127.0.0.1", 0, plain_http=sys.argv[2] == "http"), print)
"""
TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}
PATIENCE_S = 120.0


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


def start(data: Path, *, speaks: str = "http", jobs: bool = False) -> Served:
    """A server of a data folder, once it listens."""
    told = data / "authority" / "url"
    told.unlink(missing_ok=True)
    command = [sys.executable, "-c", START, str(data), speaks, "jobs" if jobs else "none"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    until_s = time.monotonic() + PATIENCE_S
    while not told.is_file():
        if process.poll() is not None or time.monotonic() > until_s:
            raise SystemExit("the server does not start")
        time.sleep(0.01)
    token = (data / "authority" / "owner.token").read_text().strip()
    return Served(process, told.read_text().strip(), token, data)


def metadata(**told: str) -> str:
    """Names and texts as Upload-Metadata."""
    coded = {name: base64.b64encode(text.encode()).decode() for name, text in told.items()}
    return ",".join(f"{name} {text}" for name, text in coded.items())


def walk_files(folder: Path, seconds: float, seed: int = 0) -> dict[str, bytes]:
    """The files of a recording of noise, by name; kept in a folder for the next time."""
    if not folder.is_dir():
        generator = np.random.default_rng(seed)
        t_s = np.arange(round(50 * seconds)) / 50
        turning = generator.normal(0, 0.1, (len(t_s), 3))
        imu = Imu(t_s, generator.normal([0, 0, 9.8], 0.1, (len(t_s), 3)), turning)
        noise = generator.uniform(-0.1, 0.1, (1, round(44_100 * seconds)))
        sound = Audio(noise.astype(np.float32), 44_100)
        write_recording(Recording(name="noise", device="none", audio=sound, imu=imu), folder)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def completion(files: dict[str, bytes]) -> dict[str, object]:
    """What a client says when all of a recording should have come."""
    rows = [
        {"name": name, "size_bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in files.items()
    ]
    return {"files": rows, "map": True}
