"""The whole way with real jobs: a zip becomes a recording, a map, a place in it."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import pytest

from elfslam.data.recordings import write_recording
from elfslam.stages.chirp import describe_chirp
from elfslam.world.simulate import load_world, simulate

LONGEST_MS = 300_000


@pytest.fixture(scope="module")
def walk_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk with sound, as a phone's owner would have packed it."""
    folder = tmp_path_factory.mktemp("sound")
    recording, _ = simulate(load_world("studio"), 107, rounds=2)
    write_recording(recording, folder / "walk", chirp_description=describe_chirp())
    file = folder / "twice round.zip"
    with zipfile.ZipFile(file, "w") as packed:
        for each in (folder / "walk").iterdir():
            packed.write(each, f"walk/{each.name}")
    return file


@pytest.mark.real
def test_from_a_dropped_zip_to_a_located_walk(
    working_desk: tuple[Any, str], walk_zip: Path
) -> None:
    page, url = working_desk
    page.locator("input[name=recordings]").set_input_files(walk_zip)
    page.get_by_role("link", name="See the map").click(timeout=LONGEST_MS)
    page.get_by_role("heading", level=1).wait_for()
    head = page.locator(".map-head p").inner_text()
    assert "One walk" in head
    assert int(head.split(" place")[0].rsplit("· ", 1)[1]) > 10
    page.get_by_role("button", name="Locate a recording").click()
    page.get_by_role("dialog").get_by_role("button", name="Locate").click()
    page.locator(".legend").get_by_text("located").wait_for(timeout=LONGEST_MS)
    page.goto(f"{url}/desk#/jobs")
    page.get_by_text("Nothing to do at the moment.").wait_for()
    assert page.get_by_text("Done", exact=True).count() == 2
