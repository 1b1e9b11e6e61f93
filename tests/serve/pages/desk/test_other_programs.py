"""Where a map lies on the Earth and who is posted positions in it, set on the desk in a browser."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import MapShare
from tests.serve.pages.desk.test_map import opened

pytestmark = pytest.mark.real
Open = Callable[..., Any]


@pytest.fixture
def map_id(person: Any, run_folder: Path) -> str:
    """A planted map of one walk."""
    return str(person.plant_map("round the studio", run_folder))


def test_a_map_gets_its_place_on_the_earth_and_exports_know_it(
    person: Any, open_desk: Open, map_id: str, asked: Any, tmp_path: Path
) -> None:
    page = opened(open_desk(person), map_id)
    page.get_by_label("Latitude, °").fill("47.3769")
    save = page.locator("#part-programs ~ form").get_by_role("button", name="Save")
    save.click()
    page.get_by_text("Latitude and longitude are wanted together.").wait_for()
    page.get_by_label("Longitude, °").fill("-8.5417")
    save.click()
    page.get_by_text("Saved", exact=True).wait_for()
    told = asked(page, f"/api/maps/{map_id}/positions/settings")
    place = {"latitude_deg": 47.3769, "longitude_deg": -8.5417, "bearing_deg": 90.0}
    assert told == {"is_on": True, "origin": place}
    with page.expect_download() as coming:
        page.get_by_role("button", name="Download as geojson").click()
    coming.value.save_as(tmp_path / "m.geojson")
    first = json.loads((tmp_path / "m.geojson").read_text())["features"][0]
    longitude, latitude = first["geometry"]["coordinates"][0][:2]
    assert (latitude, longitude) == pytest.approx((47.3769, -8.5417), abs=1e-3)
    page.reload()
    opened(page, map_id)
    page.locator("input[name=bearing_deg]").wait_for()
    page.get_by_label("Latitude, °").fill("")
    page.get_by_label("Longitude, °").fill("")
    page.get_by_label("Bearing, °").fill("")
    save.click()
    page.get_by_text("Saved", exact=True).wait_for()
    assert asked(page, f"/api/maps/{map_id}/positions/settings")["origin"] is None


def test_a_webhook_is_added_told_its_secret_and_deleted(
    person: Any, open_desk: Open, map_id: str, asked: Any
) -> None:
    page = opened(open_desk(person), map_id)
    page.get_by_label("Post positions to this address").fill("https://9.9.9.9/positions")
    page.get_by_role("button", name="Add a webhook").click()
    dialog = page.get_by_role("dialog", name="The secret of this webhook")
    assert len(dialog.get_by_label("Secret").input_value()) >= 32
    dialog.get_by_role("button", name="Close").click()
    page.locator(".hooks li", has_text="https://9.9.9.9/positions 0 delivered").wait_for()
    assert len(asked(page, f"/api/maps/{map_id}/webhooks")) == 1
    page.get_by_role("button", name="Delete https://9.9.9.9/positions").click()
    page.get_by_role("button", name="Delete for good").click()
    page.locator(".hooks", has_not_text="9.9.9.9").wait_for(state="attached")
    assert asked(page, f"/api/maps/{map_id}/webhooks") == []


def test_who_only_looks_at_a_map_is_not_offered_either(
    person: Any, invite: Any, open_desk: Open, map_id: str
) -> None:
    reader = invite("Reader")
    with transaction(person.services.sessions) as session:
        session.add(MapShare(map_id=map_id, user_id=reader.id, may="edit"))
    page = opened(open_desk(reader), map_id)
    page.get_by_role("heading", name="Live positions").wait_for()
    assert page.get_by_role("heading", name="Other programs").count() == 0
