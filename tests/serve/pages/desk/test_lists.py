"""The lists of the desk page, and who is let in, in a real browser against a real server."""

from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Job, JobKind, JobState
from tests.accessibility import violations
from tests.serve.pages.desk.conftest import Person, go, row
from tests.serve.uploading import unzipped

NOBODY = "0" * 32


def test_a_map_is_listed_with_what_is_known_of_it(ada: Person) -> None:
    facts = {"footsteps": 1234, "closures": 9, "closures_kept": 7, "distance_m": 83.94}
    ada.plant_map("round the studio", facts=facts)
    page = ada.open("#/maps")
    text = row(page, "round the studio").inner_text()
    for words in ("one walk", "83.9 m", "1,234 footsteps", "7", "just now"):
        assert words in text
    assert page.get_by_role("table", name="Maps").count() == 1
    assert page.get_by_role("columnheader", name="Passed again").count() == 1


def test_a_waiting_job_is_cancelled_and_retried(ada: Person) -> None:
    job = ada.plant_job(JobKind.MAP, JobState.QUEUED, given={"recording": NOBODY})
    page = ada.open("#/jobs")
    line = row(page, "a deleted recording")
    assert "Waiting" in line.inner_text()
    assert page.locator("#jobs-open").inner_text() == "1"
    page.get_by_role("button", name="Cancel a deleted recording").click()
    line.get_by_text("Cancelled").wait_for()
    assert ada.get(f"/api/jobs/{job}")["state"] == "cancelled"
    page.get_by_role("button", name="Retry a deleted recording").click()
    line.get_by_text("Waiting").wait_for()
    assert ada.get(f"/api/jobs/{job}")["state"] == "queued"


def test_a_walk_without_a_loop_is_a_map_and_no_failure(ada: Person, run_folder: Path) -> None:
    recording = ada.plant_recording("morning walk", run_folder)
    map_id = ada.plant_map("morning walk", sources=[recording])
    more = {"given": {"recording": recording}, "gave": {"map": map_id}}
    ada.plant_job(JobKind.MAP, JobState.FAILED, problem="no loop closure held", **more)
    page = ada.open("#/jobs")
    page.get_by_text("Map by steps alone").wait_for()
    assert page.get_by_text("Failed", exact=True).count() == 0
    page.get_by_text("no loop closure held").wait_for()


def test_a_failed_job_says_why_in_one_line(ada: Person) -> None:
    why = "no loop was closed; walk a loop twice"
    given = {"recording": NOBODY}
    ada.plant_job(JobKind.MAP, JobState.FAILED, given=given, problem=why, attempts=2)
    page = ada.open("#/jobs")
    text = row(page, "a deleted recording").inner_text()
    assert why in text
    assert "attempt 2" in text


def test_a_running_job_shows_what_it_does_and_goes_on_by_itself(ada: Person) -> None:
    job = ada.plant_job(
        JobKind.MAP, JobState.QUEUED, given={"recording": NOBODY}, doing="echoes", share=0.25
    )
    page = ada.open("#/jobs")
    for state, share, doing, words in (
        (JobState.RUNNING, 0.5, "closures", "50 % closures"),
        (JobState.DONE, 1.0, "", "Done"),
    ):
        with transaction(ada.services.sessions) as session:
            found = session.get_one(Job, job)
            found.state, found.share, found.doing = state, share, doing
        row(page, "a deleted recording").get_by_text(words).wait_for()
        assert row(page, "a deleted recording").count() == 1


def test_a_deleted_recording_is_gone_from_the_server(ada: Person) -> None:
    recording = ada.plant_recording("to be forgotten")
    page = ada.open()
    page.get_by_role("button", name="Delete to be forgotten").click()
    dialog = page.get_by_role("dialog", name="Delete to be forgotten?")
    dialog.get_by_role("button", name="Keep it").click()
    assert row(page, "to be forgotten").count() == 1
    page.get_by_role("button", name="Delete to be forgotten").click()
    dialog.get_by_role("button", name="Delete for good").click()
    page.get_by_text("No recordings yet").wait_for()
    assert ada.get(f"/api/recordings/{recording}") == 404


def test_a_recording_is_downloaded_as_it_was(
    ada: Person, walk_folder: Path, tmp_path: Path
) -> None:
    ada.plant_recording("morning walk")
    page = ada.open()
    with page.expect_download() as coming:
        page.get_by_role("link", name="Download morning walk").click()
    coming.value.save_as(tmp_path / "it.zip")
    found = unzipped((tmp_path / "it.zip").read_bytes())
    assert found == {file.name: file.read_bytes() for file in walk_folder.iterdir()}


def test_mapping_asks_by_what_and_where_it_began(ada: Person) -> None:
    ada.plant_recording("without sound")
    page = ada.open()
    page.get_by_role("button", name="Map without sound").click()
    dialog = page.get_by_role("dialog", name="Map without sound")
    assert dialog.get_by_label("Echoes").is_disabled(), "it brings no sound"
    dialog.get_by_label("The walk started here").check()
    dialog.get_by_label("x, m").fill("1.5")
    dialog.get_by_label("Heading, degrees").fill("180")
    dialog.get_by_role("button", name="Map it").click()
    row(page, "without sound").get_by_text("Waiting").wait_for()
    (job,) = ada.get("/api/jobs")
    assert job["given"]["by"] == ["motion"]
    assert job["given"]["start_pose"] == pytest.approx([1.5, 0, 3.14159265], abs=1e-6)


def test_chosen_maps_are_merged(ada: Person) -> None:
    wanted = [ada.plant_map(f"hall, {k}") for k in ("first", "second")]
    ada.plant_map("elsewhere")
    page = ada.open("#/maps")
    page.get_by_label("Choose hall, first").check()
    page.get_by_label("Choose hall, second").check()
    page.get_by_role("button", name="Merge 2 maps").click()
    dialog = page.get_by_role("dialog", name="Merge 2 maps")
    assert dialog.get_by_label("Name of the floor map").input_value() == "hall"
    dialog.get_by_role("button", name="Merge").click()
    page.get_by_text("are being merged").wait_for()
    (job,) = ada.get("/api/jobs")
    assert sorted(job["given"]["maps"]) == sorted(wanted)
    assert job["given"]["name"] == "hall"


def test_somebody_else_sees_nothing_of_it(ada: Person, invite: Any) -> None:
    ada, eve = invite("Ada"), invite("Eve")
    secret = ada.plant_map("a secret place")
    ada.plant_recording("a secret walk")
    ada.plant_job(JobKind.MAP, JobState.DONE, given={"recording": NOBODY})
    page = eve.open()
    page.get_by_text("No recordings yet").wait_for()
    for fragment, words in (("#/jobs", "No jobs yet"), ("#/maps", "No maps yet")):
        go(page, fragment)
        page.get_by_text(words).wait_for()
    go(page, f"#/maps/{secret}")
    page.get_by_text("This map is not here").wait_for()
    assert "secret" not in page.content()
    assert page.get_by_role("link", name="People").count() == 0, "the owner's alone"


def test_without_a_token_there_is_a_door_and_no_more(ada: Person, stranger: Any) -> None:
    page = stranger
    page.goto(f"{ada.origin}/desk#token=wrong")
    page.get_by_text("This browser is not paired").wait_for()
    assert "token" not in page.url, "a token does not stay in the history"
    assert page.locator("nav").is_hidden()
    page.get_by_label("Or paste it here").fill(ada.address)
    page.get_by_role("button", name="Pair", exact=True).click()
    page.get_by_role("heading", name="Recordings", exact=True).wait_for()
    page.get_by_role("button", name="Sign out").click()
    page.get_by_text("This browser is not paired").wait_for()


def test_a_token_is_a_cookie_that_scripts_cannot_read(ada: Person) -> None:
    page = ada.open()
    assert ada.token not in page.url
    assert ada.token not in page.evaluate("document.cookie")
    assert ada.token not in page.evaluate("JSON.stringify([localStorage, sessionStorage])")


def code_shown(page: Any) -> str:
    page.get_by_role("button", name="Pair a device").click()
    page.get_by_role("img", name="QR code of the address").wait_for()
    return str(page.get_by_role("textbox", name="Address").input_value())


def test_a_code_of_the_desk_pairs_another_browser_once(ada: Person, fresh: Any) -> None:
    address = code_shown(ada.open())
    assert address.startswith(f"{ada.origin}/#code=")
    page = fresh()
    page.goto(address)
    page.wait_for_url(lambda url: "code=" not in url)
    page.goto(f"{ada.origin}/desk")
    page.get_by_text("Ada").wait_for(state="attached")
    page = fresh()
    page.goto(address)
    page.get_by_text("was used or is too old").wait_for()
    assert "code=" not in page.url


def test_the_phone_page_takes_what_is_pasted(ada: Person, fresh: Any) -> None:
    address = code_shown(ada.open())
    page = fresh(viewport={"width": 390, "height": 844})
    page.goto(f"{ada.origin}/")
    page.get_by_label("Or paste the address here").fill(address)
    with page.expect_navigation():  # the page reloads, paired
        page.get_by_role("button", name="Pair", exact=True).click()
    page.locator("#problem").wait_for(state="hidden")
    page.goto(f"{ada.origin}/desk")
    page.get_by_text("Ada").wait_for(state="attached")


@pytest.mark.parametrize("width", [320, 1024])
def test_the_page_of_trust_fits_and_says_where_there_is_nothing_to_trust(
    ada: Person, fresh: Any, width: int
) -> None:
    page = fresh(viewport={"width": width, "height": 700})
    page.goto(f"{ada.origin}/trust")
    page.get_by_text("speaks plain HTTP").wait_for()
    assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
