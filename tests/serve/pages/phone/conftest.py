"""A browser with a microphone that hears a file, motion that is planted, and a real server."""

import importlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import soundfile

from elfslam.stages.chirp import ChirpParameters, make_chirp
from tests.serve.conftest import Json
from tests.serve.pages.conftest import ARGUMENTS, CHROMIUM, PHONE, Pocket
from tests.serve.uploading import unzipped
from tests.waiting import until

FAKE = ("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream")
PERMISSIONS = ("microphone", "accelerometer", "gyroscope", "screen-wake-lock")
SENSORS = ("accelerometer", "gyroscope", "linear-acceleration")
SERVE = "from elfslam.cli import main; main()"
FAKE_MICROPHONE_HZ = 44_100
HEARD_S = 10.0
"""The fake microphone plays its file again and again; whole periods, so the beat goes on."""
ACCELERATION_MPS2 = (0.3, 1.2, 9.7)
TURNING_RADPS = (0.1, -0.2, 0.3)
PATIENCE_S = 40.0


@cache
def room_sound(rate_hz: int, duration_s: float) -> np.ndarray:
    """Sound of chirps every 100 ms with echoes and noise, the first direct arrival after 43 ms."""
    chirp = make_chirp(ChirpParameters(), rate_hz).samples
    generator = np.random.default_rng(7)
    sound = 1e-4 * generator.standard_normal(round(duration_s * rate_hz))
    direct = 0.043 * rate_hz + np.arange(int(duration_s * 10 - 0.99)) * 0.1 * rate_hz
    for start in np.round(direct).astype(int):
        sound[start : start + len(chirp)] += 0.15 * chirp
        for delay_s, gain in ((0.004, 0.02), (0.0093, 0.05), (0.021, 0.012), (0.037, 0.004)):
            echo = start + round(delay_s * rate_hz)
            sound[echo : echo + len(chirp)] += gain * generator.uniform(0.5, 1.0) * chirp
    return np.asarray(sound, dtype=np.float32)


@pytest.fixture(scope="session")
def benchmark() -> Callable[[str], Any]:
    """A benchmark by name, which has the long form; skips where a program of it is missing."""

    def found(name: str) -> Any:
        pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
        made = importlib.import_module(f"studies.benchmarks.{name}")
        if absent := made.missing_programs() + ([] if made.CHROMIUM else ["chromium"]):
            need = "apt-get install pulseaudio pulseaudio-utils chromium"
            pytest.skip(f"{', '.join(absent)} is missing: {need}")
        return made

    return found


@pytest.fixture(scope="session")
def heard(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """What the fake microphone hears: its file, and the 16-bit samples in it."""
    file = tmp_path_factory.mktemp("microphone") / "heard.wav"
    sound = room_sound(FAKE_MICROPHONE_HZ, HEARD_S)
    last = round((0.043 + 9.9) * FAKE_MICROPHONE_HZ)
    whole = sound.copy()
    whole[last : last + 441] += 0.15 * make_chirp(ChirpParameters(), FAKE_MICROPHONE_HZ).samples
    soundfile.write(file, whole, FAKE_MICROPHONE_HZ, subtype="PCM_16")
    return file, soundfile.read(file, dtype="int16")[0]


@dataclass
class Server:
    """A server process of its own, on plain HTTP."""

    data: Path
    address: str = ""
    process: subprocess.Popen[str] | None = None
    options: tuple[str, ...] = ("--no-jobs",)
    code: str = SERVE

    def start(self, port: str = "0") -> None:
        """Start it, or start it again on the port that it had."""
        command = [sys.executable, "-c", self.code, "serve", "--http", "--port", port]
        self.process = subprocess.Popen(
            [*command, "--data", str(self.data), *self.options], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        assert self.address.startswith("http://127.0.0.1:"), self.address

    def stop(self) -> None:
        """Stop it, if it runs."""
        if self.process is not None:
            self.process.kill()
            self.process.wait(20)
            assert self.process.stdout is not None
            self.process.stdout.close()
            self.process = None

    @property
    def port(self) -> str:
        """Where it listens."""
        return self.address.split("#")[0].rstrip("/").rpartition(":")[2]

    def ask(self, path: str, method: str = "GET", **more: Any) -> httpx.Response:
        """What it answers its owner."""
        url, token = self.address.partition("&")[0].split("#token=")
        headers = {**more.pop("headers", {}), "Authorization": f"Bearer {token}"}
        whole = url.rstrip("/") + path
        answer = httpx.request(method, whole, headers=headers, timeout=30, **more)
        return answer.raise_for_status()

    def recordings(self) -> list[dict[str, Any]]:
        """All that it has."""
        return list(self.ask("/api/recordings").json())

    def download(self, recording: str, folder: Path) -> Path:
        """A recording as a folder."""
        folder.mkdir()
        packed = self.ask(f"/api/recordings/{recording}/recording.zip").content
        for name, content in unzipped(packed).items():
            (folder / name).write_bytes(content)
        return folder


@pytest.fixture(scope="module")
def running_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A real server that makes no maps."""
    running = Server(tmp_path_factory.mktemp("server") / "data")
    running.start()
    yield running
    running.stop()


@pytest.fixture
def server(running_server: Server) -> Iterator[Server]:
    """That server, without recordings."""
    yield running_server
    for told in running_server.recordings():
        running_server.ask(f"/api/recordings/{told['id']}", "DELETE")


@dataclass
class Phone:
    """The page in a browser, as a walker uses it."""

    page: Any
    sensors: Any
    server: Server
    scratch: Path
    problems: list[str] = field(default_factory=list)

    def open(self) -> None:
        """Open the address of the QR code."""
        self.page.goto(self.server.address)

    def open_again(self) -> None:
        """Open the page as who is paired already."""
        self.page.goto(self.server.address.split("#")[0])

    def move(self) -> None:
        """Plant what the motion sensors read."""
        about = {"available": True, "minimumFrequency": 1, "maximumFrequency": 100}
        for kind in SENSORS:
            given = {"enabled": True, "type": kind, "metadata": about}
            self.sensors.send("Emulation.setSensorOverrideEnabled", given)
        readings = (ACCELERATION_MPS2, TURNING_RADPS, (0.0, 0.0, 0.0))
        for kind, values in zip(SENSORS, readings, strict=True):
            xyz = dict(zip("xyz", values, strict=True))
            given = {"type": kind, "reading": {"xyz": xyz}}
            self.sensors.send("Emulation.setSensorOverrideReadings", given)

    def allow(self) -> str:
        """Tap, wait for the probe; gives what it says of the phone."""
        self.page.click("#allow")
        self.page.wait_for_selector("#checks li", timeout=1000 * PATIENCE_S)
        return str(self.page.inner_text("#probe-said"))

    def check_again(self) -> str:
        """Tap, wait for the probe; gives what it says of the phone."""
        self.page.click("#probe-again")
        self.page.wait_for_selector("#checks li:visible", timeout=1000 * PATIENCE_S)
        return str(self.page.inner_text("#probe-said"))

    def start(self, name: str = "Test walk") -> None:
        """Name the walk and start it."""
        self.page.click("#go-on")
        self.page.fill("#walk-name", name)
        self.page.click("text=Start walking")
        self.wait_for(lambda: self.page.is_visible("#stop"), "the walk begins")

    def begin(self, name: str = "Test walk") -> None:
        """From the code to a walk that is being recorded."""
        self.open()
        self.move()
        self.allow()
        self.start(name)

    def finish(self) -> tuple[Path, Json]:
        """Stop the walk and fetch it."""
        self.page.click("#stop")
        self.wait_for_text("#finish-said", "map is being made")
        return self.fetch()

    def fetch(self) -> tuple[Path, Json]:
        """The one walk that the server has: its folder, and what is told of it."""
        (told,) = self.server.recordings()
        assert told["state"] == "ready"
        return self.server.download(told["id"], self.scratch / "fetched"), told

    def text(self, selector: str) -> str:
        """What is written there."""
        return str(self.page.inner_text(selector))

    def walk(self, seconds: float) -> None:
        """Walk on."""
        self.page.wait_for_timeout(1000 * seconds)

    def record(self, chirps: int) -> None:
        """Walk on until so many more chirps are recorded."""
        self.wait_for(lambda: self._chirps() >= 0, "the walk begins")
        enough = self._chirps() + chirps
        self.wait_for(lambda: self._chirps() >= enough, f"{chirps} chirps are recorded")

    def _chirps(self) -> int:
        return int(self.page.get_attribute("#heard", "data-chirps") or -1)

    def wait_for(self, happened: Callable[[], bool], what: str) -> None:
        """Wait until something has happened. The pages allow no evaluated text, so we ask."""
        pause = partial(self.page.wait_for_timeout, 100)
        try:
            until(happened, what, patience_s=PATIENCE_S, between=pause)
        except TimeoutError as error:
            raise TimeoutError(f"{error}; the page says {self.text('main')}") from error

    def wait_for_text(self, selector: str, part: str) -> None:
        """Wait until something is written there."""
        self.wait_for(lambda: part in self.text(selector), f"{selector} says {part!r}")


def regular_chirps(route: Any) -> None:
    """The fake microphone chirps once per period, whatever the page plays: so must the page."""
    from playwright.sync_api import Error

    with suppress(Error):  # a page that was closed meanwhile waits for nothing
        answer = route.fetch()
        told = answer.json()
        told["medium_access"] |= {"jitter_s": 0, "forget": 0, "listen": 0, "check_alone": 0}
        route.fulfill(response=answer, json=told)


@pytest.fixture
def locale() -> str:
    """What the phone's owner speaks."""
    return "en-US"


@pytest.fixture(scope="module")
def hears(heard: tuple[Path, np.ndarray]) -> dict[str, Any]:
    """How a browser is started whose microphone hears the file."""
    file = f"--use-file-for-fake-audio-capture={heard[0]}"
    return {"args": [*ARGUMENTS, *FAKE, file], "ignore_default_args": ["--mute-audio"]}


@pytest.fixture(scope="module")
def browser(play: Any, hears: dict[str, Any]) -> Iterator[Any]:
    """A browser whose microphone hears the file."""
    started = play.chromium.launch(executable_path=CHROMIUM, **hears)
    yield started
    started.close()


@pytest.fixture
def phone(server: Server, browser: Any, locale: str, tmp_path: Path) -> Iterator[Phone]:
    """A phone that was just handed over; whatever its page throws fails the test."""
    context = browser.new_context(
        locale=locale,
        permissions=list(PERMISSIONS),
        viewport=PHONE,
        has_touch=True,
        reduced_motion="reduce",
    )
    page = context.new_page()
    page.route("**/api/version", regular_chirps)
    handed = Phone(page, context.new_cdp_session(page), server, tmp_path)
    page.on("pageerror", lambda error: handed.problems.append(str(error)))
    page.on("dialog", lambda dialog: dialog.accept())
    yield handed
    context.close()
    assert handed.problems == []


@pytest.fixture
def pocket(play: Any, tmp_path: Path, hears: dict[str, Any]) -> Iterator[Pocket]:
    """A phone that keeps what it keeps; whatever its page throws fails the test."""
    more = {"permissions": list(PERMISSIONS), "reduced_motion": "reduce", "accept_downloads": True}
    handed = Pocket(play, tmp_path / "profile", hears | more)
    yield handed
    assert handed.problems == []
