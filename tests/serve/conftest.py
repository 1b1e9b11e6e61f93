"""A server of its own for each test: real SQLite, real files."""

from __future__ import annotations

import secrets
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi import FastAPI
from httpx import Response

from elfslam.base.values import Audio, FloorMap, Imu, Payload
from elfslam.base.values import Recording as Walk
from elfslam.data.recordings import write_recording
from elfslam.serve.app import create_app
from elfslam.serve.people.access import new_token
from elfslam.serve.people.users import add_user, set_owner_token
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import PAGES_FOLDER, ServerSettings
from elfslam.serve.store.tables import Map, Recording, RecordingState
from elfslam.stages.feature import load_encoder
from studies.benchmarks.served import Served, start
from tests.serve.own_postgresql import initdb, own_postgresql
from tests.serve.planting import plant_files
from tests.waiting import until

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of Starlette about the HTTP client it would rather have
    from starlette.testclient import TestClient

SPOTS, SIDE_M = 400, 30.0
PATIENCE_S = 300.0
Json = dict[str, Any]
Maps = tuple[FloorMap, FloorMap]
DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


class Somebody(TestClient):
    """A client of the server with cookies of its own, and what its user may have there."""

    services: Services
    walks: Path | None = None
    """Where the files of recordings lie, by name."""

    @property
    def id(self) -> str:
        """Of their user."""
        return str(self.get("/api/me").json()["id"])

    def put_map(self, name: str = "Hall", **more: Any) -> str:
        """A map of theirs that is a report and nothing else; its id."""
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "report.html").write_text(folder)
            row = Map(user_id=self.id, name=name, kind="run", **more)
            return plant_files(self.services, row, Path(folder))

    def remember(self, name: str, folder: Path | None = None, **more: Any) -> str:
        """A walk among their recordings, as if it had been uploaded; its id."""
        row = Recording(user_id=self.id, name=name, state=RecordingState.READY, **more)
        return plant_files(self.services, row, folder or (self.walks and self.walks / name))

    def share(self, map_id: str, other: Somebody, may: str | None = "read") -> Response:
        """What is answered to letting somebody else read or edit a map."""
        return self.put(f"/api/maps/{map_id}/shares/{other.id}", json={"may": may})

    def link(self, map_id: str) -> str:
        """The link by which everyone may read a map."""
        told = self.put(f"/api/maps/{map_id}/link", json={"may": "read"}).json()["link"]
        return str(told["url"].partition("#link=")[2].partition("&")[0])

    def open_link(self, link: str) -> Response:
        """What is answered to opening a link."""
        return self.post("/api/links/open", json={"link": link})

    def start(self, **given: object) -> str:
        """A job that they ask for; its id."""
        answer = self.post("/api/jobs", json=given)
        assert answer.status_code == 202, answer.text
        return str(answer.json()["id"])

    def ended(self, job_id: str) -> Json:
        """A job of theirs that has ended, waited for."""
        return job_when(self, job_id, lambda job: job["state"] not in ("queued", "running"))

    def done(self, **given: object) -> Json:
        """A job that they ask for, when it has ended."""
        return self.ended(self.start(**given))


def asking(app: FastAPI, host: str = "127.0.0.1", **more: Any) -> Somebody:
    """A client of an app, at some address; the server does not run."""
    return Somebody(app, client=(host, 50_000), **{"base_url": "http://127.0.0.1", **more})


def allow(services: Services, **limits: float) -> None:
    """Change the limits of a server that runs."""
    allowed = replace(services.settings.limits, **limits)  # type: ignore[arg-type]
    object.__setattr__(services.settings, "limits", allowed)


def job_when(client: httpx.Client, job_id: str, wanted: Callable[[Json], bool]) -> Json:
    """A job, as soon as it is as wanted."""

    def as_wanted() -> Json | None:
        job: Json = client.get(f"/api/jobs/{job_id}").json()
        return job if wanted(job) else None

    return until(as_wanted, "the job as wanted", patience_s=PATIENCE_S) or {}


LetIn = Callable[[str], Somebody]


@pytest.fixture
def anyio_backend() -> str:
    """On what tests run that are coroutines: as the server does."""
    return "asyncio"


@pytest.fixture(scope="session")
def postgresql() -> Iterator[str]:
    """A PostgreSQL of our own, by the folder of its socket; skips the test where there is none."""
    pytest.importorskip("psycopg")
    if (program := initdb()) is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    with own_postgresql(program) as folder:
        yield folder


@pytest.fixture
def database_url(request: pytest.FixtureRequest) -> str:
    """The URL of an empty database: SQLite's default, or a new one of PostgreSQL."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return ""
    psycopg = pytest.importorskip("psycopg")
    folder, name = request.getfixturevalue("postgresql"), f"t{secrets.token_hex(6)}"
    whole = f"host={folder} user=elfslam dbname=postgres"
    with psycopg.connect(whole, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return f"postgresql+psycopg://elfslam@/{name}?host={folder}"


@pytest.fixture
def settings(tmp_path: Path, database_url: str) -> ServerSettings:
    """A data folder that does not exist yet; no jobs run."""
    return ServerSettings(tmp_path / "data", database_url, secure_cookie=False, run_jobs=False)


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with an empty SQLite database: to migrate one takes longer than most tests."""
    folder = tmp_path_factory.mktemp("empty") / "data"
    open_services(ServerSettings(folder)).engine.dispose()
    return folder


@pytest.fixture
def app(settings: ServerSettings, empty_store: Path) -> Iterator[FastAPI]:
    """The app of that data folder."""
    if not settings.database_url and not settings.data_folder.exists():
        shutil.copytree(empty_store, settings.data_folder)
    made = create_app(open_services(settings))
    yield made
    made.state.services.engine.dispose()


@pytest.fixture
def services(app: FastAPI) -> Services:
    """What the app's routes share."""
    kept = app.state.services
    assert isinstance(kept, Services)
    return kept


@pytest.fixture
def anyone(app: FastAPI) -> Iterator[TestClient]:
    """Somebody on this machine without a token, while the server runs."""
    with asking(app) as client:
        yield client


@pytest.fixture
def owner(passer_by: Callable[..., Somebody], services: Services) -> Somebody:
    """The owner's client."""
    set_owner_token(services, token := new_token())
    return passer_by(token)


@pytest.fixture
def let_in(passer_by: Callable[..., Somebody], services: Services) -> LetIn:
    """Lets somebody in by name; gives their client."""
    return lambda name: passer_by(add_user(services, name)[1])


@pytest.fixture
def guest(let_in: LetIn) -> Somebody:
    """The client of somebody else whom the owner let in."""
    return let_in("guest")


@pytest.fixture
def ada(let_in: LetIn) -> Somebody:
    """Somebody whom the owner let in."""
    return let_in("Ada")


@pytest.fixture
def eve(let_in: LetIn) -> Somebody:
    """Somebody else."""
    return let_in("Eve")


@pytest.fixture
def bob(let_in: LetIn) -> Somebody:
    """A third."""
    return let_in("Bob")


@pytest.fixture
def visitor(passer_by: Callable[..., Somebody]) -> Somebody:
    """Somebody without a token."""
    return passer_by()


@pytest.fixture
def passer_by(app: FastAPI, anyone: TestClient, services: Services) -> Callable[..., Somebody]:
    """Makes clients, each with cookies of its own, and with a token where one is given."""

    def made(token: str | None = None) -> Somebody:
        header = {} if token is None else {"Authorization": f"Bearer {token}"}
        client = asking(app, headers=header)
        client.portal = anyone.portal  # one event loop, as in a real server
        client.services = services
        return client

    return made


@pytest.fixture(scope="session")
def walk_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of a small recording by name: half a second of sound, and motion."""
    generator = np.random.default_rng(0)
    t_s = np.arange(40) / 50
    gravity = generator.normal([0, 0, 9.8], 0.1, (40, 3))
    recording = Walk(
        name="round the table",
        device="test phone",
        audio=Audio(generator.uniform(-0.1, 0.1, (1, 35_280)), 44_100),
        imu=Imu(t_s, gravity, generator.normal(0, 0.1, (40, 3))),
    )
    folder = tmp_path_factory.mktemp("walk") / "walk"
    write_recording(recording, folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def start_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Served]]:
    """Starts real servers on free ports; all are killed at the end."""
    started: list[Served] = []

    def begin(
        data: Path | None = None, speaks: str = "http", pages: Path = PAGES_FOLDER, **limits: float
    ) -> Served:
        folder = data or tmp_path_factory.mktemp("served") / "data"
        started.append(start(folder, speaks=speaks, pages=pages, limits=limits))
        return started[-1]

    yield begin
    for served in started:
        served.kill()


@pytest.fixture(scope="session")
def maps() -> Maps:
    """A map of 16 tiles, and the same where spots of one tile fade and another tile is new."""
    generator = np.random.default_rng(5)
    encoder = load_encoder("compact")
    root = generator.normal(0, 0.3, (SPOTS, 2, 2))
    vectors = generator.normal(0, 0.09, (SPOTS, 128)).astype(np.float32)
    vectors[0, :4] = [0, 1e-7, -1e-5, 1]  # none, less than the least half, a subnormal one
    first = FloorMap(
        xy_m=generator.uniform(0, SIDE_M, (SPOTS, 2)),
        heading_rad=generator.uniform(-3, 3, SPOTS),
        walk=np.zeros(SPOTS, dtype=np.int64),
        order=np.arange(SPOTS),
        covariance_m2=root @ root.transpose(0, 2, 1),
        payloads=(Payload("elf", encoder.identity, vectors),),
        parameters_digest="",
        sources=("walk",),
        weight=generator.uniform(0.2, 1, SPOTS),
    )
    fading = np.where((first.xy_m < 8).all(axis=1), 0.5, 1.0)
    places = first.xy_m.copy()
    places[0] = [-5.0, 3.0]
    return first, replace(first, weight=first.weight * fading, xy_m=places)
