"""Maps that are shared, with people and by link, and the places they lie in: in real browsers."""

from typing import Any

from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map, MapShare
from tests.serve.pages.desk.conftest import Person, go, row


def shared(ada: Person, map_id: str, other: Any, may: str) -> None:
    with transaction(ada.services.sessions) as session:
        session.add(MapShare(map_id=map_id, user_id=other.id, may=may))


EVERYONE = "What everyone may do who has the link"


def sharing(page: Any) -> Any:
    """What asks with whom the map is shared."""
    page.get_by_role("button", name="Share round the studio").click()
    return page.get_by_role("dialog", name="Share round the studio")


def let(dialog: Any, who: str, may: str) -> None:
    """Let somebody read or edit, or nothing."""
    dialog.get_by_label(who).select_option(may)
    dialog.get_by_text("Saved").wait_for()


def share_by_link(page: Any) -> str:
    dialog = sharing(page)
    let(dialog, EVERYONE, "read")
    address = dialog.get_by_role("textbox", name="Address").input_value()
    dialog.get_by_role("button", name="Close").click()
    return str(address)


def test_ada_shares_a_map_with_eve_who_opens_it_and_cannot_delete_it(
    ada: Person, eve: Person
) -> None:
    map_id = ada.plant_map("round the studio")
    adas = ada.open("#/maps")
    dialog = sharing(adas)
    let(dialog, f"What {eve.name} may do", "read")
    dialog.get_by_role("button", name="Close").click()
    row(adas, "round the studio").get_by_text("shared with 1 person").wait_for()
    eves = eve.open("#/maps")
    line = row(eves, "round the studio")
    line.get_by_text("Shared by Ada").wait_for()
    assert line.get_by_role("button", name="Delete round the studio").count() == 0
    assert line.get_by_role("button", name="Rename round the studio").count() == 0
    line.get_by_role("link", name="Open round the studio").click()
    eves.get_by_role("heading", name="round the studio", level=1).wait_for()
    eves.wait_for_selector(".stage canvas")
    assert "shared by Ada" in eves.locator(".map-head p").inner_text()
    assert eves.get_by_role("button", name="Delete round the studio").count() == 0
    assert eves.get_by_text("Choose an image").count() == 0, "a plan is for who may edit"
    refused = eves.context.request.delete(f"{eve.origin}/api/maps/{map_id}")
    assert refused.status == 403
    sharing(adas)
    let(dialog, f"What {eve.name} may do", "")
    eves.get_by_text("This map is gone").wait_for()  # without a reload


def test_a_map_is_shared_with_a_group_whose_people_come_and_go(ada: Person, eve: Person) -> None:
    ada.plant_map("round the studio")
    adas = ada.open("#/maps")
    dialog = sharing(adas)
    dialog.get_by_role("button", name="New group").click()
    asking = adas.get_by_role("dialog", name="New group")
    asking.get_by_label("Name", exact=True).fill("Night guards")
    asking.get_by_label(eve.name).check()
    asking.get_by_role("button", name="Save").click()
    dialog.locator(".groups li", has_text="Night guards 1 person").wait_for()
    let(dialog, "What Night guards may do", "edit")
    dialog.get_by_role("button", name="Close").click()
    row(adas, "round the studio").get_by_text("shared with 1 person").wait_for()
    eves = eve.open("#/maps")
    row(eves, "round the studio").get_by_role("link", name="Open round the studio").click()
    eves.get_by_role("button", name="Rename round the studio").wait_for()
    sharing(adas)
    dialog.get_by_role("button", name="Change Night guards").click()
    asking = adas.get_by_role("dialog", name="Change Night guards")
    asking.get_by_label(eve.name).uncheck()
    asking.get_by_role("button", name="Save").click()
    dialog.locator(".groups li", has_text="Night guards 0 people").wait_for()
    assert dialog.get_by_label("What Night guards may do").input_value() == "edit"
    eves.get_by_text("This map is gone").wait_for()  # without a reload
    dialog.get_by_role("button", name="Delete Night guards").click()
    adas.get_by_role("button", name="Delete for good").click()
    dialog.locator(".groups", has_not_text="Night guards").wait_for(state="attached")


def test_who_may_edit_renames_a_map_and_who_leaves_it_sees_it_no_more(
    ada: Person, eve: Person
) -> None:
    map_id = ada.plant_map("round the studio")
    shared(ada, map_id, eve, "edit")
    page = eve.open(f"#/maps/{map_id}")
    page.get_by_role("button", name="Rename round the studio").click()
    dialog = page.get_by_role("dialog", name="Name and place")
    dialog.get_by_label("Name", exact=True).fill("Entrance hall")
    dialog.get_by_label("Venue").fill("North Mall")
    dialog.get_by_label("Floor").fill("Ground floor")
    dialog.get_by_role("button", name="Save").click()
    page.get_by_role("heading", name="Entrance hall", level=1).wait_for()
    assert "North Mall · Ground floor" in page.locator(".map-head p").inner_text()
    assert page.get_by_label("Venue", exact=True).count() == 1, "asked for by an export"
    go(page, "#/maps")
    page.get_by_role("heading", name="North Mall", level=2).wait_for()
    page.get_by_role("button", name="Take Entrance hall off my list").click()
    page.get_by_role("dialog").get_by_role("button", name="Take it off").click()
    page.get_by_text("No maps yet").wait_for()
    assert eve.get(f"/api/maps/{map_id}") == 404


def test_a_link_opens_a_map_without_pairing_and_not_after_it_was_withdrawn(
    ada: Person, stranger: Any
) -> None:
    ada.plant_map("round the studio")
    page = ada.open("#/maps")
    address = share_by_link(page)
    stranger.goto(address)
    stranger.get_by_role("heading", name="round the studio", level=1).wait_for()
    stranger.wait_for_selector(".exports li")
    assert stranger.locator("nav").is_hidden()
    for name in ("Delete", "Rename", "Share"):
        assert stranger.get_by_role("button", name=f"{name} round the studio").count() == 0
    report = stranger.get_by_role("link", name="Report").get_attribute("href")
    assert stranger.context.request.get(f"{ada.origin}{report}").ok
    with stranger.expect_download():
        stranger.get_by_role("button", name="Download as tum").click()
    assert "#link=" in stranger.get_by_role("link", name="Find me here").get_attribute("href")
    stranger.reload()
    stranger.get_by_role("heading", name="round the studio", level=1).wait_for()
    dialog = sharing(page)
    dialog.get_by_label(EVERYONE).select_option("")
    page.get_by_role("dialog", name="Withdraw the link?").get_by_role(
        "button", name="Withdraw it"
    ).click()
    dialog.get_by_text("Saved").wait_for()
    stranger.get_by_text("This map is gone").wait_for()  # without a reload
    stranger.reload()
    stranger.get_by_text("This link opens nothing").wait_for()
    assert "round the studio" not in stranger.content()


def test_a_link_is_not_withdrawn_by_mistake(ada: Person) -> None:
    ada.plant_map("round the studio")
    page = ada.open("#/maps")
    address = share_by_link(page)
    dialog = sharing(page)
    choice = dialog.get_by_label(EVERYONE)
    choice.select_option("")
    page.get_by_role("dialog", name="Withdraw the link?").get_by_role(
        "button", name="Keep it"
    ).click()
    page.locator("dialog").nth(1).wait_for(state="detached")
    assert choice.input_value() == "read"
    assert dialog.get_by_role("textbox", name="Address").input_value() == address


def test_who_has_an_account_opens_a_link_as_well(ada: Person, eve: Person) -> None:
    ada.plant_map("round the studio")
    address = share_by_link(ada.open("#/maps"))
    page = eve.open()
    go(page, "#" + address.partition("#")[2])
    page.get_by_role("heading", name="round the studio", level=1).wait_for()
    assert page.locator("nav").is_visible()
    go(page, f"#link={'0' * 32}.none")
    page.get_by_text("This map is not here").wait_for()


def test_several_maps_are_chosen_and_deleted_with_one_question(ada: Person, eve: Person) -> None:
    halls = [ada.plant_map(f"hall {k}") for k in range(3)]
    yard = ada.plant_map("yard")
    theirs = eve.plant_map("hall of Eve")
    shared(eve, theirs, ada, "edit")
    page = ada.open("#/maps")
    page.get_by_label("Choose yard").check()
    page.get_by_label("Search maps").fill("HALL")
    page.get_by_label("All", exact=True).check()
    page.get_by_role("button", name="Delete 3", exact=True).click()
    dialog = page.get_by_role("dialog", name="Delete 3 maps?")
    for name in ("hall 0", "hall 1", "hall 2"):
        dialog.get_by_text(name).wait_for()
    assert dialog.get_by_text("yard").count() == 0, "it is not seen, so it is not deleted"
    dialog.get_by_role("button", name="Delete for good").click()
    row(page, "hall 0").wait_for(state="detached")
    assert {each["id"] for each in ada.get("/api/maps")} == {yard, theirs}
    assert [ada.get(f"/api/maps/{each}") for each in halls] == [404] * 3
    page.get_by_label("Search maps").fill("")
    assert page.get_by_label("Choose yard").is_checked()


def test_several_recordings_are_chosen_and_deleted(ada: Person) -> None:
    for name in ("morning", "noon", "evening"):
        ada.plant_recording(name)
    page = ada.open()
    page.get_by_label("Choose morning").check()
    page.get_by_label("Choose noon").check()
    page.get_by_role("button", name="Delete 2", exact=True).click()
    dialog = page.get_by_role("dialog", name="Delete 2 recordings?")
    dialog.get_by_role("button", name="Delete for good").click()
    row(page, "noon").wait_for(state="detached")
    assert [each["name"] for each in ada.get("/api/recordings")] == ["evening"]


def test_lists_are_searched_and_sorted(ada: Person) -> None:
    for name in ("Café", "hall 10", "hall 9"):
        ada.plant_recording(name)
    page = ada.open()
    names = page.locator("table.list tbody th :is(strong, a)")
    page.get_by_label("Sort recordings").select_option("name")
    assert names.all_inner_texts() == ["Café", "hall 9", "hall 10"]
    search = page.get_by_label("Search recordings")
    search.fill("cafe")
    assert names.all_inner_texts() == ["Café"]
    search.fill("nowhere")
    page.get_by_text("Nothing found").wait_for()
    assert search.input_value() == "nowhere"
    assert page.evaluate("document.activeElement.name") == "find", "and goes on being typed in"
    search.fill("")
    assert names.count() == 3


def test_maps_stand_by_venue_and_floor_which_are_renamed(ada: Person) -> None:
    for name, venue, floor in (
        ("cinema", "North Mall", "Floor 2"), ("car park", "North Mall", "Basement"),
        ("shops", "North Mall", "Floor 2"), ("library", "Annex", None), ("attic", None, None),
    ):  # fmt: skip
        ada.plant_map(name, venue=venue, floor=floor)
    page = ada.open("#/maps")
    page.get_by_role("heading", name="Annex").wait_for()
    headings = page.locator("main :is(h2, h3)")
    assert headings.all_inner_texts() == [
        "Annex", "North Mall", "Basement", "Floor 2", "Not on a floor yet",
    ]  # fmt: skip
    page.get_by_role("button", name="Rename Floor 2").click()
    dialog = page.get_by_role("dialog", name="Rename North Mall · Floor 2")
    dialog.get_by_label("Floor").fill("Ground floor")
    dialog.get_by_role("button", name="Save").click()
    page.get_by_role("heading", name="Ground floor").wait_for()
    page.get_by_role("button", name="Rename North Mall").click()
    dialog = page.get_by_role("dialog", name="Rename North Mall")
    dialog.get_by_label("Venue").fill("South Mall")
    dialog.get_by_role("button", name="Save").click()
    page.get_by_role("heading", name="South Mall").wait_for()
    assert headings.all_inner_texts() == [
        "Annex", "South Mall", "Basement", "Ground floor", "Not on a floor yet",
    ]  # fmt: skip


def test_a_recording_and_oneself_are_renamed(ada: Person) -> None:
    ada.plant_recording("walk")
    page = ada.open()
    page.get_by_role("button", name="Rename walk").click()
    page.get_by_role("dialog").get_by_label("Name").fill("Corridor")
    page.get_by_role("dialog").get_by_role("button", name="Save").click()
    row(page, "Corridor").wait_for()
    page.get_by_role("button", name="Ada", exact=True).click()
    page.get_by_role("dialog", name="Your name").get_by_label("Name").fill("Ada Lovelace")
    page.get_by_role("dialog").get_by_role("button", name="Save").click()
    page.get_by_role("button", name="Ada Lovelace", exact=True).wait_for()
    assert ada.get("/api/me")["name"] == "Ada Lovelace"


def test_what_was_deleted_elsewhere_disappears(ada: Person) -> None:
    ids = [ada.plant_map(f"hall {k}") for k in range(2)]
    listed, opened = ada.open("#/maps"), ada.open(f"#/maps/{ids[0]}")
    row(listed, "hall 0").wait_for()
    listed.get_by_label("Choose hall 0").check()
    opened.wait_for_selector(".exports li")
    with transaction(ada.services.sessions) as session:
        session.delete(session.get_one(Map, ids[0]))
    row(listed, "hall 0").wait_for(state="detached")
    opened.get_by_text("This map is gone").wait_for()
    assert opened.get_by_role("link", name="Back to the maps").is_visible()


def test_unknown_addresses_say_so(ada: Person, stranger: Any) -> None:
    page = ada.open("#/nonsense")
    page.get_by_role("heading", name="There is no such page").wait_for()
    page.get_by_role("link", name="To the recordings").click()
    page.get_by_role("heading", name="Recordings", exact=True).wait_for()
    page.locator(".skip").focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
    assert page.get_by_role("heading", name="Recordings", exact=True).is_visible()
    for path in ("/none", "/desk/maps/1", "/phone/none"):
        answer = stranger.goto(f"{ada.origin}{path}")
        assert answer.status == 404, path
        stranger.get_by_role("heading", name="There is no such page").wait_for()
        assert stranger.evaluate("getComputedStyle(document.body).margin") == "0px", "its look"
