"""A real server process, planted maps, and a browser that forgives nothing."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.app.map import MapJob, map_into
from elfslam.app.settings import Settings
from elfslam.base.enums import Modality
from elfslam.data.recordings import write_recording
from elfslam.serve.people.users import add_user
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import transaction
from elfslam.serve.store.quota import delete_user
from elfslam.serve.store.tables import Job, JobKind, JobState, Map, Recording, RecordingState
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.served import serving
from tests.serve.planting import plant_files

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
PATIENCE_MS = 60_000
"""Only a test that fails waits for so long."""
CLOSURES = ((2, 20), (3, 21), (4, 22))
"""Planted into the map of a single walk."""


@dataclass
class Person:
    """Somebody with a token, and what is planted for them."""

    services: Services
    origin: str
    id: str
    token: str
    problems: list[str] = field(default_factory=list)

    @property
    def address(self) -> str:
        """What pairs a browser."""
        return f"{self.origin}/desk#token={self.token}"

    def plant_map(self, name: str, folder: Path, **more: Any) -> str:
        """A map as a job would have left it; gives its id."""
        return plant_files(
            self.services, Map(user_id=self.id, name=name, kind="run", **more), folder
        )

    def plant_recording(self, name: str, folder: Path, **more: Any) -> str:
        """A recording as if it had been uploaded; gives its id."""
        row = Recording(user_id=self.id, name=name, state=RecordingState.READY, **more)
        return plant_files(self.services, row, folder)

    def plant_job(self, kind: JobKind, state: JobState, **more: Any) -> str:
        """A job in any state; gives its id."""
        row = Job(user_id=self.id, kind=kind, state=state, **more)
        with transaction(self.services.sessions) as session:
            session.add(row)
        return row.id


@pytest.fixture(scope="session")
def walk_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of motion alone."""
    folder = tmp_path_factory.mktemp("walks") / "motion"
    recording, _ = simulate(load_world("studio"), 107, rounds=2, sound=False)
    write_recording(recording, folder)
    return folder


@pytest.fixture(scope="session")
def run_folder(walk_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its run."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    job = MapJob((Modality.MOTION,), None, "compact", Settings(), overwrite=False)
    map_into(folder, walk_folder, job, lambda *_: None)
    return folder


@pytest.fixture(scope="session")
def looped_folder(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run with three planted closures: good to look at, and no more."""
    folder = tmp_path_factory.mktemp("runs") / "looped"
    shutil.copytree(run_folder, folder)
    file = folder / "closures.csv"
    rows = [f"{i},{j},{i}.0,{j}.0,0.9,1,0,0,0" for i, j in CLOSURES]
    file.write_text("\n".join([file.read_text().splitlines()[0], *rows]) + "\n")
    return folder


@pytest.fixture(scope="session")
def floor_plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of 400 by 300 pixels: walls around, one across."""
    image = pytest.importorskip("PIL.Image")
    pixels = np.full((300, 400), 255, dtype=np.uint8)
    pixels[:6], pixels[-6:], pixels[:, :6], pixels[:, -6:], pixels[150:156, :200] = 0, 0, 0, 0, 0
    file = tmp_path_factory.mktemp("plans") / "plan.png"
    image.fromarray(pixels).save(file)
    return file


@pytest.fixture(scope="session")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """A server process without jobs: its address, and its data folder."""
    data = tmp_path_factory.mktemp("server") / "data"
    with served_at(data, "--no-jobs") as url:
        yield url, data


@contextmanager
def served_at(data: Path, *options: str) -> Iterator[str]:
    """`elfslam serve` as long as the block lasts; gives its address."""
    with serving(data, *options) as address:
        yield address.partition("/#")[0]


@pytest.fixture
def invite(origin: tuple[str, Path]) -> Iterator[Callable[[str], Person]]:
    """Somebody new on the server, with nothing yet, there as long as the test."""
    url, data = origin
    services = open_services(ServerSettings(data, secure_cookie=False))
    ids: list[str] = []

    def invited(name: str) -> Person:
        user, token = add_user(services, name)
        ids.append(user.id)
        return Person(services, url, user.id, token)

    yield invited
    for each in ids:
        delete_user(services, each)
    services.engine.dispose()


@pytest.fixture
def person(invite: Callable[[str], Person]) -> Person:
    """Whoever the test is about."""
    return invite("Ada")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without a window; closed with the file, as others open their own."""
    if CHROMIUM is None:
        pytest.skip("chromium is missing: install Debian's chromium")
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield found
        found.close()


Open = Callable[..., Any]


@pytest.fixture
def open_desk(browser: Any, invite: Callable[[str], Person]) -> Iterator[Open]:
    """Opens somebody's desk in a browser of its own, which is closed before they leave.

    When the test ends nothing may stand in the console, and no request may have left the origin.
    """
    contexts: list[Any] = []
    people: list[Person] = []

    def opened(person: Person, fragment: str = "", **options: Any) -> Any:
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
        context.set_default_timeout(PATIENCE_MS)
        contexts.append(context)
        people.append(person)
        page = context.new_page()
        _watch(page, person)
        page.goto(person.address)
        page.wait_for_selector("nav:not([hidden])")
        if fragment:
            page.evaluate("fragment => { location.hash = fragment; }", fragment)
        page.wait_for_selector("h1")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert [problem for person in people for problem in person.problems] == []


@pytest.fixture
def working_desk(open_desk: Open, tmp_path: Path) -> Iterator[tuple[Any, str]]:
    """A desk on a server of the test's own that works on jobs: its page, and the address."""
    settings = ServerSettings(tmp_path / "data", secure_cookie=False)
    with served_at(settings.data_folder) as url:
        services = open_services(settings)
        user, token = add_user(services, "Ada")
        yield open_desk(Person(services, url, user.id, token)), url


def _watch(page: Any, person: Person) -> None:
    def told(message: Any) -> None:
        # Chromium notes every refusal of the server; the page shows it as text.
        refusal = message.text.startswith("Failed to load resource") and "/api/" in str(
            message.location
        )
        if message.type in ("error", "warning") and not refusal:
            person.problems.append(f"console: {message.text}")

    def asked(request: Any) -> None:
        local = (person.origin, "blob:", "data:")
        if not request.url.startswith(local):
            person.problems.append(f"left the origin: {request.url}")

    page.on("console", told)
    page.on("pageerror", lambda error: person.problems.append(f"page: {error}"))
    page.on("request", asked)


@pytest.fixture
def asked() -> Callable[[Any, str], Any]:
    """What the server says to the page's own session."""

    def ask(page: Any, path: str) -> Any:
        answer = page.context.request.get(page.url.partition("/desk")[0] + path)
        return json.loads(answer.text()) if answer.ok else answer.status

    return ask
