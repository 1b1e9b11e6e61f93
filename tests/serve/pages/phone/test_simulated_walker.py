"""Who has no phone lets a simulated walker walk: the whole way from the first tap to a fix."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from elfslam.base.values import Fixes
from elfslam.base.zips import unpack_zip
from elfslam.data.map_files import read_map
from elfslam.data.position_files import read_fixes
from elfslam.serve.demonstration import FILE
from elfslam.serve.settings import PAGES_FOLDER
from elfslam.slam.floor_location import locate_in_building
from elfslam.slam.parameters import Parameters
from elfslam.stages.feature import load_encoder
from elfslam.stages.levels import LevelParameters
from elfslam.world.building import MultiFloorWorld, load_place
from elfslam.world.simulate_building import simulate_building
from studies.benchmarks import served
from studies.demonstration import AS_PLAYED, BUILDING, FOLDER, SEEDS, write_walk
from tests.serve.pages.phone.conftest import Server

CHIRPS_A_SECOND = 10
WALK_S, WINDOW_S = 90, 0.6
IN_BUILDING = (102, (1,))
"""Seed and plan of a walk upstairs in the demonstration building, on which nothing was chosen."""


@pytest.fixture
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A real server that makes maps."""
    running = Server(tmp_path_factory.mktemp("server") / "data", options=())
    running.start()
    yield running
    running.stop()


@pytest.mark.parametrize("name", SEEDS)
def test_sound_and_motion_of_a_walk_are_as_long(name: str) -> None:
    about, told = (
        soundfile.info(FOLDER / f"{name}.flac"),
        json.loads((FOLDER / f"{name}.json").read_text()),
    )
    assert about.samplerate == 44_100
    assert told["motion"][-1][0] == pytest.approx(about.duration, abs=0.1)
    assert len(told["played"]) == pytest.approx(CHIRPS_A_SECOND * about.duration, abs=5)
    assert len(told["motion"][0]) == 1 + 3 + 3


def test_it_walks_is_mapped_and_somebody_else_is_found(phone: Any, server: Server) -> None:
    phone.open()
    page = phone.page
    page.click("#simulated summary")
    page.click("#simulate")
    phone.wait_for_text("#growing-said", "confirmed by loops")
    phone.wait_for(lambda: page.is_visible("#see-map"), "the map is made")
    (told,) = server.recordings()
    duration_s = soundfile.info(FOLDER / "walk.flac").duration
    assert told["facts"]["duration_s"] > duration_s - 1, "a busy machine stops it later"
    (made,) = server.ask("/api/maps").json()
    assert made["facts"]["status"] == "OK"
    assert made["facts"]["footsteps"] == pytest.approx(told["facts"]["footsteps"], abs=3)

    page.click("#another")
    page.click("#where")
    page.click("text=Get this map")
    page.click("text=Find me here")
    phone.wait_for(lambda: int(phone.text("#place-fixes")) > 40, "it is looked for")
    assert "Here, within" in phone.text("#place-status")
    assert int(phone.text("#place-heard").removesuffix(" %")) > 95
    phone.wait_for_text("#problem", "The simulated walk is over.")
    assert page.get_attribute("#problem", "data-verdict") == "wait", "nothing went wrong"


@pytest.fixture
def upstairs(tmp_path: Path) -> Iterator[tuple[served.Served, Fixes]]:
    """A server where somebody else walks the demonstration building, and their fixes in Python."""
    seed, plan = IN_BUILDING
    place = load_place(BUILDING)
    assert isinstance(place, MultiFloorWorld)
    walked, _ = simulate_building(place, seed, plan=plan, rounds=1, circumstances=AS_PLAYED)
    shutil.copytree(PAGES_FOLDER, tmp_path / "pages")
    write_walk(walked, tmp_path / "pages" / "demonstration", "other")
    unpack_zip(FILE, tmp_path / "maps")
    floors = {level: read_map(tmp_path / "maps" / f"floor {level}") for level in (0, 1)}
    fixes = locate_in_building(
        replace(walked, barometer=None), floors, load_encoder("compact"), Parameters()
    )
    running = served.start(tmp_path / "data", pages=tmp_path / "pages")
    yield running, fixes
    running.kill()


def test_in_a_building_echoes_tell_the_floor_as_in_python(
    browser: Any, upstairs: tuple[served.Served, Fixes], tmp_path: Path
) -> None:
    running, wanted = upstairs
    with running.client() as owner:
        key = owner.get("/api/key").json()["key"]
        made = owner.post("/api/demonstration").raise_for_status().json()
    ids = {each["name"]: each["id"] for each in made}
    low, high = ids["Floor 0"], ids["Floor 1"]
    page = browser.new_page(viewport={"width": 390, "height": 844})
    page.set_default_timeout(1000 * WALK_S)
    page.goto(f"{running.url}#token={running.token}&key={key}")
    page.click("#where")
    page.click(f"[data-map='{low}'] >> text=Get this map")
    page.wait_for_selector(f"[data-map='{high}'] >> text=Find me here")
    page.click("#maps-back")
    page.click("#simulated summary")
    page.click("#simulate")
    page.locator("#heard[data-chirps]:not([data-chirps='0'])").wait_for(state="attached")
    page.click("#stop")  # what is recorded of a lounge stays: somebody else is found now
    page.click("#another")
    page.click("#where")
    page.click(f"[data-map='{low}'] >> text=Find me here")
    page.wait_for_selector("#place-stop:visible")
    page.check("input[value=one-shot]", force=True)
    page.locator("#place-status .what", has_text="Floor unknown").wait_for()
    assert page.inner_text("#place-title") == "Floor 0"
    running.kill()
    page.locator("#place-title", has_text="Floor 1").wait_for()
    page.locator("#problem", has_text="The simulated walk is over.").wait_for()
    with page.expect_download() as download:
        page.click("#place-save")
    download.value.save_as(tmp_path / "fixes.csv")
    page.close()
    got = read_fixes(tmp_path / "fixes.csv")
    assert got.level is not None
    assert wanted.level is not None
    half_s = LevelParameters().vote_s / 2
    later = got.t_s >= wanted.t_s[0] + half_s + WINDOW_S
    asked = np.searchsorted(wanted.t_s, got.t_s[later] - half_s).clip(max=len(wanted.t_s) - 1)
    one, other = (np.nan_to_num(each, nan=-1.0) for each in (got.level[later], wanted.level[asked]))
    assert np.mean(one == other) > 0.9, "half a span later"
