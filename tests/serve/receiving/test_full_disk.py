"""A disk that fills: nothing acknowledged is lost, and it goes on when there is room."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.serve.settings import Limits, ServerSettings
from tests.disks import mounted
from tests.serve.conftest import Somebody
from tests.serve.uploading import append, begun, created, offset_of, uploading

SIZE = 8 * 2**20


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 8 MiB; skips the test where none may be made."""
    with mounted(tmp_path / "disk", size=SIZE) as place:
        yield place


@pytest.fixture
def settings(small_disk: Path, settings: ServerSettings) -> ServerSettings:
    return replace(settings, data_folder=small_disk / "data", limits=Limits(free_bytes=0))


def fill(file: Path) -> None:
    """Write until nothing more fits."""
    with file.open("wb", buffering=0) as stream:
        while True:
            stream.write(bytes(4096))


def test_what_cannot_fit_is_refused_before_it_comes(owner: Somebody) -> None:
    made = created(owner, SIZE, recording=begun(owner), filename="wifi.csv")
    assert made.status_code == 507
    assert list(owner.get("/api/recordings").json()[0]["uploads"]) == []


def test_a_disk_that_fills_loses_nothing(owner: Somebody, small_disk: Path) -> None:
    place = uploading(owner)
    filler, data = small_disk / "filler", bytes(range(256)) * 4096
    assert append(owner, place, 0, data).status_code == 204
    with pytest.raises(OSError, match="No space"):
        fill(filler)
    answer = append(owner, place, len(data), data)
    assert answer.status_code == 507
    assert "kept" in answer.json()["detail"]
    assert offset_of(owner, place) == len(data)
    assert owner.post("/api/recordings", json={"name": "no room" * 9}).status_code in (201, 507)
    filler.unlink()
    assert append(owner, place, len(data), data).status_code == 204
    kept = small_disk / "data" / "uploads" / place.rpartition("/")[2]
    assert kept.read_bytes() == data + data


def test_a_piece_that_fits_by_half_is_kept_by_half(owner: Somebody, small_disk: Path) -> None:
    """The length was not known before: the disk fills while the piece is written."""
    place = uploading(owner)

    def pieces() -> Iterator[bytes]:
        for _ in range(12):
            yield bytes(2**20)

    assert append(owner, place, 0, pieces()).status_code == 507
    kept = small_disk / "data" / "uploads" / place.rpartition("/")[2]
    assert offset_of(owner, place) == kept.stat().st_size
