"""The lists of the desk page, in a real browser against a real server."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.store.tables import JobKind, JobState
from tests.serve.pages.desk.conftest import PATIENCE_MS

Open = Callable[..., Any]
NOBODY = "0" * 32


def row(page: Any, name: str) -> Any:
    return page.get_by_role("row").filter(has_text=name)


def test_a_map_is_listed_with_what_is_known_of_it(
    person: Any, open_desk: Open, run_folder: Path
) -> None:
    facts = {"footsteps": 1234, "closures": 9, "closures_kept": 7, "distance_m": 83.94}
    person.plant_map("round the studio", run_folder, facts=facts)
    page = open_desk(person, "#/maps")
    text = row(page, "round the studio").inner_text()
    for words in ("one walk", "83.9 m", "1,234 footsteps", "7", "just now"):
        assert words in text
    assert page.get_by_role("table", name="Maps").count() == 1
    assert page.get_by_role("columnheader", name="Passed again").count() == 1


def test_a_waiting_job_is_cancelled_and_retried(person: Any, open_desk: Open, asked: Any) -> None:
    job = person.plant_job(JobKind.MAP, JobState.QUEUED, given={"recording": NOBODY})
    page = open_desk(person, "#/jobs")
    line = row(page, "a deleted recording")
    assert "Waiting" in line.inner_text()
    assert page.locator("#jobs-open").inner_text() == "1"
    page.get_by_role("button", name="Cancel a deleted recording").click()
    line.get_by_text("Cancelled").wait_for()
    assert asked(page, f"/api/jobs/{job}")["state"] == "cancelled"
    page.get_by_role("button", name="Retry a deleted recording").click()
    line.get_by_text("Waiting").wait_for()
    assert asked(page, f"/api/jobs/{job}")["state"] == "queued"


def test_a_walk_without_a_loop_is_a_map_and_no_failure(
    person: Any, open_desk: Open, run_folder: Path
) -> None:
    recording = person.plant_recording("morning walk", run_folder)
    map_id = person.plant_map("morning walk", run_folder, sources=[recording])
    more = {"given": {"recording": recording}, "gave": {"map": map_id}}
    person.plant_job(JobKind.MAP, JobState.FAILED, problem="no loop closure held", **more)
    page = open_desk(person, "#/jobs")
    page.get_by_text("Map by steps alone").wait_for()
    assert page.get_by_text("Failed", exact=True).count() == 0
    page.get_by_text("no loop closure held").wait_for()


def test_a_failed_job_says_why_in_one_line(person: Any, open_desk: Open) -> None:
    why = "no loop was closed; walk a loop twice"
    given = {"recording": NOBODY}
    person.plant_job(JobKind.MAP, JobState.FAILED, given=given, problem=why, attempts=2)
    page = open_desk(person, "#/jobs")
    text = row(page, "a deleted recording").inner_text()
    assert why in text
    assert "attempt 2" in text


def test_a_running_job_shows_what_it_does_and_goes_on_by_itself(
    person: Any, open_desk: Open
) -> None:
    from elfslam.serve.store.database import transaction
    from elfslam.serve.store.tables import Job

    job = person.plant_job(
        JobKind.MAP, JobState.QUEUED, given={"recording": NOBODY}, doing="echoes", share=0.25
    )
    page = open_desk(person, "#/jobs")
    for state, share, doing, words in (
        (JobState.RUNNING, 0.5, "closures", "50 % closures"),
        (JobState.DONE, 1.0, "", "Done"),
    ):
        with transaction(person.services.sessions) as session:
            found = session.get_one(Job, job)
            found.state, found.share, found.doing = state, share, doing
        row(page, "a deleted recording").get_by_text(words).wait_for()
        assert row(page, "a deleted recording").count() == 1


def test_a_deleted_recording_is_gone_from_the_server(
    person: Any, open_desk: Open, walk_folder: Path, asked: Any
) -> None:
    recording = person.plant_recording("to be forgotten", walk_folder)
    page = open_desk(person)
    page.get_by_role("button", name="Delete to be forgotten").click()
    dialog = page.get_by_role("dialog", name="Delete to be forgotten?")
    dialog.get_by_role("button", name="Keep it").click()
    assert row(page, "to be forgotten").count() == 1
    page.get_by_role("button", name="Delete to be forgotten").click()
    dialog.get_by_role("button", name="Delete for good").click()
    page.get_by_text("No recordings yet").wait_for()
    assert asked(page, f"/api/recordings/{recording}") == 404


def test_a_recording_is_downloaded_as_it_was(
    person: Any, open_desk: Open, walk_folder: Path, tmp_path: Path
) -> None:
    person.plant_recording("morning walk", walk_folder)
    page = open_desk(person)
    with page.expect_download() as coming:
        page.get_by_role("link", name="Download morning walk").click()
    coming.value.save_as(tmp_path / "it.zip")
    with zipfile.ZipFile(tmp_path / "it.zip") as packed:
        found = {Path(name).name: packed.read(name) for name in packed.namelist()}
    assert found == {file.name: file.read_bytes() for file in walk_folder.iterdir()}


def test_mapping_asks_by_what_and_where_it_began(
    person: Any, open_desk: Open, walk_folder: Path, asked: Any
) -> None:
    person.plant_recording("without sound", walk_folder)
    page = open_desk(person)
    page.get_by_role("button", name="Map without sound").click()
    dialog = page.get_by_role("dialog", name="Map without sound")
    assert dialog.get_by_label("Echoes").is_disabled(), "it brings no sound"
    dialog.get_by_label("The walk started here").check()
    dialog.get_by_label("x, m").fill("1.5")
    dialog.get_by_label("Heading, degrees").fill("180")
    dialog.get_by_role("button", name="Map it").click()
    row(page, "without sound").get_by_text("Waiting").wait_for()
    (job,) = asked(page, "/api/jobs")
    assert job["given"]["by"] == ["motion"]
    assert job["given"]["start_pose"] == pytest.approx([1.5, 0, 3.14159265], abs=1e-6)


def test_chosen_maps_are_merged(person: Any, open_desk: Open, run_folder: Path, asked: Any) -> None:
    wanted = [person.plant_map(f"hall, {k}", run_folder) for k in ("first", "second")]
    person.plant_map("elsewhere", run_folder)
    page = open_desk(person, "#/maps")
    page.get_by_label("Choose hall, first").check()
    page.get_by_label("Choose hall, second").check()
    page.get_by_role("button", name="Merge 2 maps").click()
    dialog = page.get_by_role("dialog", name="Merge 2 maps")
    assert dialog.get_by_label("Name of the floor map").input_value() == "hall"
    dialog.get_by_role("button", name="Merge").click()
    page.get_by_text("are being merged").wait_for()
    (job,) = asked(page, "/api/jobs")
    assert sorted(job["given"]["maps"]) == sorted(wanted)
    assert job["given"]["name"] == "hall"


def test_somebody_else_sees_nothing_of_it(
    invite: Any, open_desk: Open, run_folder: Path, walk_folder: Path
) -> None:
    ada, eve = invite("Ada"), invite("Eve")
    secret = ada.plant_map("a secret place", run_folder)
    ada.plant_recording("a secret walk", walk_folder)
    ada.plant_job(JobKind.MAP, JobState.DONE, given={"recording": NOBODY})
    page = open_desk(eve)
    page.get_by_text("No recordings yet").wait_for()
    for fragment, words in (("#/jobs", "No jobs yet"), ("#/maps", "No maps yet")):
        page.evaluate("fragment => { location.hash = fragment; }", fragment)
        page.get_by_text(words).wait_for()
    page.evaluate("fragment => { location.hash = fragment; }", f"#/maps/{secret}")
    page.get_by_text("This map is not here").wait_for()
    assert "secret" not in page.content()
    assert page.get_by_role("link", name="People").count() == 0, "the owner's alone"


def test_without_a_token_there_is_a_door_and_no_more(person: Any, browser: Any) -> None:
    context = browser.new_context()
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(f"{person.origin}/desk#token=wrong")
    page.get_by_text("This browser is not paired").wait_for()
    assert "token" not in page.url, "a token does not stay in the history"
    assert page.locator("nav").is_hidden()
    page.get_by_label("Or paste it here").fill(person.address)
    page.get_by_role("button", name="Pair", exact=True).click()
    page.get_by_role("heading", name="Recordings", exact=True).wait_for()
    page.get_by_role("button", name="Sign out").click()
    page.get_by_text("This browser is not paired").wait_for()
    context.close()


def test_a_token_is_a_cookie_that_scripts_cannot_read(person: Any, open_desk: Open) -> None:
    page = open_desk(person)
    assert person.token not in page.url
    assert person.token not in page.evaluate("document.cookie")
    assert person.token not in page.evaluate("JSON.stringify([localStorage, sessionStorage])")


def test_a_dropped_zip_is_uploaded_and_becomes_a_recording(
    person: Any, open_desk: Open, walk_folder: Path, tmp_path: Path
) -> None:
    file = tmp_path / "dropped walk.zip"
    with zipfile.ZipFile(file, "w") as packed:
        for each in walk_folder.iterdir():
            packed.write(each, f"walk/{each.name}")
    page = open_desk(person)
    page.locator("input[name=recordings]").set_input_files(file)
    page.get_by_text("dropped walk.zip has arrived.").wait_for()
    page.get_by_text("Ready to map").or_(page.get_by_text("Waiting")).first.wait_for(timeout=60_000)
    assert row(page, "0:").count() == 1, "its length is known"


def test_what_no_program_writes_is_refused_in_words(
    person: Any, open_desk: Open, tmp_path: Path
) -> None:
    file = tmp_path / "walk.doc"
    file.write_text("no")
    page = open_desk(person)
    page.locator("input[name=recordings]").set_input_files(file)
    page.get_by_role("alert").get_by_text("walk.doc: wanted what ends in .zip").wait_for()
    page.get_by_text("No recordings yet").wait_for()  # nothing was begun
