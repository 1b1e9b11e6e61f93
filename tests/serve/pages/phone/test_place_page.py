"""The view "Where am I" in Chromium: maps got and removed, located without a server, by key."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.values import Audio, FixStatus, FloorMap, Payload
from elfslam.data.position_files import read_fixes
from elfslam.serve.buildings.publishing import Spot, floor_of, publish, withdraw
from elfslam.serve.buildings.senses import WifiFindParameters
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, cut_echoes
from elfslam.stages.feature import extract_features, load_encoder
from tests.serve.pages.phone.conftest import Server
from tests.serve.planting import floor_map_of, opened, plant_floor_map
from tests.waiting import until

HERE_M = (3.0, 2.0)
"""Where the map says that it sounds as the fake microphone does."""
SIDE_M, APART_M = 6.0, 0.5
PERMISSIONS = ("microphone", "accelerometer", "gyroscope", "screen-wake-lock")
HEIGHTS_PX = 48
WALK_MS = 180_000
"""Until the page knows a place: sound that stalls on a busy machine begins anew."""
AGAIN_MS = 20_001
"""After so long the list of maps has asked again."""

EVENLY = """
from elfslam.cli import main
from elfslam.serve.maps import package
phone_parameters = package.phone_parameters
def evenly(*groups):
    told = phone_parameters(*groups)
    told["medium_access"] |= {"jitter_s": 0.0, "listen": 0, "forget": 0}
    return told
package.phone_parameters = evenly
main()
"""
"""The fake microphone hears a chirp every 100 ms, whoever plays one; so everybody chirps evenly."""

pytestmark = pytest.mark.real


def map_of(sound: np.ndarray, rate_hz: int) -> FloorMap:
    """A square of spots; at one of them it sounds as heard, elsewhere like nothing."""
    chirp = make_chirp(ChirpParameters(), rate_hz)
    echoes = cut_echoes(Audio(sound[None], rate_hz), chirp, EchoParameters(), None)
    encoder = load_encoder("compact")
    heard = extract_features(echoes, encoder).vectors.mean(axis=0)
    along = np.arange(0, SIDE_M + APART_M / 2, APART_M)
    xy_m = np.stack(np.meshgrid(along, along), axis=2).reshape(-1, 2)
    generator = np.random.default_rng(3)
    vectors = generator.normal(0, 0.09, (len(xy_m), 128)).astype(np.float32)
    vectors[int(np.argmin(np.linalg.norm(xy_m - HERE_M, axis=1)))] = heard
    return floor_map_of(xy_m, vectors, np.pi / 2)


@pytest.fixture(scope="module")
def heard_map(heard: tuple[Path, np.ndarray]) -> FloorMap:
    """A map of the place that the fake microphone is in."""
    return map_of(np.asarray(heard[1] / 32768, dtype=np.float32), 44_100)


@pytest.fixture(scope="module")
def running_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A real server whose maps say that nobody takes turns."""
    running = Server(tmp_path_factory.mktemp("even") / "data", code=EVENLY)
    running.start()
    yield running
    running.stop()


@pytest.fixture
def map_id(server: Any, heard_map: FloorMap) -> Iterator[str]:
    """That map, put on the server where a job would have left it."""
    made_id = plant_floor_map(server.data, heard_map)
    yield made_id
    if server.process is None:
        server.start(server.port)
    server.ask(f"/api/maps/{made_id}", "DELETE")


@pytest.fixture
def published(server: Any, map_id: str) -> Iterator[str]:
    """That map as a floor of a building, which somebody else may find."""
    spot = Spot("North Mall", 2, 47.3769, 8.5417)
    with opened(server.data) as services:
        made = publish(services, floor_of(services, map_id, spot, [], WifiFindParameters()))
        yield made.map_id
        withdraw(services, "North Mall", 2)


def get_map(page: Any, server: Any) -> None:
    """Pair and take the map onto the phone."""
    page.goto(server.address)
    page.click("#where")
    take_map(page)


def take_map(page: Any) -> None:
    page.click("text=Get this map")
    page.wait_for_selector("text=Find me here")
    page.wait_for_selector("#maps-list >> text=Update")  # the server has answered: the list stays


def locate(page: Any, mode: str) -> str:
    """By echoes alone or with steps, until the page says more than that it listens."""
    page.click("text=Find me here")
    page.wait_for_selector("#place-stop:visible")
    page.check(f"input[value={mode}]", force=True)
    wait_for_words(page, "Here, within")
    return str(page.inner_text("#place-status .what"))


def wait_for_words(page: Any, part: str) -> None:
    page.locator("#place-status .what", has_text=part).wait_for(timeout=WALK_MS)


def test_a_map_is_got_once_and_then_needs_no_server(
    pocket: Any, server: Any, map_id: str, tmp_path: Path
) -> None:
    with pocket.on() as page:
        page.goto(server.address)
        page.click("#where")
        assert page.inner_text("#maps-list .badge") == "On the server"
        take_map(page)
        assert page.inner_text("#maps-list .badge") == "On this phone"
        assert "MB" in page.inner_text("#maps-list .soft")
        page.locator("html[data-offline=kept]").wait_for()
    server.stop()
    with pocket.on() as page:
        asked: list[str] = []
        page.goto(server.address.partition("#")[0])
        page.locator("#problem", has_text="work without it").wait_for()
        page.click("#where")
        page.locator("#maps-trouble", has_text="work without it").wait_for()
        page.on("request", lambda request: asked.append(request.url))
        assert locate(page, "one-shot").endswith("\u00a0m")
        page.locator("#place-fixes", has_text="6").wait_for()
        assert int(page.inner_text("#place-heard").rstrip(" %")) >= 90
        page.click("#place-stop")
        assert page.inner_text("#place-status .what") == "Stopped"
        with page.expect_download() as download:
            page.click("#place-save")
        download.value.save_as(tmp_path / "fixes.csv")
    assert [each for each in asked if "/api" in each] == []
    fixes = read_fixes(tmp_path / "fixes.csv")
    known = np.isfinite(fixes.xy_m[:, 0])
    assert (fixes.status[known] == FixStatus.OK).sum() >= 6
    assert set(fixes.status[known]) <= {FixStatus.OK, FixStatus.SUSPECT}, "sound is lost at times"
    np.testing.assert_allclose(fixes.xy_m[known], np.tile(HERE_M, (known.sum(), 1)), atol=0.05)
    np.testing.assert_allclose(fixes.heading_rad[known], np.pi / 2, atol=1e-5)


def test_the_way_to_a_named_place_is_told_and_drawn(pocket: Any, server: Any, map_id: str) -> None:
    """The walker stands at HERE_M and faces along y."""
    named = [
        {"name": "Room 5", "kind": "room", "x_m": HERE_M[0], "y_m": HERE_M[1] + 3.0},
        {"name": "Exit", "kind": "door", "x_m": HERE_M[0] - 2.5, "y_m": HERE_M[1]},
    ]
    points = f"/api/maps/{map_id}/points-of-interest"
    server.ask(points, "PUT", json={"version": "", "points": named})
    with pocket.on() as page:
        get_map(page, server)
        page.click("text=Find me here")
        page.select_option("#way-to", label="Room 5 (room)")
        page.locator("#way-words", has_text="Room 5: told once your place is known").wait_for()
        page.wait_for_selector("#place-stop:visible")
        page.wait_for_timeout(2000)
        assert page.inner_text("#place-status .what") == "Listening", "nothing without steps"
        assert "Walk a few steps" in page.inner_text("#place-status .said")
        page.check("input[value=one-shot]", force=True)
        wait_for_words(page, "Here, within")
        page.locator("#way-words", has_text="Room 5: 3.0\u00a0m, straight ahead").wait_for()
        page.select_option("#way-to", label="Exit (door)")
        page.locator("#way-words", has_text="Exit: 2.5\u00a0m, to the left").wait_for()
        page.locator("#place-map canvas").press("Enter")
        page.locator("#place-spoken", has_text="Exit: 2.5\u00a0m, to the left.").wait_for()
        check_view(page, 390)
        page.select_option("#way-to", label="nowhere")
        assert page.locator("#way-words").is_hidden()


STAIRS = {
    "kind": "stairs", "from_level": 0, "to_level": 1, "duration_s": 15.0,
    "from_xy_m": [3.0, 5.0], "to_xy_m": [0.0, 5.0],
}  # fmt: skip


def joined_above(server: Any, map_id: str, above: FloorMap) -> Iterator[tuple[str, str]]:
    """That map as floor 0 with another above it, joined by stairs; floor 1 has a Room 5."""
    ids = (map_id, plant_floor_map(server.data, above))
    for level, each in enumerate(ids):
        with opened(server.data) as services, transaction(services.sessions) as session:
            row = session.get_one(Map, each)
            row.name, row.floor = f"Mall {level}", str(level)
            row.facts = {"level": level, "frame": map_id, "passages": [STAIRS]}
    named = [{"name": "Room 5", "kind": "room", "x_m": 0.0, "y_m": 1.0}]
    points = f"/api/maps/{ids[1]}/points-of-interest"
    server.ask(points, "PUT", json={"version": "", "points": named})
    yield ids
    if server.process is None:
        server.start(server.port)
    server.ask(f"/api/maps/{ids[1]}", "DELETE")


@pytest.fixture
def alike(map_id: str, server: Any, heard_map: FloorMap) -> Iterator[tuple[str, str]]:
    """A building of two floors that sound the same."""
    yield from joined_above(server, map_id, heard_map)


@pytest.fixture
def unlike(map_id: str, server: Any, heard_map: FloorMap) -> Iterator[tuple[str, str]]:
    """A building of which floor 0 alone sounds as the fake microphone does."""
    (heard,) = heard_map.payloads
    other = Payload("elf", heard.encoder, np.roll(heard.vectors, 1, axis=1))
    above = replace(heard_map, payloads=(other,))
    yield from joined_above(server, map_id, above)


@contextmanager
def without_a_server(pocket: Any, server: Any, floors: tuple[str, str]) -> Iterator[Any]:
    """The floors are got with the first; then the server stops. Gives the list of maps."""
    with pocket.on() as page:
        page.goto(server.address)
        page.click("#where")
        page.click(f"[data-map='{floors[0]}'] >> text=Get this map")
        for each in floors:
            page.wait_for_selector(f"[data-map='{each}'] >> text=Find me here")
        page.locator("html[data-offline=kept]").wait_for()
    server.stop()
    with pocket.on() as page:
        page.goto(server.address.partition("#")[0])
        page.click("#where")
        yield page


def test_echoes_tell_the_floor_without_a_server(
    pocket: Any, server: Any, unlike: tuple[str, str], tmp_path: Path
) -> None:
    """The walker opens the map of floor 1, and stands on floor 0."""
    with without_a_server(pocket, server, unlike) as page:
        page.click(f"[data-map='{unlike[1]}'] >> text=Find me here")
        page.wait_for_selector("#place-stop:visible")
        page.check("input[value=one-shot]", force=True)
        wait_for_words(page, "Floor unknown")
        assert page.inner_text("#place-title") == "Mall 1"
        page.locator("#place-title", has_text="Mall 0").wait_for(timeout=WALK_MS)
        wait_for_words(page, "Here, within")
        pressed = page.locator("#place-floors [aria-pressed=true]")
        assert pressed.get_attribute("aria-label") == "I am on the ground floor now"
        check_view(page, 390)
        page.click("text=On the stairs")
        wait_for_words(page, "Floor unknown")
        wait_for_words(page, "Here, within")
        pause = partial(page.wait_for_timeout, 500)
        until(partial(says_floor_1, page), "a floor that sounds otherwise", between=pause)
        page.locator("#place-title", has_text="Mall 0").wait_for(timeout=WALK_MS)
        page.click("#place-stop")
        with page.expect_download() as download:
            page.click("#place-save")
        download.value.save_as(tmp_path / "fixes.csv")
    fixes = read_fixes(tmp_path / "fixes.csv")
    assert fixes.level is not None
    told = fixes.level[fixes.status == FixStatus.OK]
    assert set(told) == {0.0}
    assert np.isnan(fixes.level[:15]).all(), "nothing is told of the first seconds"
    there = fixes.xy_m[fixes.status == FixStatus.OK]
    np.testing.assert_allclose(there, np.tile(HERE_M, (len(there), 1)), atol=0.05)


def says_floor_1(page: Any) -> bool:
    """Says floor 1, anew where sound was lost until the vote; whether nothing there sounds so."""
    if page.inner_text("#place-title") == "Mall 0":
        page.get_by_role("button", name="I am on floor 1 now").click()
    words = page.inner_text("#place-status .what")
    return page.inner_text("#place-title") == "Mall 1" and words == "An unknown place"


def test_a_way_leads_over_floors_without_a_server(
    pocket: Any, server: Any, alike: tuple[str, str]
) -> None:
    """The walker stands at HERE_M and faces along y, towards the stairs, and says on which floor.

    Echoes cannot: the floors sound the same.
    """
    with without_a_server(pocket, server, alike) as page:
        page.click(f"[data-map='{alike[0]}'] >> text=Find me here")
        page.wait_for_selector("#place-stop:visible")
        page.check("input[value=one-shot]", force=True)
        page.select_option("#way-to", label="Room 5 (room, floor 1)")
        wait_for_words(page, "Floor unknown")
        page.get_by_role("button", name="I am on the ground floor now").click()
        wait_for_words(page, "Here, within")
        first = "first straight ahead, after 3.0\u00a0m take the stairs to floor 1"
        page.locator("#way-words", has_text=f"Room 5, floor 1: 10\u00a0m; {first}").wait_for()
        page.check("#way-stepless")
        page.locator("#way-words", has_text="no way without stairs is known").wait_for()
        page.uncheck("#way-stepless")
        check_view(page, 390)
        assert page.locator("#place-map").bounding_box()["width"] == 390, "below the floors"
        page.click("#way-next")
        page.locator("#place-title", has_text="Mall 1").wait_for()
        page.locator("#way-words", has_text="Room 5: 3.2\u00a0m").wait_for(timeout=WALK_MS)
        assert page.locator("#way-next").is_hidden()


def test_a_guest_is_located_by_a_link_and_without_an_account(
    pocket: Any, server: Any, map_id: str
) -> None:
    link = f"/api/maps/{map_id}/link"
    told = server.ask(link, "PUT", json={"may": "read"}).json()["link"]["url"]
    card = f"[data-map='{map_id}']"
    with pocket.on() as page:
        page.goto(told.replace("/desk#", "/#"))
        page.wait_for_selector(f"{card} >> text=Get this map")
        assert "#" not in page.url
        for hidden in ("#pair", "#problem", "#maps-near"):
            assert page.locator(hidden).is_hidden(), hidden
        assert "shared by owner" in page.inner_text(f"{card} .soft")
        check_view(page, 390)
        take_map(page)
        assert locate(page, "one-shot").endswith("\u00a0m")
    with pocket.on() as page:  # another day
        page.clock.install()
        page.goto(server.address.partition("#")[0])
        page.click("#where")
        page.wait_for_selector(f"{card} >> text=Update")
        assert page.locator("#problem").is_hidden()
        assert server.ask(link, "DELETE").status_code == 204
        page.clock.fast_forward(AGAIN_MS)
        page.locator(f"{card} >> text=Update").wait_for(state="detached")  # without a reload
        assert page.locator(f"{card} >> text=Find me here").is_visible(), "it stays on the phone"
        page.goto(told.replace("/desk#", "/#"))
        page.reload()
        page.locator("#problem", has_text="this link was withdrawn").wait_for()


def test_a_floor_is_found_by_where_the_phone_is(pocket: Any, server: Any, published: str) -> None:
    floor = f"[data-map='{published}']"
    with pocket.on() as page:
        page.clock.install()
        page.goto(server.address)
        page.click("#where")
        page.click("#maps-near")
        refusal = page.locator("#maps-trouble", has_text="allow it in the browser's settings")
        refusal.wait_for()
        for _ in range(2):  # when the second answer is here, the first was shown
            with page.expect_response("**/api/maps"):
                page.clock.fast_forward(AGAIN_MS)
        assert refusal.is_visible()
        page.context.grant_permissions([*PERMISSIONS, "geolocation"])
        page.context.set_geolocation({"latitude": 47.0, "longitude": 8.5417, "accuracy": 30})
        page.click("#maps-near")
        page.locator("#maps-trouble", has_text="No map of a place near here").wait_for()
        page.context.set_geolocation({"latitude": 47.3769, "longitude": 8.5417, "accuracy": 30})
        page.reload()
        page.click("#where")
        page.click("#maps-near")
        page.wait_for_selector(floor)
        assert page.inner_text(f"{floor} h3") == "North Mall, floor 2"
        assert page.inner_text("#maps-list .venue") == "North Mall"
        check_view(page, 390)
        page.click(f"{floor} >> text=Get this map")
        page.wait_for_selector(f"{floor} >> text=Find me here")
        page.context.grant_permissions(PERMISSIONS)
    with pocket.on() as page:  # whose clock goes with its sound's
        page.goto(server.address)
        page.click("#where")
        locate(page, "one-shot")
        page.click("#place-back")
        page.wait_for_selector(f"{floor} >> text=Update")


def positions_in(server: Any, map_id: str) -> list[Any]:
    """Who may be seen there at this moment."""
    return list(server.ask(f"/api/maps/{map_id}/positions").json())


def placed_in(server: Any, map_id: str) -> list[Any]:
    """Those of them whose place is known: a busy machine loses sound, and then it is not."""
    return [each for each in positions_in(server, map_id) if each["status"] == FixStatus.OK.name]


def test_others_see_the_walker_only_while_they_say_so(
    pocket: Any, server: Any, map_id: str
) -> None:
    with pocket.on() as page:
        sent: list[Any] = []
        get_map(page, server)
        page.on("request", lambda each: sent.append(each) if "positions" in each.url else None)
        assert not page.locator("#place-tell").is_visible()
        locate(page, "one-shot")
        switch = page.get_by_role("switch", name="Let others see where I am")
        assert not switch.is_checked()
        assert page.inner_text("#place-sent") == "Nothing is sent"
        page.locator("#place-fixes", has_text="4").wait_for()
        assert sent == []
        switch.check()
        page.get_by_role("switch", name="Others see where you are: Hall").wait_for()
        assert page.inner_text("#place-sent") == "Positions are sent"
        pause = partial(page.wait_for_timeout, 100)
        [live] = until(lambda: placed_in(server, map_id), "a place", between=pause)
        assert [live["x_m"], live["y_m"]] == pytest.approx(HERE_M, abs=0.05)
        assert live["name"] == "owner"
        assert live["heading_rad"] == pytest.approx(np.pi / 2, abs=1e-3)
        page.click("#place-stop")
        until(lambda: not positions_in(server, map_id), "the end", between=pause)
        assert not page.locator("#place-tell").is_visible()
        before = len(sent)
        page.click("#place-start")
        wait_for_words(page, "Here, within")
        assert not page.get_by_role("switch", name="Let others see where I am").is_checked()
        page.wait_for_timeout(1500)
        assert len(sent) == before
        settings = f"/api/maps/{map_id}/positions/settings"
        server.ask(settings, "PUT", json={"is_on": False})
        page.get_by_role("switch", name="Let others see where I am").check()
        page.locator("#problem", has_text="switched live positions off").wait_for()
        assert not page.get_by_role("switch", name="Let others see where I am").is_checked()
        assert page.locator("#place-stop").is_visible()
        assert server.ask("/api/positions").json() != []
        page.click("#place-back")
        page.get_by_role("button", name="Delete my positions").click()
        page.locator("#positions-forget-help", has_text="Deleted").wait_for()
        assert server.ask("/api/positions").json() == []


def test_the_map_obeys_keys_and_fits_and_is_removed_only_when_asked_twice(
    pocket: Any, server: Any, map_id: str
) -> None:
    with pocket.on() as page:
        get_map(page, server)
        check_sizes(page)
        locate(page, "one-shot")
        check_keys(page)
        page.get_by_role("switch", name="Let others see where I am").check()
        page.get_by_role("switch", name="Others see where you are").wait_for()
        check_sizes(page, ".place-panel")
        page.click("#place-back")
        page.click("text=Remove")
        page.click("text=Keep it >> visible=true")
        assert page.inner_text("#maps-list .badge") == "On this phone"
        page.click("#maps-list >> text=Remove")
        page.click("#ask-remove >> button:has-text('Remove')")
        page.wait_for_selector("text=Get this map")


def check_keys(page: Any) -> None:
    """The map zooms, pans, follows and speaks by keys and buttons."""
    follow = page.locator(".follow")
    assert follow.get_attribute("aria-pressed") == "true"
    page.focus("#place canvas")
    before = page.inner_text(".scale-bar")
    page.keyboard.press("+")
    page.keyboard.press("+")
    page.locator(".scale-bar").filter(has_not_text=before).wait_for()
    assert follow.get_attribute("aria-pressed") == "true"
    page.keyboard.press("ArrowLeft")
    assert follow.get_attribute("aria-pressed") == "false"
    page.keyboard.press("f")
    assert follow.get_attribute("aria-pressed") == "true"
    spoken = page.locator("#place-spoken", has_text="At 3.0 across and 2.0 up, facing north")
    asks = partial(page.keyboard.press, "Enter")
    until(lambda: asks() or spoken.count(), "the place: a busy machine loses sound at times")
    page.click("[aria-label='Show all']")
    assert follow.get_attribute("aria-pressed") == "false"


def check_sizes(page: Any, panel: str | None = None) -> None:
    """It fits small and large screens and can be tapped; the panel leaves room for the map."""
    for width, height in ((320, 568), (1280, 800), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        check_view(page, width)
        if panel is not None:
            box = page.locator(panel).bounding_box()
            assert box["y"] + box["height"] <= height + 1
            assert page.locator("#place-map").bounding_box()["height"] > 0.25 * height


def check_view(page: Any, width: int) -> None:
    """Nothing is wider than the page, and whatever is tapped is large enough."""
    assert page.locator("main").bounding_box()["width"] <= width
    for button in page.locator("button:visible, #place-mode label:visible").all():
        box = button.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert box["height"] >= HEIGHTS_PX - 8, button.inner_text()
