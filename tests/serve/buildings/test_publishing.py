"""Floors come whole, change whole and go whole, in every kind of store."""

from dataclasses import replace
from pathlib import Path

import numpy.testing as npt
import pytest
from sqlalchemy import select
from starlette.testclient import TestClient

from elfslam.base.errors import InputError, StoreError
from elfslam.serve.buildings import files as store
from elfslam.serve.buildings import publishing
from elfslam.serve.buildings.files import open_files
from elfslam.serve.buildings.publishing import publish, sweep, withdraw
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Building, Floor, FloorPart, FloorPoint
from tests.data.phone_maps import map_of_parts
from tests.serve.buildings.conftest import MakeFloor
from tests.serve.conftest import DATABASES, Maps
from tests.serve.packages import manifest, part

STORES = pytest.mark.parametrize(
    ("database_url", "files_url"),
    [
        ("sqlite", "default"),
        ("postgresql", "default"),
        ("sqlite", "file"),
        ("sqlite", "memory"),
        ("postgresql", "s3"),
    ],
    indirect=True,
)


def kept(services: Services) -> set[str]:
    return set(store.listed(open_files(services.settings)))


def count(services: Services, table: type) -> int:
    with reading(services.sessions) as session:
        return len(session.execute(select(table)).all())


@STORES
def test_a_phone_fetches_a_published_floor_as_a_map_of_its_own(
    guest: TestClient, services: Services, new_floor: MakeFloor, maps: Maps
) -> None:
    made = publish(services, new_floor("Mall", 2))
    told = manifest(guest, made.map_id)
    assert (told["map"], told["name"]) == (made.map_id, "Mall, floor 2")
    assert told["revision"] == made.revision
    read = map_of_parts(
        [part(guest, made.map_id, tile) for tile in told["tiles"]],
        [(each["walk"], part(guest, made.map_id, each)) for each in told["features"]],
        encoder=told["encoder"]["identity"],
        sources=("walk",),
    )
    npt.assert_allclose(sorted(read.xy_m[:, 0]), sorted(maps[0].xy_m[:, 0]), atol=1e-5)
    part(guest, made.map_id, told["encoder"])
    assert guest.get(f"/api/maps/{made.map_id}/package/{'0' * 64}").status_code == 404


@STORES
def test_a_new_revision_takes_the_place_of_the_old_one(
    services: Services, new_floor: MakeFloor
) -> None:
    first = publish(services, new_floor("Mall", 0))
    before = kept(services)
    second = publish(services, new_floor("Mall", 0, map=1, points=None))
    assert second.map_id == first.map_id
    assert second.revision > first.revision
    after = kept(services)
    assert before - after
    assert before & after  # what did not change stays
    assert len(after) == second.parts == count(services, FloorPart)
    assert count(services, FloorPoint) == 0
    again = publish(services, new_floor("Mall", 0, map=1))
    assert kept(services) == after
    assert again.revision > second.revision
    assert (count(services, Floor), count(services, Building)) == (1, 1)


@STORES
def test_what_is_withdrawn_leaves_nothing_that_others_do_not_need(
    services: Services, new_floor: MakeFloor
) -> None:
    publish(services, new_floor("Mall", 0))
    needed = kept(services)
    publish(services, new_floor("Mall", 1, map=1))
    publish(services, new_floor("Office", 0, map=1))
    withdraw(services, "Mall", 1)
    withdraw(services, "Office", 0)
    assert kept(services) == needed
    with reading(services.sessions) as session:
        assert session.scalars(select(Building.name)).all() == ["Mall"]
    withdraw(services, "Mall", 0)
    assert kept(services) == set()
    for table in (Building, Floor, FloorPart, FloorPoint):
        assert count(services, table) == 0
    with pytest.raises(InputError, match="is not published"):
        withdraw(services, "Mall", 0)


@STORES
def test_a_publisher_that_was_killed_leaves_parts_that_are_swept(
    services: Services, new_floor: MakeFloor, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish(services, new_floor("Mall", 0))
    whole = kept(services)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr(publishing, "_kept", killed)
        with pytest.raises(KeyboardInterrupt):
            publish(services, new_floor("Office", 0, map=1))
    assert count(services, Floor) == 1
    left = kept(services) - whole
    assert left
    assert sweep(services) == len(left)
    assert kept(services) == whole


def test_half_a_part_is_written_again(services: Services, new_floor: MakeFloor) -> None:
    made = publish(services, new_floor("Mall", 0))
    files = open_files(services.settings)
    torn = Path(files.path(sorted(kept(services))[0]))
    whole = torn.read_bytes()
    torn.write_bytes(whole[:10])
    assert publish(services, new_floor("Mall", 0)).parts == made.parts
    assert torn.read_bytes() == whole
    assert [path for path in torn.parent.iterdir() if path.name.endswith(".partial")] == []


@DATABASES
def test_sweeping_waits_for_publishers(services: Services) -> None:
    """Two share; who wants to be alone has to wait until both have gone."""
    import threading

    swept = threading.Event()

    def alone() -> None:
        with publishing.holding(services, alone=True):
            swept.set()

    with publishing.holding(services, alone=False):
        with publishing.holding(services, alone=False):
            thread = threading.Thread(target=alone)
            thread.start()
        assert not swept.wait(0.2)
    thread.join(10)
    assert swept.is_set()


def test_what_cannot_be_published_is_refused(services: Services, new_floor: MakeFloor) -> None:
    for changes in ({"level": 2000}, {"at": {"latitude_deg": 91.0}}):
        with pytest.raises(InputError, match="wanted a floor from"):
            publish(services, new_floor("Mall", **changes))
    with pytest.raises(InputError, match="lies beside it"):
        publish(services, new_floor("Mall", 0, encoder=b"another"))
    assert count(services, Floor) == 0


def test_stores_that_are_not_there(services: Services, new_floor: MakeFloor) -> None:
    unknown = replace(services.settings, files_url="gopher://x/y")
    with pytest.raises(InputError, match="wanted such as s3://"):
        open_files(unknown)
    closed = replace(services.settings, files_url=f"file://{services.settings.data_folder}/.lock/x")
    (services.settings.data_folder / ".lock").touch()
    with pytest.raises(StoreError, match=r"\.lock/x"):
        publish(replace(services, settings=closed), new_floor("Mall", 0))
    assert count(services, Floor) == 0


def test_the_default_is_a_folder_of_the_server(tmp_path: Path) -> None:
    assert ServerSettings(tmp_path / "data").files == (tmp_path / "data/published").as_uri()
