"""The phone page in Chromium: pairs, probes, records and sends to a real server process."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from scipy import signal

from elfslam.base.values import Audio
from elfslam.data import baseband
from elfslam.data.recordings import read_recording
from elfslam.serve.settings import PAGES_FOLDER
from elfslam.stages.chirp import describe_chirp
from tests.accessibility import violations
from tests.serve.planting import floor_map_of, picture, plant_floor_map

RATE_HZ = 44_100
HEIGHTS_PX = 48
ATTEMPTS = 3
Heard = tuple[Path, np.ndarray]

pytestmark = pytest.mark.real


def in_band(sound: np.ndarray) -> np.ndarray:
    """What lies well within 15 to 20 kHz of it."""
    taps = signal.firwin(401, (15_400, 19_600), pass_zero=False, fs=RATE_HZ)
    return np.asarray(signal.fftconvolve(sound, taps, mode="same"))


def difference_db(kept: np.ndarray, frame_starts_s: np.ndarray, heard: np.ndarray) -> np.ndarray:
    """Level of what was heard over what of it was kept otherwise, in the band, of every 5th frame.

    The fake microphone plays its file round and round; a frame is compared with that place in it
    from which it differs least: on a busy machine the browser itself may lose some samples.
    """
    round_and_round = in_band(np.tile(heard / 32768, 2))
    told = in_band(kept)
    length = round(0.066 * RATE_HZ)
    levels = []
    for start in np.round((frame_starts_s[1:-1:5] + 0.007) * RATE_HZ).astype(int):
        frame = told[start : start + length]
        at = place_of(frame, round_and_round)
        wanted = round_and_round[at : at + length]
        levels.append(10 * np.log10(np.sum(wanted**2) / np.sum((frame - wanted) ** 2)))
    return np.array(levels)


def place_of(pattern: np.ndarray, sound: np.ndarray) -> int:
    """Where the sound differs least from the pattern."""
    match = signal.correlate(sound, pattern, mode="valid")
    power = np.concatenate([[0.0], np.cumsum(sound**2)])
    return int(np.argmin(power[len(pattern) :] - power[: -len(pattern)] - 2 * match))


def test_the_code_pairs_the_phone_and_leaves_no_token_behind(phone: Any) -> None:
    phone.open()
    phone.wait_for(lambda: "token" not in phone.page.url, "the token is gone")
    assert not phone.page.is_visible("#problem")
    cookie = phone.page.context.cookies()[0]
    assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
    phone.open_again()
    phone.walk(0.5)
    assert not phone.page.is_visible("#problem")


def test_a_phone_without_the_code_is_told_how_to_pair(phone: Any) -> None:
    phone.page.goto(phone.server.address.split("#")[0] + "#token=wrong")
    phone.wait_for_text("#problem", "this pairing token is not known here")
    assert phone.page.is_visible("#pair")
    assert "wrong" not in phone.page.url


def test_the_probe_says_in_words_what_the_phone_can_do(phone: Any) -> None:
    phone.open()
    phone.move()
    said = phone.allow()
    checks = phone.page.locator("#checks li")
    # How steadily a machine plays and records that has other work, and so the loudness of each
    # band, is not the page's doing; what is, stays when it checks again.
    for attempt in range(ATTEMPTS):
        if attempt:
            said = phone.check_again()
        verdicts = [checks.nth(k).get_attribute("data-verdict") for k in range(checks.count())]
        steadiness = verdicts.pop(4)
        if verdicts == ["pass"] * 6:
            break
    assert verdicts == ["pass"] * 6
    if steadiness == "pass":
        assert said == "This phone can do it."
        heard = re.search(r"(\d+) of 20 chirps came straight", checks.nth(4).inner_text())
        assert heard
        assert 18 <= int(heard[1]) <= 20
    else:
        assert (steadiness, said) == ("doubt", "This phone may do it. In doubt: steady timing.")
    assert "44.1 kHz" in checks.nth(0).inner_text()
    assert "are off" in checks.nth(1).inner_text()
    assert "9.8 m/s²" in checks.nth(5).inner_text()
    assert phone.page.locator("#bands strong").count() == 5


def test_what_a_computer_lacks_is_told(phone: Any) -> None:
    """No motion, and a screen that nothing keeps awake."""
    phone.page.context.clear_permissions()
    phone.page.context.grant_permissions(["microphone", "accelerometer", "gyroscope"])
    phone.open()
    assert "Not yet: motion" in phone.allow()
    assert phone.text("#go-on") == "Walk all the same"
    phone.start("In the dark")
    phone.wait_for_text("#awake", "The screen may go dark here: touch it now and then.")
    phone.page.click("#stop")
    phone.wait_for(lambda: not phone.page.is_visible("#awake"), "it does not matter any more")


def test_what_was_heard_and_moved_is_what_the_server_has(phone: Any, heard: Heard) -> None:
    phone.begin("Once around")
    phone.walk(6)
    share = int(phone.text("#heard").removesuffix(" %"))
    assert not phone.page.is_visible("#awake"), "the screen stays on"
    assert not phone.page.is_visible("#tapping"), "there is no plan on the phone"
    folder, told = phone.finish()
    manifest = json.loads((folder / "recording.json").read_text())
    capture = manifest["capture"]
    assert capture["missed"] <= broken(capture)
    assert share >= 98 - 100 * broken(capture) / capture["frames"]
    recording = read_recording(folder)
    assert (told["name"], recording.name) == ("Once around", "Once around")
    assert manifest["chirp"] == describe_chirp()
    assert manifest["capture"]["frames"] == len(frame_times_s(folder))
    assert manifest["start_pose"] is None
    assert recording.audio is not None
    starts_s = frame_times_s(folder)
    assert len(starts_s) > 50
    check_frames(recording.audio.samples[0], starts_s, heard)
    check_motion(folder, starts_s[-1])


def broken(capture: dict[str, Any]) -> float:
    """Chirps that a busy machine cut in two or lost, by what the page says of breaks."""
    in_gaps = sum(2 + 10 * gap["lost_s"] for gap in capture["gaps"])
    return float(in_gaps + len(capture["jumps"]))


def frame_times_s(folder: Path) -> np.ndarray:
    """When each frame begins."""
    return np.loadtxt(folder / "baseband.csv", delimiter=",", skiprows=1, usecols=0, ndmin=1)


def check_frames(kept: np.ndarray, starts_s: np.ndarray, heard: Heard) -> None:
    """All are what was heard, but for a few in which a busy browser may have lost samples."""
    levels = difference_db(kept, starts_s, heard[1])
    assert len(levels) > 5
    assert np.mean(levels < 45) <= 0.15


def check_motion(folder: Path, end_s: float) -> None:
    """60 readings a second, rounded as browsers do, to the end of the page's own chirps.

    The fake microphone goes on hearing chirps a little longer.
    """
    accelerometer = np.loadtxt(folder / "accelerometer.csv", delimiter=",", skiprows=1)
    gyroscope = np.loadtxt(folder / "gyroscope.csv", delimiter=",", skiprows=1)
    assert np.allclose(accelerometer[:, 1:], (0.3, 1.2, 9.7), atol=1e-6)
    assert np.allclose(gyroscope[:, 1:], np.deg2rad((5.7, -11.5, 17.2)), atol=1e-6)
    assert 0 <= accelerometer[0, 0] < 0.5
    assert abs(accelerometer[-1, 0] - end_s - 0.08) < 0.6
    assert 45 < len(accelerometer) / end_s < 65


def test_the_band_is_kept_as_sound_and_nothing_else(phone: Any, heard: Heard) -> None:
    phone.open()
    phone.move()
    phone.allow()
    phone.page.click("#go-on")
    phone.page.click("text=Start and sound")
    phone.page.click("text=for research with other programs")
    for field, value in (("x", "1.5"), ("y", "-2"), ("heading", "90")):
        phone.page.fill(f"#start-{field}", value)
    phone.page.click("text=Start walking")
    phone.walk(4)
    folder, _ = phone.finish()
    manifest = json.loads((folder / "recording.json").read_text())
    assert manifest["start_pose"] == pytest.approx([1.5, -2, np.pi / 2])
    frames = soundfile.read(folder / "frames.wav", dtype="int16")[0].reshape(-1, 3528)
    twice = Audio(np.tile(heard[1], 2)[None] / 32768, RATE_HZ)
    round_and_round = baseband.in_band(twice).samples[0] * 32767
    off = [largest_difference(frame, round_and_round) for frame in frames[2:-2:4].astype(float)]
    assert np.sum(np.array(off) <= 1) >= 2, off
    spectrum = np.fft.rfft(frames * np.hanning(3528)) * np.sqrt(8 / 3) / 3528
    audible = np.fft.rfftfreq(3528, 1 / RATE_HZ) < 12_000
    rounding = np.sqrt(2 * (np.abs(spectrum[:, audible]) ** 2).sum(axis=1))
    assert (rounding < 0.35).all()


def largest_difference(frame: np.ndarray, sound: np.ndarray) -> float:
    """From the stretch of the sound that the frame is of; large where the browser lost samples."""
    start = place_of(frame, sound)
    return float(abs(sound[start : start + len(frame)] - frame).max())


def test_no_server_and_none_with_room_lose_nothing(phone: Any, heard: Heard) -> None:
    """The network is lost, then the server is killed, then its disk is full."""
    refusal = json.dumps({"status": 507, "detail": "the disk is full"})

    def refuse(route: Any) -> None:
        if route.request.method != "PATCH":
            route.continue_()
            return
        route.fulfill(status=507, body=refusal, content_type="application/problem+json")

    phone.begin()
    phone.walk(2)
    phone.page.context.set_offline(True)
    phone.wait_for_text("#network-said", "No network")
    sent, kept = phone.text("#sent"), phone.text("#kept")
    phone.wait_for(lambda: phone.text("#kept") != kept, "the walk goes on")
    assert phone.text("#sent") == sent
    phone.page.context.set_offline(False)
    phone.wait_for_text("#network-said", "Connected")
    server, port = phone.server, phone.server.port
    server.stop()
    phone.wait_for_text("#network-said", "No network")
    server.start(port)
    phone.wait_for_text("#network-said", "Connected")
    phone.page.route("**/api/uploads/*", refuse)
    phone.wait_for_text("#network-said", "disk is full")
    phone.page.unroute("**/api/uploads/*")
    folder, _ = phone.finish()
    check_sound(folder, heard)


def check_sound(folder: Path, heard: Heard) -> None:
    audio = read_recording(folder).audio
    assert audio is not None
    starts_s = frame_times_s(folder)
    assert np.diff(starts_s)[:-5].max() < 0.19
    check_frames(audio.samples[0], starts_s, heard)


def test_a_walk_without_network_is_sent_when_it_is_back(phone: Any, heard: Heard) -> None:
    phone.open()
    phone.move()
    phone.allow()
    phone.page.context.set_offline(True)
    phone.start()
    phone.walk(4)
    phone.page.click("#stop")
    phone.wait_for_text("#finish-trouble", "No network")
    assert phone.server.recordings() == []
    phone.page.context.set_offline(False)
    phone.wait_for_text("#finish-said", "map is being made")
    check_sound(phone.fetch()[0], heard)


def test_a_walk_outlives_its_page(phone: Any, heard: Heard) -> None:
    """Here in a browser without a file system of its own: the database keeps the bytes."""
    begins = "export async function openOpfsStore() {"
    stores = (PAGES_FOLDER / "phone" / "byte_stores.js").read_text(encoding="utf-8")
    assert begins in stores
    absent = stores.replace(begins, f"{begins}\n  return null;")
    phone.page.context.route(
        "**/byte_stores.js",
        lambda route: route.fulfill(body=absent, content_type="text/javascript"),
    )
    phone.begin("Broken off")
    phone.walk(5)
    phone.page.reload()
    phone.wait_for_text("#unfinished", "Broken off")
    phone.page.click("text=Continue sending")
    phone.wait_for_text("#finish-said", "map is being made")
    folder, _ = phone.fetch()
    check_sound(folder, heard)
    assert len(frame_times_s(folder)) > 35
    phone.open_again()
    phone.walk(1)
    assert not phone.page.is_visible("#unfinished")


def test_an_unfinished_walk_can_be_discarded(phone: Any) -> None:
    phone.begin("Not wanted")
    phone.walk(2)
    phone.page.reload()
    phone.wait_for_text("#unfinished", "Not wanted")
    phone.page.click("#unfinished >> text=Discard")
    phone.page.click("dialog[open] >> text=Keep it")
    assert phone.page.is_visible("#unfinished")
    phone.page.click("#unfinished >> text=Discard")
    phone.page.click("dialog[open] >> text='Discard'")
    phone.wait_for(lambda: not phone.page.is_visible("#unfinished"), "the walk is gone")
    phone.wait_for(lambda: phone.server.recordings() == [], "it is gone on the server")
    phone.page.reload()
    phone.walk(1)
    assert not phone.page.is_visible("#unfinished")


def test_a_full_phone_ends_the_walk_and_keeps_it(phone: Any, heard: Heard) -> None:
    phone.begin()
    phone.walk(5)
    origin = phone.server.address.split("/#")[0]
    given = {"origin": origin, "quotaSize": 150_000}
    phone.sensors.send("Storage.overrideQuotaForOrigin", given)
    phone.wait_for_text("#problem", "no room left")
    phone.sensors.send("Storage.overrideQuotaForOrigin", {"origin": origin})
    phone.wait_for(lambda: phone.page.is_visible("#finish"), "the walk has ended")
    phone.wait_for_text("#finish-said", "map is being made")
    check_sound(phone.fetch()[0], heard)


def test_every_view_fits_and_every_target_is_large(phone: Any) -> None:
    phone.open()
    phone.move()
    phone.page.click("text=Before you start")
    check_layouts(phone)
    phone.allow()
    check_layouts(phone)
    phone.page.click("#go-on")
    phone.page.click("text=Start and sound")
    check_layouts(phone)
    phone.page.click("text=Start walking")
    phone.walk(2)
    check_layouts(phone)
    phone.page.click("#stop")
    phone.wait_for(lambda: phone.page.is_visible("#finish"), "the walk has ended")
    check_layouts(phone)


def check_layouts(phone: Any) -> None:
    for width_px in (320, 390, 1280):
        phone.page.set_viewport_size({"width": width_px, "height": 640})
        check_layout(phone)


def check_layout(phone: Any) -> None:
    """Nothing is wider than the page; whatever is tapped is at least 48 px high, and has a name."""
    page = phone.page
    assert violations(page) == []
    wide = page.evaluate("() => document.documentElement.scrollWidth - window.innerWidth")
    assert wide <= 0
    for target in page.locator(
        "button:visible, summary:visible, .bar a:visible, .choice:visible"
    ).all():
        box = target.bounding_box()
        assert box["height"] >= HEIGHTS_PX, target.inner_text()
        assert box["width"] >= HEIGHTS_PX, target.inner_text()
        assert target.inner_text().strip() or target.get_attribute("aria-label")
    for entry in page.locator("input:visible").all():
        assert entry.evaluate("(element) => element.labels.length") == 1


def test_the_page_is_used_by_keyboard_alone(phone: Any) -> None:
    phone.open()
    phone.move()
    phone.page.locator("#allow").focus()
    phone.page.keyboard.press("Enter")
    phone.page.wait_for_selector("#checks li")
    assert phone.page.evaluate("() => document.activeElement.id") == "probe-title"
    for wanted in ("go-on", "walk-name"):
        for _ in range(4):
            phone.page.keyboard.press("Tab")
            if phone.page.evaluate("() => document.activeElement.id") == wanted:
                break
        assert phone.page.evaluate("() => document.activeElement.id") == wanted
        phone.page.keyboard.press("Enter")
    phone.wait_for(lambda: phone.page.is_visible("#stop"), "the walk begins")
    assert phone.page.evaluate("() => document.activeElement.id") == "record-title"


WIDTH_M, DEPTH_M, MARGIN_PX = 8.0, 4.0, 12
MIDDLE_M = (WIDTH_M / 2, DEPTH_M / 2)


@pytest.fixture
def planned(server: Any) -> Iterator[str]:
    """A map on the server with a plan of 8 m by 4 m, in the middle of which is a door."""
    xy_m = np.array([[1.0, 1.0], [7.0, 3.0]])
    map_id = plant_floor_map(server.data, floor_map_of(xy_m, np.eye(2, 128, dtype=np.float32)))
    plan, kind = f"/api/maps/{map_id}/floor-plan", {"Content-Type": "image/png"}
    server.ask(plan, "PUT", content=picture("PNG", 400, 200), headers=kind)
    server.ask(f"{plan}/placement", "PUT", json={"width_m": WIDTH_M, "x_m": 0, "y_m": 0})
    door = {"name": "Way in", "kind": "door", "x_m": MIDDLE_M[0], "y_m": MIDDLE_M[1]}
    points = {"version": "", "points": [door]}
    server.ask(f"/api/maps/{map_id}/points-of-interest", "PUT", json=points)
    yield map_id
    server.ask(f"/api/maps/{map_id}", "DELETE")


def take_map(phone: Any) -> None:
    """Pair, and get the map onto the phone."""
    phone.open()
    phone.page.click("#where")
    phone.page.click("text=Get this map")
    phone.page.wait_for_selector("text=Find me here")
    phone.page.goto("about:blank")


def write_the_next_at_once(page: Any, name: str) -> None:
    """Mark the place whose name is in the field; the next name is there before anything else."""
    page.evaluate(
        """(name) => {
            document.getElementById("mark").requestSubmit();
            document.getElementById("mark-name").value = name;
        }""",
        name,
    )


def test_places_tapped_on_the_plan_come_with_the_walk(phone: Any, planned: str) -> None:
    from playwright.sync_api import expect

    take_map(phone)
    phone.begin("With a plan")
    assert not phone.page.is_visible("#marks-again")
    phone.page.click("text=Tap the place on a floor plan")
    canvas = phone.page.locator("#tapping-stage canvas")
    canvas.wait_for()
    box = canvas.bounding_box()
    middle = {"x": box["width"] / 2, "y": box["height"] / 2}
    canvas.click(position=middle)
    assert phone.page.input_value("#mark-name") == "Way in"
    phone.page.click("text=I am here")
    phone.wait_for_text("#tapping-said", "1 place tapped on the plan")
    assert phone.page.locator("#tapping-map").is_disabled()
    assert violations(phone.page) == []
    px_per_m = min(
        (box["width"] - 2 * MARGIN_PX) / WIDTH_M, (box["height"] - 2 * MARGIN_PX) / DEPTH_M
    )
    canvas.click(position={"x": middle["x"] + 2 * px_per_m, "y": middle["y"] - px_per_m})
    phone.page.fill("#mark-name", 'Door, "left"')
    write_the_next_at_once(phone.page, "Somewhere")
    phone.page.click("text=I am here")
    # The page's policy forbids what `wait_for_function` evaluates.
    expect(phone.page.locator("#mark-name")).to_have_value("")
    phone.walk(2)
    phone.page.get_by_role("button", name="I am at Way in again").click()
    phone.page.get_by_role("button", name='I am at Door, "left" again').wait_for()
    folder, _ = phone.finish()
    assert json.loads((folder / "recording.json").read_text())["tapped_on"] == planned
    told = read_recording(folder).checkpoints
    assert told is not None
    assert told.names == ("Way in", 'Door, "left"', "Somewhere", "Way in")
    assert 1.9 < np.diff(told.t_s)[-1] < 5
    assert told.t_s[-1] < frame_times_s(folder)[-1] + 1
    assert told.xy_m is not None
    np.testing.assert_allclose(told.xy_m[[0, 3]], [MIDDLE_M, MIDDLE_M], atol=0.05)
    np.testing.assert_allclose(told.xy_m[1], np.add(MIDDLE_M, [2, 1]), atol=0.05)
    assert np.isnan(told.xy_m[2]).all()
