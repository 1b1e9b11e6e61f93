"""A small S3 on loopback, and floors to be published."""

import hashlib
import logging
import secrets
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.values import FloorMap
from elfslam.serve.buildings.publishing import NewFloor, Spot
from elfslam.serve.buildings.senses import FloorPoints, bssid_text
from elfslam.serve.settings import ServerSettings

RADIOS = 0x0433_8900_0000 + 0x100 * np.arange(12)
MakeFloor = Callable[..., NewFloor]


@pytest.fixture(scope="session")
def s3_server() -> Iterator[str]:
    """The address of moto's S3; skips the test where moto is not installed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what moto imports
        server = pytest.importorskip("moto.server")
        pytest.importorskip("s3fs")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    running.start()
    host, port = running.get_host_and_port()
    yield f"http://{host}:{port}"
    running.stop()


@pytest.fixture
def s3(s3_server: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The URL of a new bucket; how to reach it is told as S3's clients are told everywhere."""
    for name, value in {
        "AWS_ENDPOINT_URL": s3_server,
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    bucket = f"b{secrets.token_hex(8)}"
    s3fs.S3FileSystem().mkdir(bucket)
    return f"s3://{bucket}/maps"


@pytest.fixture
def files_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where parts lie: the default, another folder, memory, or S3."""
    kind = getattr(request, "param", "default")
    if kind == "s3":
        return str(request.getfixturevalue("s3"))
    places = {"file": (tmp_path / "elsewhere").as_uri(), "memory": f"memory://{tmp_path.name}"}
    return places.get(kind, "")


@pytest.fixture
def settings(tmp_path: Path, database_url: str, files_url: str) -> ServerSettings:
    """A data folder that does not exist yet; no jobs run."""
    return ServerSettings(
        tmp_path / "data", database_url, secure_cookie=False, run_jobs=False, files_url=files_url
    )


@pytest.fixture
def new_floor(maps: tuple[FloorMap, FloorMap]) -> MakeFloor:
    """Makes floors of the two small maps; the points of a floor are loudest where `loud` says."""
    encoder = b"an encoder, as far as publishing looks at it"
    identity = hashlib.sha256(encoder).hexdigest()[:16]
    floors = [
        replace(each, payloads=(replace(each.payloads[0], encoder=identity), *each.payloads[1:]))
        for each in maps
    ]

    def made(building: str = "Mall", level: int = 0, **changes: Any) -> NewFloor:
        which, loud = changes.pop("map", 0), changes.pop("loud", level)
        place = {"latitude_deg": 47.0, "longitude_deg": 8.0, **changes.pop("at", {})}
        levels = np.roll(np.linspace(-45.0, -85.0, 12), 5 * loud)
        points = FloorPoints(RADIOS, levels, np.full(12, 6.0), np.full(12, 0.5))
        new = NewFloor(Spot(building, level, **place), floors[which], encoder, points)
        return replace(new, **changes)

    return made


def heard_on(level: int, deaf_db: float = 0.0) -> dict[str, float]:
    """What a phone on a floor of `new_floor` hears, as it is sent."""
    levels = np.roll(np.linspace(-45.0, -85.0, 12), 5 * level) - deaf_db
    return dict(zip(map(bssid_text, RADIOS.tolist()), levels.tolist(), strict=True))
