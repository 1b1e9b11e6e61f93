"""Walks whose walkers tapped on the floor plan of another map: their maps lie on that plan."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.geometry import compose
from elfslam.base.values import Checkpoints
from elfslam.data.map_files import BY_TAPS
from elfslam.data.recordings import MANIFEST, read_recording, write_recording
from elfslam.scoring.truth import read_truth
from elfslam.serve.jobs.tasks import frame_of
from elfslam.serve.receiving.reader import find
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Map
from elfslam.stages.chirp import describe_chirp
from tests.serve.conftest import Json, Somebody
from tests.serve.planting import picture, put_plan

pytestmark = pytest.mark.real

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


def on_plan_of(client: Somebody, map_id: str) -> str:
    """Lay the map on a venue's floor, above a plan; gives the map again."""
    put_plan(client, map_id, picture("PNG", 240, 120)).raise_for_status()
    placement = f"/api/maps/{map_id}/floor-plan/placement"
    client.put(placement, json=PLACEMENT).raise_for_status()
    place = {"venue": "North Mall", "floor": "Ground floor"}
    client.patch(f"/api/maps/{map_id}", json=place).raise_for_status()
    return map_id


def mapped(client: Somebody, folder: Path, map_id: str, by: str = "motion") -> tuple[Json, Json]:
    """The map that a job makes of a walk that names the map that was tapped on, and its view."""
    recording = client.remember("Tapped", folder, facts={"tapped_on": map_id})
    job = client.done(kind="map", recording=recording, by=[by])
    address = f"/api/maps/{job['gave']['map']}"
    return client.get(address).json(), client.get(f"{address}/view").json()


def test_its_map_lies_on_that_plan(owner: Somebody, walks: Path, tapped: Path) -> None:
    planned = on_plan_of(owner, owner.put_map())
    made, view = mapped(owner, tapped, planned)
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
    owner: Somebody, walks: Path, tmp_path: Path
) -> None:
    planned = on_plan_of(owner, owner.put_map())
    maps = [
        mapped(owner, tapped_walk(walks / name, tmp_path / name), planned, "elf")
        for name in ("one", "two")
    ]
    merged = owner.done(kind="merge", maps=[made["id"] for made, _ in maps])
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
    third, _ = mapped(owner, again, planned, "elf")
    grown = owner.done(kind="merge", maps=[made["id"], third["id"]])
    more = owner.get(f"/api/maps/{grown['gave']['map']}").json()
    assert (more["facts"]["walks"], more["facts"]["pairs"]) == (3, [])
    assert more["facts"]["frame"] == made["facts"]["frame"] == planned
    assert more["floor_plan"]["placement"] == PLACEMENT


def tapped_map(client: Somebody, plan: str, heading: str = BY_TAPS) -> str:
    """A map of a walk that was tapped on that plan."""
    source = client.remember("mute", facts={"tapped_on": plan})
    return client.put_map(sources=[source], facts={"heading": heading})


def test_each_plan_is_a_frame_of_its_own(owner: Somebody, services: Services) -> None:
    """Walks tapped on one map share its frame; others, and those that were not laid, do not."""
    plans = [owner.put_map(), owner.put_map()]
    taps = ((plans[0], BY_TAPS), (plans[0], BY_TAPS), (plans[1], BY_TAPS), (plans[0], "declared"))
    maps = [tapped_map(owner, plan, heading) for plan, heading in taps]
    with reading(services.sessions) as session:
        frames = [frame_of(session, session.get_one(Map, each)) for each in (*maps, plans[0])]
    assert frames == [plans[0], plans[0], plans[1], maps[3], plans[0]]


def test_a_map_tapped_on_a_tapped_map_has_the_frame_of_the_first(owner: Somebody) -> None:
    first = owner.put_map()
    made = tapped_map(owner, tapped_map(owner, first))
    with reading(owner.services.sessions) as session:
        assert frame_of(session, session.get_one(Map, made)) == first


def test_a_plan_that_is_not_shared_stays_where_it_is(
    owner: Somebody, guest: Somebody, tapped: Path
) -> None:
    planned = on_plan_of(owner, owner.put_map())
    made, _ = mapped(guest, tapped, planned)
    assert made["facts"]["heading"] == "by taps on a floor plan"
    assert (made["venue"], made["floor_plan"]) == (None, None)


def test_a_recording_says_on_which_map_was_tapped(tapped: Path, tmp_path: Path) -> None:
    for told, read in (("a" * 32, {"tapped_on": "a" * 32}), ("../x", {}), (7, {})):
        folder = shutil.copytree(tapped, tmp_path / "said", dirs_exist_ok=True)
        manifest = json.loads((folder / MANIFEST).read_text())
        (folder / MANIFEST).write_text(json.dumps({**manifest, "tapped_on": told}))
        facts = find(folder).facts
        assert {key: facts[key] for key in facts if key == "tapped_on"} == read
