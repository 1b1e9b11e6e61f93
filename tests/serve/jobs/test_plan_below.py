"""Walks whose walkers tapped on the floor plan of another map: their maps lie on that plan."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from elfslam.base.geometry import compose
from elfslam.base.values import Checkpoints
from elfslam.data.map_files import BY_TAPS
from elfslam.data.recordings import MANIFEST, read_recording, write_recording
from elfslam.scoring.truth import read_truth
from elfslam.serve.jobs.tasks import frame_of
from elfslam.serve.receiving.reader import find
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Map, Recording, RecordingState
from elfslam.stages.chirp import describe_chirp
from tests.serve.jobs.conftest import start
from tests.serve.planting import plant_files

pytestmark = pytest.mark.real

Json = dict[str, Any]
Wait = Callable[[TestClient, str], Json]
PLAN_FROM_WORLD = np.array([40.0, 7.0, -1.2])
PLACEMENT = {"width_m": 24.0, "x_m": 1.0, "y_m": 2.0, "heading_rad": 0.0, "opacity": 0.5}


@pytest.fixture
def tapped(walks: Path, tmp_path: Path) -> Path:
    """The walk without sound, tapped on the plan."""
    return tapped_walk(walks / "mute", tmp_path / "tapped")


def tapped_walk(walk: Path, folder: Path) -> Path:
    """A walk with taps on a plan near its start and some way on."""
    recording, truth = read_recording(walk), read_truth(walk)
    t_s = truth.t_s[0] + np.array([1.5, 0.4 * (truth.t_s[-1] - truth.t_s[0])])
    at = np.searchsorted(truth.t_s, t_s)
    xy_m = compose(PLAN_FROM_WORLD, truth.world_from_body[at])[:, :2]
    told = Checkpoints(t_s, ("Way in", "Window"), xy_m)
    played = None if recording.audio is None else describe_chirp()
    named = replace(recording, checkpoints=told)
    write_recording(named, folder, chirp_description=played)
    return folder


def on_plan_of(client: TestClient, map_id: str) -> str:
    """Lay the map on a venue's floor, above a plan; gives the map again."""
    image = io.BytesIO()
    Image.new("RGB", (240, 120), "white").save(image, "PNG")
    address, kind = f"/api/maps/{map_id}/floor-plan", {"Content-Type": "image/png"}
    client.put(address, content=image.getvalue(), headers=kind).raise_for_status()
    client.put(f"{address}/placement", json=PLACEMENT).raise_for_status()
    place = {"venue": "North Mall", "floor": "Ground floor"}
    client.patch(f"/api/maps/{map_id}", json=place).raise_for_status()
    return map_id


def mapped(
    client: TestClient,
    services: Services,
    folder: Path,
    map_id: str,
    ended: Wait,
    by: str = "motion",
) -> tuple[Json, Json]:
    """The map that a job makes of a walk that names the map that was tapped on, and its view."""
    user_id = client.get("/api/me").json()["id"]
    row = Recording(
        user_id=user_id, name="Tapped", state=RecordingState.READY, facts={"tapped_on": map_id}
    )
    recording = plant_files(services, row, folder)
    job = ended(client, start(client, kind="map", recording=recording, by=[by]))
    address = f"/api/maps/{job['gave']['map']}"
    return client.get(address).json(), client.get(f"{address}/view").json()


def test_its_map_lies_on_that_plan(
    owner: TestClient,
    services: Services,
    put_map: Callable[..., str],
    walks: Path,
    tapped: Path,
    ended: Wait,
) -> None:
    planned = on_plan_of(owner, put_map(owner))
    made, view = mapped(owner, services, tapped, planned, ended)
    assert made["facts"]["heading"] == "by taps on a floor plan"
    assert (made["venue"], made["floor"]) == ("North Mall", "Ground floor")
    assert made["floor_plan"]["placement"] == PLACEMENT
    images = [owner.get(f"/api/maps/{each}/floor-plan").content for each in (planned, made["id"])]
    assert images[0] == images[1]
    truth = read_truth(walks / "mute")
    walk = view["walks"][0]
    at = np.searchsorted(truth.t_s, walk["t_s"]).clip(max=len(truth.t_s) - 1)
    where_m = compose(PLAN_FROM_WORLD, truth.world_from_body[at])[:, :2]
    assert np.linalg.norm(np.array(walk["xy_m"]) - where_m, axis=1).mean() < 1.0


def test_maps_on_one_plan_are_merged_there_without_being_compared(
    owner: TestClient,
    services: Services,
    put_map: Callable[..., str],
    walks: Path,
    tmp_path: Path,
    ended: Wait,
) -> None:
    planned = on_plan_of(owner, put_map(owner))
    maps = [
        mapped(owner, services, tapped_walk(walks / name, tmp_path / name), planned, ended, "elf")
        for name in ("one", "two")
    ]
    merged = ended(owner, start(owner, kind="merge", maps=[made["id"] for made, _ in maps]))
    made = owner.get(f"/api/maps/{merged['gave']['map']}").json()
    assert (made["facts"]["walks"], made["facts"]["pairs"]) == (2, [])
    assert made["floor_plan"]["placement"] == PLACEMENT
    assert made["venue"] == "North Mall"
    moved_m = [
        np.array(after["xy_m"]).mean(axis=0) - np.array(before["walks"][0]["xy_m"]).mean(axis=0)
        for after, (_, before) in zip(
            owner.get(f"/api/maps/{made['id']}/view").json()["walks"], maps, strict=True
        )
    ]
    assert np.linalg.norm(moved_m, axis=1).max() < 0.5
    again = tapped_walk(walks / "one", tmp_path / "again")
    third, _ = mapped(owner, services, again, planned, ended, "elf")
    grown = ended(owner, start(owner, kind="merge", maps=[made["id"], third["id"]]))
    more = owner.get(f"/api/maps/{grown['gave']['map']}").json()
    assert (more["facts"]["walks"], more["facts"]["pairs"]) == (3, [])
    assert more["facts"]["frame"] == made["facts"]["frame"] == planned
    assert more["floor_plan"]["placement"] == PLACEMENT


def test_each_plan_is_aframe_of_its_own(
    owner: TestClient, services: Services, put_map: Callable[..., str]
) -> None:
    """Walks tapped on one map share its frame; others, and those that were not laid, do not."""
    user_id = owner.get("/api/me").json()["id"]
    plans = [put_map(owner), put_map(owner)]
    rows = [
        Recording(user_id=user_id, name="Tapped", facts={"tapped_on": plan})
        for plan in (plans[0], plans[0], plans[1], plans[0])
    ]
    with transaction(services.sessions) as session:
        session.add_all(rows)
        session.flush()
        sources = [row.id for row in rows]
    headings = [BY_TAPS, BY_TAPS, BY_TAPS, "declared"]
    maps = [
        put_map(owner, sources=[source], facts={"heading": heading})
        for source, heading in zip(sources, headings, strict=True)
    ]
    with reading(services.sessions) as session:
        frames = [frame_of(session, session.get_one(Map, each)) for each in (*maps, plans[0])]
    assert frames == [plans[0], plans[0], plans[1], maps[3], plans[0]]


def test_a_map_tapped_on_a_tapped_map_has_theframe_of_the_first(
    owner: TestClient, services: Services, put_map: Callable[..., str]
) -> None:
    user_id = owner.get("/api/me").json()["id"]
    first = made = put_map(owner)
    for _ in range(2):
        with transaction(services.sessions) as session:
            row = Recording(user_id=user_id, name="Tapped", facts={"tapped_on": made})
            session.add(row)
            session.flush()
            source = row.id
        made = put_map(owner, sources=[source], facts={"heading": BY_TAPS})
    with reading(services.sessions) as session:
        assert frame_of(session, session.get_one(Map, made)) == first


def test_a_plan_that_is_not_shared_stays_where_it_is(
    owner: TestClient,
    guest: TestClient,
    services: Services,
    put_map: Callable[..., str],
    tapped: Path,
    ended: Wait,
) -> None:
    planned = on_plan_of(owner, put_map(owner))
    made, _ = mapped(guest, services, tapped, planned, ended)
    assert made["facts"]["heading"] == "by taps on a floor plan"
    assert (made["venue"], made["floor_plan"]) == (None, None)


def test_a_recording_says_on_which_map_was_tapped(tapped: Path, tmp_path: Path) -> None:
    for told, read in (("a" * 32, {"tapped_on": "a" * 32}), ("../x", {}), (7, {})):
        folder = shutil.copytree(tapped, tmp_path / "said", dirs_exist_ok=True)
        manifest = json.loads((folder / MANIFEST).read_text())
        (folder / MANIFEST).write_text(json.dumps({**manifest, "tapped_on": told}))
        facts = find(folder).facts
        assert {key: facts[key] for key in facts if key == "tapped_on"} == read
