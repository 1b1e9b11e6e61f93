"""From the command line: publish, list, index, withdraw; and a phone that finds the floor."""

import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from starlette.testclient import TestClient

from elfslam.base.values import FloorMap, Imu, Recording, WifiScans
from elfslam.cli.app import run
from elfslam.data.map_files import ENCODER, MAP, write_map
from elfslam.data.recordings import write_recording
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Floor, Map, User
from elfslam.serve.store.tables import Recording as RecordingRow
from elfslam.stages.feature import OnnxEncoder, load_encoder
from tests.serve.conftest import Maps
from tests.serve.planting import plant_files

Elfslam = Callable[..., tuple[int, str]]
MALL = ("--building", "Mall", "--at", "47.1,8.2")
BSSIDS = tuple(f"04:33:89:79:{k:02x}:10" for k in range(8))


@pytest.fixture
def elfslam(services: Services, capsys: pytest.CaptureFixture[str]) -> Elfslam:
    """Runs a command on the data folder of the test's server."""

    def ended(*arguments: object) -> tuple[int, str]:
        told = ["--data", str(services.settings.data_folder)]
        capsys.readouterr()
        code = run([*map(str, arguments), *told])
        said = capsys.readouterr()
        return code, said.out + said.err

    return ended


@pytest.fixture
def map_folder(maps: Maps, tmp_path: Path) -> Path:
    """The folder of a map, with the shipped encoder."""
    folder, shipped = tmp_path / "run", load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    folder.mkdir()
    write_map(maps[0], folder / MAP)
    (folder / ENCODER).write_bytes(shipped.content)
    return folder


@pytest.fixture
def walk_folder(tmp_path: Path) -> Path:
    """A recording with ten scans."""
    generator = np.random.default_rng(2)
    t_s, rssi = np.arange(10) * 2.0, np.linspace(-50, -80, 8) + generator.normal(0, 2, (10, 8))
    wifi = WifiScans(t_s, BSSIDS, rssi, np.full((10, 8), 0.5))
    imu = Imu(np.arange(40) / 50, np.tile([0.0, 0, 9.8], (40, 1)), np.zeros((40, 3)))
    write_recording(Recording(name="walk", device="a phone", imu=imu, wifi=wifi), tmp_path / "walk")
    return tmp_path / "walk"


def echoes_of(floor_map: FloorMap) -> dict[str, object]:
    """What a phone tells of four spots of a map."""
    vectors = floor_map.payloads[0].vectors[5:9]
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return {"encoder": load_encoder("compact").identity, "vectors": unit.tolist()}


def heard() -> dict[str, float]:
    return dict(zip(BSSIDS, np.linspace(-52, -82, 8).tolist(), strict=True))


def test_a_floor_from_its_folder(
    elfslam: Elfslam,
    guest: TestClient,
    map_folder: Path,
    walk_folder: Path,
    maps: Maps,
) -> None:
    code, out = elfslam("publish", map_folder, *MALL, "--floor", -1, "--heard", walk_folder)
    assert code == 0
    assert "8 access points" in out
    told = guest.post("/api/find", json={"wifi": heard()}).json()
    assert told["status"] == "OK"
    assert (told["candidates"][0]["building"], told["candidates"][0]["floor"]) == ("Mall", -1)
    code, out = elfslam("buildings", "--index", "--sweep")
    assert code == 0
    assert "Mall" in out
    assert f"indexed {len(maps[0].xy_m)} spots of 1 floors" in out
    assert "swept 0 files" in out
    echoes = echoes_of(maps[0])
    assert guest.post("/api/find", json={"echoes": echoes}).json()["status"] == "OK"
    other = {**echoes, "encoder": "another"}
    assert guest.post("/api/find", json={"echoes": other}).json()["status"] == "UNKNOWN_PLACE"
    assert elfslam("withdraw", "--building", "Mall", "--floor", -1)[0] == 0
    for question in ({"wifi": heard()}, {"echoes": echoes}):
        told = guest.post("/api/find", json=question).json()
        assert told == {"status": "UNKNOWN_PLACE", "candidates": []}


def by_echoes(client: TestClient, floor_map: FloorMap) -> list[tuple[str, int]]:
    """The floors that somebody is told who hears four spots of a map, if it is sure."""
    told = client.post("/api/find", json={"echoes": echoes_of(floor_map)}).json()
    known = [(each["building"], each["floor"]) for each in told["candidates"]]
    return known[:1] if told["status"] == "OK" else []


@pytest.mark.parametrize("most_added", [20_000, 300])
def test_once_there_is_an_index_floors_come_into_it_as_they_are_published(
    elfslam: Elfslam,
    guest: TestClient,
    map_folder: Path,
    maps: Maps,
    monkeypatch: pytest.MonkeyPatch,
    most_added: int,
) -> None:
    indexes = importlib.import_module("elfslam.serve.buildings.files")  # as the command finds it
    monkeypatch.setattr(indexes, "MOST_ADDED", most_added)
    vectors = np.random.default_rng(9).normal(0, 0.09, (len(maps[0].xy_m), 128))
    elf = replace(maps[0].payloads[0], vectors=vectors.astype(np.float32))
    upstairs = replace(maps[0], payloads=(elf,))
    code, out = elfslam("publish", map_folder, *MALL, "--floor", 0)
    assert "by its echoes" not in out
    assert by_echoes(guest, maps[0]) == []
    assert elfslam("buildings", "--index")[0] == 0
    assert by_echoes(guest, maps[0]) == [("Mall", 0)]
    write_map(upstairs, map_folder / MAP)
    code, out = elfslam("publish", map_folder, *MALL, "--floor", 1)
    assert code == 0
    assert "found by its echoes" in out
    assert by_echoes(guest, maps[0]) == [("Mall", 0)]
    assert by_echoes(guest, upstairs) == [("Mall", 1)]
    assert elfslam("withdraw", "--building", "Mall", "--floor", 1)[0] == 0
    assert by_echoes(guest, upstairs) == []
    elfslam("publish", map_folder, *MALL, "--floor", 0)
    assert by_echoes(guest, upstairs) == [("Mall", 0)]
    assert by_echoes(guest, maps[0]) == []


def test_a_floor_from_a_map_of_the_server(
    elfslam: Elfslam, owner: TestClient, services: Services, map_folder: Path, walk_folder: Path
) -> None:
    """With the Wi-Fi of the walks that it was made from."""
    with reading(services.sessions) as session:
        mine = session.query(User).filter_by(is_owner=True).one()
    walk_id = plant_files(services, RecordingRow(user_id=mine.id, name="walk"), walk_folder)
    made = Map(user_id=mine.id, name="Hall", kind="run", sources=[walk_id])
    plant_files(services, made, map_folder)
    code, out = elfslam("publish", made.id, *MALL, "--floor", 0)
    assert code == 0
    assert "8 access points" in out
    owner.delete(f"/api/maps/{made.id}").raise_for_status()
    told = owner.post("/api/find", json={"wifi": heard()}).json()["candidates"][0]
    assert owner.get(f"/api/maps/{told['map']}/package").status_code == 200
    with reading(services.sessions) as session:
        assert session.query(Floor).one().radius_m == pytest.approx(21, abs=3)


def test_refusals_in_one_line(elfslam: Elfslam, map_folder: Path, tmp_path: Path) -> None:
    spot = ("--building", "Mall", "--floor", 0)
    (map_folder / "empty").mkdir()
    for arguments, said in (
        (("publish", "nowhere", *spot, "--at", "47,8"), "neither the folder of a map nor the id"),
        (("publish", "0" * 32, *spot, "--at", "47,8"), "is not on this server"),
        (("publish", map_folder, *spot, "--at", "95,8"), "at '95,8': wanted LAT,LON"),
        (("publish", map_folder, "--building", " ", "--floor", 0, "--at", "47,8"), "wanted some"),
        (("publish", tmp_path, *spot, "--at", "47,8"), "has no encoder.onnx"),
        (("publish", map_folder, *spot, "--at", "47,8", "--heard", map_folder), "has no wifi.csv"),
        (("withdraw", *spot), "is not published"),
        (("buildings", "--index"), "no published floor"),
        (
            ("publish", map_folder, *spot, "--at", "47,8", "--files", "gopher://y/z"),
            "wanted such as s3",
        ),
    ):
        code, err = elfslam(*arguments)
        assert (code, said in err) == (2, True), (arguments[3:], err)
        assert len(err.strip().splitlines()) == 1


def test_an_encoder_of_its_own_is_not_indexed(
    elfslam: Elfslam, map_folder: Path, maps: Maps
) -> None:
    elf = replace(maps[0].payloads[0], encoder="f" * 16)
    write_map(replace(maps[0], payloads=(elf,)), map_folder / MAP)
    code, err = elfslam("publish", map_folder, *MALL, "--floor", 0)
    assert code == 2
    assert "lies beside it" in err
