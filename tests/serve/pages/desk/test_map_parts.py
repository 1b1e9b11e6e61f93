"""What is beside the map at the desk: named places, who walks there now, and other programs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import MapShare
from tests.serve.pages.desk.conftest import Person, go
from tests.serve.pages.desk.test_map import drawn, layer, opened, pixels, px_per_m, tapped, xy_of

pytestmark = pytest.mark.real


def points_of(ada: Person, map_id: str) -> list[dict[str, Any]]:
    return list(ada.get(f"/api/maps/{map_id}/points-of-interest")["points"])


def name_it(page: Any, name: str, kind: str) -> None:
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_label("Kind").select_option(label=kind)
    page.get_by_role("dialog").get_by_role("button", name="Save").click()
    page.locator(".points li", has_text=name).wait_for()


def test_a_place_is_named_by_a_tap_changed_and_forgotten(
    ada: Person, map_id: str, run_folder: Path
) -> None:
    page = opened(ada.open(), map_id)
    there = xy_of(run_folder)[10]
    before = pixels(page)
    page.get_by_role("button", name="Name a place").click()
    tapped(page, run_folder, tuple(there))
    name_it(page, "Room 5", "room")
    (kept,) = points_of(ada, map_id)
    assert (kept["name"], kept["kind"]) == ("Room 5", "room")
    near = 2 / px_per_m(page)
    assert [kept["x_m"], kept["y_m"]] == pytest.approx(there.tolist(), abs=near)
    drawn(page)
    assert (pixels(page) != before).any()
    layer(page, "Named places", on=False)
    layer(page, "Named places", on=True)
    page.get_by_role("button", name="Change Room 5").click()
    page.get_by_label("x, m").fill("1.25")
    name_it(page, "Lift", "lift")
    (kept,) = points_of(ada, map_id)
    assert (kept["name"], kept["kind"], kept["x_m"]) == ("Lift", "lift", 1.25)
    page.get_by_role("button", name="Delete Lift").click()
    page.get_by_role("button", name="Delete for good").click()
    page.get_by_text("Rooms, doors and lifts get a name here").wait_for()
    assert points_of(ada, map_id) == []


def test_a_place_is_named_by_the_keyboard_alone(ada: Person, map_id: str) -> None:
    page = opened(ada.open(), map_id)
    page.get_by_role("button", name="Name a place").press("Enter")
    page.get_by_role("button", name="Type where it is").press("Enter")
    page.get_by_label("x, m").fill("-2")
    page.get_by_label("y, m").fill("3.5")
    name_it(page, "Stairs <b>down</b>", "stairs")
    (kept,) = points_of(ada, map_id)
    assert (kept["name"], kept["x_m"], kept["y_m"]) == ("Stairs <b>down</b>", -2.0, 3.5)


def test_what_somebody_else_named_meanwhile_is_shown_and_kept(ada: Person, map_id: str) -> None:
    page = opened(ada.open(), map_id)
    page.get_by_text("Rooms, doors and lifts get a name here").wait_for()
    theirs = {"name": "Their door", "kind": "door", "x_m": 0.0, "y_m": 0.0}
    named = {"version": "", "points": [theirs]}
    ada.ask(f"/api/maps/{map_id}/points-of-interest", "PUT", json=named).raise_for_status()
    page.get_by_role("button", name="Name a place").click()
    page.get_by_role("button", name="Type where it is").click()
    page.get_by_label("Name", exact=True).fill("Mine")
    page.get_by_role("dialog").get_by_role("button", name="Save").click()
    page.get_by_text("somebody else changed these places meanwhile").wait_for()
    page.locator(".points li", has_text="Their door").wait_for()
    assert points_of(ada, map_id) == [theirs]
    ada.problems.clear()


WALK = "0123456789abcdef"


Tell = Callable[..., int]


@pytest.fixture
def tell(ada: Person, map_id: str) -> Tell:
    """What a phone of the same person sends; gives the status of the answer."""

    def told(*fixes: dict[str, Any], **more: Any) -> int:
        sent = {"map": map_id, "walk": WALK, "positions": list(fixes), **more}
        return ada.ask("/api/positions", "POST", json=sent).status_code

    return told


def watched(page: Any, map_id: str) -> Any:
    go(page, f"#/maps/{map_id}")
    page.get_by_text("Nobody at this moment").wait_for()
    return page


HERE = {"status": "OK", "x_m": 1.0, "y_m": 1.0, "heading_rad": 0.0, "sigma_m": 0.4}


def picture(page: Any) -> str:
    page.evaluate("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
    return str(page.evaluate("document.querySelector('.stage canvas').toDataURL()"))


def test_a_walker_comes_moves_and_goes(ada: Person, map_id: str, tell: Tell) -> None:
    page = watched(ada.open(), map_id)
    row = page.locator(".live li")
    empty = picture(page)
    assert tell(HERE) == 204
    row.get_by_text("Ada").wait_for()
    assert "located" in row.inner_text()
    there = picture(page)
    assert there != empty
    assert tell({**HERE, "status": "AMBIGUOUS", "x_m": 2.0}) == 204
    row.get_by_text("several places sound alike").wait_for()
    assert picture(page) not in (there, empty)
    assert row.count() == 1
    assert tell(is_over=True) == 204
    page.get_by_text("Nobody at this moment").wait_for()
    assert picture(page) == empty


def test_who_was_there_before_is_shown_and_the_owner_may_switch_it_off(
    ada: Person, map_id: str, tell: Tell
) -> None:
    assert tell(HERE) == 204
    page = ada.open()
    go(page, f"#/maps/{map_id}")
    switch = page.get_by_role("switch", name="Take and show live positions")
    page.locator(".live li", has_text="Ada").wait_for()
    assert switch.is_checked()
    switch.uncheck()
    page.get_by_text("Nobody's position is taken for this map").wait_for()
    assert ada.get(f"/api/maps/{map_id}/positions/settings")["is_on"] is False
    assert tell(HERE) == 409
    switch.check()
    page.get_by_text("Nobody at this moment").wait_for()
    assert tell(HERE) == 204
    page.locator(".live li", has_text="Ada").wait_for()


def test_a_map_gets_its_place_on_the_earth_and_exports_know_it(
    ada: Person, map_id: str, tmp_path: Path
) -> None:
    page = opened(ada.open(), map_id)
    page.get_by_label("Latitude, °").fill("47.3769")
    save = page.locator("#part-programs ~ form").get_by_role("button", name="Save")
    save.click()
    page.get_by_text("Latitude and longitude are wanted together.").wait_for()
    page.get_by_label("Longitude, °").fill("-8.5417")
    save.click()
    page.get_by_text("Saved", exact=True).wait_for()
    told = ada.get(f"/api/maps/{map_id}/positions/settings")
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
    assert ada.get(f"/api/maps/{map_id}/positions/settings")["origin"] is None


def test_a_webhook_is_added_told_its_secret_and_deleted(ada: Person, map_id: str) -> None:
    page = opened(ada.open(), map_id)
    page.get_by_label("Post positions to this address").fill("https://9.9.9.9/positions")
    page.get_by_role("button", name="Add a webhook").click()
    dialog = page.get_by_role("dialog", name="The secret of this webhook")
    assert len(dialog.get_by_label("Secret").input_value()) >= 32
    dialog.get_by_role("button", name="Close").click()
    page.locator(".hooks li", has_text="https://9.9.9.9/positions 0 delivered").wait_for()
    assert len(ada.get(f"/api/maps/{map_id}/webhooks")) == 1
    page.get_by_role("button", name="Delete https://9.9.9.9/positions").click()
    page.get_by_role("button", name="Delete for good").click()
    page.locator(".hooks", has_not_text="9.9.9.9").wait_for(state="attached")
    assert ada.get(f"/api/maps/{map_id}/webhooks") == []


def test_who_only_looks_at_a_map_is_not_offered_either(
    ada: Person, invite: Any, map_id: str
) -> None:
    reader = invite("Reader")
    with transaction(ada.services.sessions) as session:
        session.add(MapShare(map_id=map_id, user_id=reader.id, may="edit"))
    page = opened(reader.open(), map_id)
    page.get_by_role("heading", name="Live positions").wait_for()
    assert page.get_by_role("heading", name="Other programs").count() == 0
