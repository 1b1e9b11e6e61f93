"""A real server process, planted maps, and a browser that forgives nothing."""

import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
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

PATIENCE_MS = 60_000
"""Only a test that fails waits for so long."""
CLOSURES = ((2, 20), (3, 21), (4, 22))
"""Planted into the map of a single walk."""


@dataclass
class Person:
    """Somebody with a token, what is planted for them, and their browsers."""

    services: Services
    origin: str
    name: str
    browser: Any
    walk: Path
    """A recording of motion alone, and the run of it."""
    run: Path
    problems: list[str] = field(default_factory=list)
    contexts: list[Any] = field(default_factory=list)
    id: str = ""
    token: str = ""

    def __post_init__(self) -> None:
        user, self.token = add_user(self.services, self.name)
        self.id = user.id

    @property
    def address(self) -> str:
        """What pairs a browser."""
        return f"{self.origin}/desk#token={self.token}"

    def plant_map(self, name: str, folder: Path | None = None, **more: Any) -> str:
        """A map as a job would have left it; gives its id."""
        row = Map(user_id=self.id, name=name, kind="run", **more)
        return plant_files(self.services, row, folder or self.run)

    def plant_recording(self, name: str, folder: Path | None = None, **more: Any) -> str:
        """A recording as if it had been uploaded; gives its id."""
        row = Recording(user_id=self.id, name=name, state=RecordingState.READY, **more)
        return plant_files(self.services, row, folder or self.walk)

    def plant_job(self, kind: JobKind, state: JobState, **more: Any) -> str:
        """A job in any state; gives its id."""
        row = Job(user_id=self.id, kind=kind, state=state, **more)
        with transaction(self.services.sessions) as session:
            session.add(row)
        return row.id

    def ask(self, path: str, method: str = "GET", **more: Any) -> httpx.Response:
        """What the server answers them."""
        bearer = {"Authorization": f"Bearer {self.token}"}
        return httpx.request(method, self.origin + path, headers=bearer, timeout=60, **more)

    def get(self, path: str) -> Any:
        """What the server says to them: JSON, or the status of a refusal."""
        answer = self.ask(path)
        return answer.json() if answer.is_success else answer.status_code

    def open(self, fragment: str = "", **options: Any) -> Any:
        """Their desk in a browser of its own, at some fragment."""
        page = new_page(self.browser, **options)
        self.contexts.append(page.context)
        _watch(page, self)
        page.goto(self.address)
        page.wait_for_selector("nav:not([hidden])")
        if fragment:
            go(page, fragment)
        page.wait_for_selector("h1")
        return page

    def leave(self) -> None:
        """Close their browsers."""
        for context in self.contexts:
            context.close()


def new_page(browser: Any, **options: Any) -> Any:
    """A page of a browser that nobody paired."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
    context.set_default_timeout(PATIENCE_MS)
    return context.new_page()


def go(page: Any, fragment: str) -> None:
    """To another place of the desk."""
    page.evaluate("fragment => { location.hash = fragment; }", fragment)


def row(page: Any, name: str) -> Any:
    """The row of a table that has a name in it."""
    return page.get_by_role("row").filter(has_text=name)


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


Invite = Callable[[str], Person]


@contextmanager
def people(settings: ServerSettings, url: str, browser: Any, *folders: Path) -> Iterator[Invite]:
    """Lets people into a server as long as the block lasts; they begin with nothing.

    When it ends nothing may stand in a console, and no request may have left the origin.
    """
    services, invited = open_services(settings), list[Person]()

    def invite(name: str) -> Person:
        invited.append(Person(services, url, name, browser, *folders))
        return invited[-1]

    yield invite
    for each in invited:
        each.leave()
    for each in invited:
        delete_user(services, each.id)
    services.engine.dispose()
    assert [problem for each in invited for problem in each.problems] == []


@pytest.fixture
def invite(
    origin: tuple[str, Path], browser: Any, walk_folder: Path, run_folder: Path
) -> Iterator[Invite]:
    """Lets somebody in."""
    url, data = origin
    settings = ServerSettings(data, secure_cookie=False)
    with people(settings, url, browser, walk_folder, run_folder) as invited:
        yield invited


@pytest.fixture
def ada(invite: Invite) -> Person:
    """Whoever the test is about."""
    return invite("Ada")


@pytest.fixture
def map_id(ada: Person) -> str:
    """A map of one walk of hers."""
    return ada.plant_map("round the studio")


@pytest.fixture
def eve(invite: Invite) -> Person:
    """Somebody whom nobody else is called like."""
    return invite(f"Eve {secrets.token_hex(4)}")


@pytest.fixture
def working_desk(
    browser: Any, walk_folder: Path, run_folder: Path, tmp_path: Path
) -> Iterator[Any]:
    """A desk on a server of the test's own that works on jobs."""
    settings = ServerSettings(tmp_path / "data", secure_cookie=False)
    with (
        served_at(settings.data_folder) as url,
        people(settings, url, browser, walk_folder, run_folder) as invited,
    ):
        yield invited("Ada").open()


@pytest.fixture
def fresh(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens pages of browsers that nobody paired; nothing that these throw is let pass."""
    pages, problems = list[Any](), list[str]()

    def opened(**options: Any) -> Any:
        pages.append(new_page(browser, **options))
        pages[-1].on("pageerror", lambda error: problems.append(str(error)))
        return pages[-1]

    yield opened
    for page in pages:
        page.context.close()
    assert problems == []


@pytest.fixture
def stranger(fresh: Callable[..., Any]) -> Any:
    """One of them."""
    return fresh()


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
