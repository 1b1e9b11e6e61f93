"""Maps of planted spots on real servers, and phones whose browser is closed and opened again."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import select

from elfslam.base.values import FloorMap, Payload
from elfslam.data.facts import ENCODER
from elfslam.data.map_files import MAP, write_map
from elfslam.line.feature import MEAN_LOG_SPECTRUM, PHONE, OnnxEncoder, load_encoder
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Map, MapFile, User, transaction

CHROMIUM = shutil.which("chromium")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
SPOTS, SIDE_M = 400, 30.0
Maps = tuple[FloorMap, FloorMap]


@pytest.fixture(scope="session")
def maps() -> Maps:
    """A map of 16 tiles, and the same where spots of one tile fade and another tile is new."""
    generator = np.random.default_rng(5)
    encoder = load_encoder("compact")
    root = generator.normal(0, 0.3, (SPOTS, 2, 2))
    vectors = generator.normal(0, 0.09, (SPOTS, 128)).astype(np.float32)
    vectors[0, :4] = [0, 1e-7, -1e-5, 1]  # none, less than the least half, a subnormal one
    phone = np.tile(generator.normal(0, 2, 12).astype(np.float32), (SPOTS, 1))
    first = FloorMap(
        xy_m=generator.uniform(0, SIDE_M, (SPOTS, 2)),
        heading_rad=generator.uniform(-3, 3, SPOTS),
        walk=np.zeros(SPOTS, dtype=np.int64),
        order=np.arange(SPOTS),
        covariance_m2=root @ root.transpose(0, 2, 1),
        payloads=(
            Payload("elf", encoder.identity, vectors),
            Payload(PHONE, MEAN_LOG_SPECTRUM, phone),
        ),
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

    def put(self, floor_map: FloorMap, map_id: str | None = None) -> str:
        """A map of the owner's, or another content of one; its id."""
        folder = self.scratch / f"map{len(list(self.scratch.iterdir()))}"
        folder.mkdir()
        write_map(floor_map, folder / MAP)
        encoder = load_encoder("compact")
        assert isinstance(encoder, OnnxEncoder)
        (folder / ENCODER).write_bytes(encoder.content)
        made = blobs.put_folder(self.services.settings.blobs_folder, folder)
        with transaction(self.services.sessions) as session:
            owner = session.scalars(select(User).filter_by(is_owner=True)).one()
            row = session.get(Map, map_id or "") or Map(user_id=owner.id, name="Hall", kind="run")
            session.add(row)
            session.flush()
            for name, blob in made.items():
                told = {"sha256": blob.sha256, "size_bytes": blob.size_bytes}
                session.merge(MapFile(map_id=row.id, name=name, **told))
            return row.id


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


@dataclass
class Browser:
    """A phone's browser with a profile that lasts; whatever its pages throw fails the test."""

    profile: Path
    play: Any
    problems: list[str] = field(default_factory=list)

    @contextmanager
    def opened(self) -> Iterator[Any]:
        """The browser from its start to its end; gives a page."""
        context = self.play.chromium.launch_persistent_context(
            str(self.profile),
            executable_path=CHROMIUM,
            args=list(ARGUMENTS),
            viewport={"width": 390, "height": 844},
            bypass_csp=True,  # tests evaluate; that the policy holds is tested with the pages
        )
        page = context.new_page()
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        try:
            yield page
        finally:
            context.close()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """A phone that was just handed over."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("chromium is missing: apt-get install chromium")
    with playwright.sync_playwright() as play:
        handed = Browser(tmp_path / "profile", play)
        yield handed
    assert handed.problems == []
