"""Walks through the studio, as if they had been uploaded, and a server that works on jobs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.app.map import write_reported_run
from elfslam.app.merge import merge_into
from elfslam.data.recordings import read_recording, write_recording
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.tables import Map
from elfslam.slam.merging import MergeParameters
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.chirp import describe_chirp
from elfslam.stages.feature import load_encoder
from elfslam.world.simulate import load_world, simulate
from tests.serve.conftest import Somebody
from tests.serve.planting import plant_files

Keep = Callable[[Somebody, str], str]
WALKS = {
    "one": ("studio", 107, 2, True),
    "two": ("studio", 111, 2, True),
    "open": ("studio", 114, 1, True),
    "mute": ("studio", 107, 1, False),
    "away": ("hall", 100, 1, True),
}
"""World, seed and rounds of each walk, and whether it has sound; `open` closes no loop."""


@pytest.fixture
def settings(tmp_path: Path, database_url: str) -> ServerSettings:
    """A data folder that does not exist yet; jobs run."""
    return ServerSettings(tmp_path / "data", database_url, secure_cookie=False)


@pytest.fixture(scope="session")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings by name, their truth beside them."""
    folder = tmp_path_factory.mktemp("walks")
    for name, (world, seed, rounds, sound) in WALKS.items():
        recording, truth = simulate(load_world(world), seed, rounds=rounds, sound=sound)
        played = describe_chirp() if sound else None
        named = replace(recording, name=name)
        write_recording(named, folder / name, chirp_description=played, truth=truth)
    return folder


@pytest.fixture
def owner(owner: Somebody, walks: Path) -> Somebody:
    """The owner, who has been on these walks."""
    owner.walks = walks
    return owner


@pytest.fixture
def guest(guest: Somebody, walks: Path) -> Somebody:
    """Somebody else who has."""
    guest.walks = walks
    return guest


@pytest.fixture(scope="session")
def runs(walks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folders of two walks, and `floor`, merged from them; each with its report."""
    folder, encoder = tmp_path_factory.mktemp("runs"), load_encoder("compact")
    for name in ("one", "two"):
        run = map_by_echoes(read_recording(walks / name), encoder, Parameters())
        write_reported_run(
            replace(run, echoes=None),
            folder / name,
            facts={"device": "a phone"},
            encoder=encoder.content,
        )
    merge_into(
        folder / "floor",
        [folder / "one", folder / "two"],
        MergeParameters(),
        lambda what, share: None,
    )
    return folder


@pytest.fixture
def keep_map(services: Services, runs: Path) -> Keep:
    """Puts a run, or the floor, among the maps of a client's user, without a job."""

    def kept(client: Somebody, name: str) -> str:
        user_id, kind = client.id, "floor" if name == "floor" else "run"
        row = Map(user_id=user_id, name=name, kind=kind, facts={"walks": 1})
        return plant_files(services, row, runs / name)

    return kept


@pytest.fixture
def one(owner: Somebody, keep_map: Keep) -> str:
    """The map of a walk, among the owner's."""
    return keep_map(owner, "one")
