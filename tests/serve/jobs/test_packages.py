"""Packages over HTTP: signed, by digests, made once, and nobody else's."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy.testing as npt
import pytest

from elfslam.base.parameters import as_dict
from elfslam.data.map_files import read_map
from elfslam.data.tiles import stretches_of, tiles_of
from elfslam.serve.services import Services
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map, MapFile, MapPart, new_id
from elfslam.slam.parameters import Parameters
from tests.data.phone_maps import map_of_parts
from tests.serve.conftest import Maps, Somebody
from tests.serve.jobs.conftest import Keep
from tests.serve.packages import manifest, part
from tests.serve.planting import picture, plant_floor_map, put_plan


@pytest.mark.parametrize("name", ["one", "floor"])
def test_a_package_is_the_map(owner: Somebody, keep_map: Keep, runs: Path, name: str) -> None:
    map_id, floor_map = keep_map(owner, name), read_map(runs / name)
    told = manifest(owner, map_id)
    assert (told["format"], told["map"], told["name"]) == (3, map_id, name)
    tiles = [part(owner, map_id, tile) for tile in told["tiles"]]
    assert tiles == [tile.content for tile in tiles_of(floor_map)]
    stretches = [(each["walk"], part(owner, map_id, each)) for each in told["features"]]
    assert stretches == [(each.walk, each.content) for each in stretches_of(floor_map)]
    identity = told["encoder"]["identity"]
    assert identity == floor_map.payloads[0].encoder
    read = map_of_parts(tiles, stretches, encoder=identity, sources=floor_map.sources)
    assert sum(tile["spots"] for tile in told["tiles"]) == len(read.xy_m) == len(floor_map.xy_m)
    npt.assert_allclose(sorted(read.xy_m[:, 0]), sorted(floor_map.xy_m[:, 0]), atol=1e-5)
    assert part(owner, map_id, told["encoder"]) == (runs / name / "encoder.onnx").read_bytes()
    known = as_dict(Parameters())
    for group in ("chirp", "echo", "motion", "locate", "track"):
        assert told["parameters"][group] == known[group]


def test_a_map_brings_its_own_encoder(owner: Somebody, maps: Maps) -> None:
    """As one of superimposed spots does."""
    content = b"an encoder that learnt this floor"
    elf = replace(maps[0].payloads[0], encoder=hashlib.sha256(content).hexdigest()[:16])
    floor_map = replace(maps[0], payloads=(elf,))
    map_id = plant_floor_map(owner.services.settings.data_folder, floor_map, encoder=content)
    told = manifest(owner, map_id)
    assert told["encoder"]["identity"] == elf.encoder
    assert part(owner, map_id, told["encoder"]) == content


def test_it_is_made_once_and_grows_with_what_changes(owner: Somebody, one: str) -> None:
    first = manifest(owner, one)
    assert manifest(owner, one) == first
    put_plan(owner, one, picture()).raise_for_status()
    second = manifest(owner, one)
    assert second["revision"] > first["revision"]
    assert second["tiles"] == first["tiles"]
    assert part(owner, one, second["floor_plan"]) == picture()
    assert second["floor_plan"]["placement"] is None
    place = {"width_m": 9.0, "x_m": 1.0, "y_m": 2.0}
    owner.put(f"/api/maps/{one}/floor-plan/placement", json=place).raise_for_status()
    third = manifest(owner, one)
    assert third["revision"] > second["revision"]
    assert third["floor_plan"]["placement"]["width_m"] == 9.0


def test_a_part_is_given_with_its_own_map_alone(
    owner: Somebody, guest: Somebody, anyone: Somebody, keep_map: Keep, one: str
) -> None:
    told = manifest(owner, one)["tiles"][0]
    assert anyone.get("/api/key").status_code == 200, "it is no secret"
    mine = keep_map(guest, "two")
    manifest(guest, mine)
    assert guest.get(f"/api/maps/{mine}/package/{told['sha256']}").status_code == 404


def test_only_parts_of_the_package_are_given(owner: Somebody, one: str) -> None:
    manifest(owner, one)
    report = next(
        file for file in owner.get(f"/api/maps/{one}").json()["files"]
        if file["name"] == "report.html"
    )  # fmt: skip
    for name in (report["sha256"], "0" * 64, "map.npz"):
        assert owner.get(f"/api/maps/{one}/package/{name}").status_code == 404
    answer = owner.get(f"/api/maps/{one}/package")
    assert answer.headers["cache-control"] == "no-store"


def test_a_map_that_phones_cannot_use_is_refused(owner: Somebody, keep_map: Keep) -> None:
    for missing in ("map.npz", "encoder.onnx"):
        map_id = keep_map(owner, "one")
        with transaction(owner.services.sessions) as session:
            session.delete(session.get_one(MapFile, (map_id, missing)))
        answer = owner.get(f"/api/maps/{map_id}/package")
        assert answer.status_code == 422
        assert f"has no {missing}" in answer.json()["detail"]
    map_id = keep_map(owner, "one")
    with transaction(owner.services.sessions) as session:
        row = session.get_one(MapFile, (map_id, "encoder.onnx"))
        row.sha256 = session.get_one(MapFile, (map_id, "run.json")).sha256
    assert "lies beside it" in owner.get(f"/api/maps/{map_id}/package").json()["detail"]


def test_a_deleted_map_leaves_nothing(owner: Somebody, keep_map: Keep, services: Services) -> None:
    before = sorted(file.name for file in services.settings.blobs_folder.glob("*/*"))
    used = owner.get("/api/me").json()["used_bytes"]
    map_id = keep_map(owner, "one")
    tiles = manifest(owner, map_id)["tiles"]
    other = keep_map(owner, "one")
    assert manifest(owner, other)["tiles"] == tiles
    owner.delete(f"/api/maps/{map_id}")
    part(owner, other, tiles[0])
    owner.delete(f"/api/maps/{other}")
    assert sorted(file.name for file in services.settings.blobs_folder.glob("*/*")) == before
    assert owner.get("/api/me").json()["used_bytes"] == used


def test_tiles_that_went_are_dropped(owner: Somebody, keep_map: Keep, one: str) -> None:
    """A map of that id whose content was replaced."""
    first = manifest(owner, one)
    two = keep_map(owner, "two")
    with transaction(owner.services.sessions) as session:
        for name in ("map.npz", "encoder.onnx"):
            given = session.get_one(MapFile, (two, name))
            row = session.get_one(MapFile, (one, name))
            row.sha256, row.size_bytes = given.sha256, given.size_bytes
    second = manifest(owner, one)
    assert second["revision"] > first["revision"]
    gone = first["tiles"][0]["sha256"]
    assert owner.get(f"/api/maps/{one}/package/{gone}").status_code == 404
    assert not (owner.services.settings.blobs_folder / gone[:2] / gone).exists()
    with transaction(owner.services.sessions) as session:
        assert session.query(MapPart).filter_by(map_id=one).count() == len(
            [*second["tiles"], *second["features"]]
        )
        assert session.get(Map, new_id()) is None
