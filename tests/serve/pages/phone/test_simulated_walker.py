"""Who has no phone lets a simulated walker walk: the whole way from the first tap to a fix."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
import soundfile

from studies.demonstration import FOLDER, SEEDS
from tests.serve.pages.phone.conftest import Server

CHIRPS_A_SECOND = 10


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
