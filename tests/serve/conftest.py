"""A server of its own for each test: real SQLite, real files."""

from __future__ import annotations

import secrets
import shutil
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI

from elfslam.base.values import Audio, FloorMap, Imu, Payload, Recording
from elfslam.data.recordings import write_recording
from elfslam.serve.app import create_app
from elfslam.serve.people.access import new_token
from elfslam.serve.people.users import add_user, set_owner_token
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import PAGES_FOLDER, ServerSettings
from elfslam.serve.store.tables import Map
from elfslam.stages.feature import load_encoder
from studies.benchmarks.served import Served, start
from tests.serve.own_postgresql import initdb, own_postgresql
from tests.serve.planting import plant_files, plant_floor_map

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of Starlette about the HTTP client it would rather have
    from starlette.testclient import TestClient

SPOTS, SIDE_M = 400, 30.0
Maps = tuple[FloorMap, FloorMap]
LetIn = Callable[[str], TestClient]


@pytest.fixture(scope="session")
def postgresql() -> Iterator[str]:
    """A PostgreSQL of our own, by the folder of its socket; skips the test where there is none."""
    pytest.importorskip("psycopg")
    if initdb() is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    with own_postgresql(fsync="off") as running:
        yield running.folder


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
    with TestClient(app, client=("127.0.0.1", 50_000), base_url="http://127.0.0.1") as client:
        yield client


@pytest.fixture
def owner(app: FastAPI, anyone: TestClient, services: Services) -> TestClient:
    """The owner's client."""
    token = new_token()
    set_owner_token(services, token)
    return _client_of(app, anyone, token)


@pytest.fixture
def guest(app: FastAPI, anyone: TestClient, services: Services) -> TestClient:
    """The client of somebody else whom the owner let in."""
    return _client_of(app, anyone, add_user(services, "guest")[1])


@pytest.fixture
def let_in(app: FastAPI, anyone: TestClient, services: Services) -> LetIn:
    """Lets somebody in by name; gives their client."""
    return lambda name: _client_of(app, anyone, add_user(services, name)[1])


@pytest.fixture
def passer_by(app: FastAPI, anyone: TestClient) -> Callable[[], TestClient]:
    """Makes clients without a token, each with cookies of its own."""
    return lambda: _client_of(app, anyone, None)


@pytest.fixture
def put_map(services: Services, tmp_path: Path) -> Callable[..., str]:
    """Puts a map that is a report and nothing else among those of a client's user; its id."""

    def put(client: TestClient, name: str = "Hall", **more: Any) -> str:
        user_id, folder = client.get("/api/me").json()["id"], tmp_path / secrets.token_hex(4)
        folder.mkdir()
        (folder / "report.html").write_text(folder.name)
        return plant_files(services, Map(user_id=user_id, name=name, kind="run", **more), folder)

    return put


def _client_of(app: FastAPI, running: TestClient, token: str | None) -> TestClient:
    header = {} if token is None else {"Authorization": f"Bearer {token}"}
    client = TestClient(
        app, headers=header, client=("127.0.0.1", 50_001), base_url="http://127.0.0.1"
    )
    client.portal = running.portal  # one event loop, as in a real server
    return client


@pytest.fixture(scope="session")
def walk_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of a small recording by name: half a second of sound, and motion."""
    generator = np.random.default_rng(0)
    t_s = np.arange(40) / 50
    gravity = generator.normal([0, 0, 9.8], 0.1, (40, 3))
    recording = Recording(
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


@dataclass(frozen=True)
class Planted:
    """Maps put where jobs would have left them."""

    services: Services
    scratch: Path

    def put(
        self, floor_map: FloorMap, map_id: str | None = None, encoder: bytes | None = None
    ) -> str:
        """A map of the owner's, or another content of one; its id."""
        folder = self.scratch / f"map{len(list(self.scratch.iterdir()))}"
        folder.mkdir()
        return plant_floor_map(self.services, floor_map, folder, map_id, encoder)


@pytest.fixture
def plant(tmp_path: Path) -> Iterator[Callable[[Path], Planted]]:
    """Plants maps into the data folder of a server that runs."""
    opened: list[Services] = []

    def planted(data: Path) -> Planted:
        opened.append(open_services(ServerSettings(data)))
        scratch = tmp_path / f"planted{len(opened)}"
        scratch.mkdir()
        return Planted(opened[-1], scratch)

    yield planted
    for services in opened:
        services.engine.dispose()
