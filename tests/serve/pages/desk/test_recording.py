"""From a dropped log or zip to its page, its curves, its files, its map and a place in that."""

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planted_logs import LOGS

from elfslam.base.values import Recording
from elfslam.data.importing import LogFormat
from elfslam.data.recordings import read_recording, write_recording
from elfslam.stages.chirp import describe_chirp
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate
from tests.serve.pages.desk.conftest import Person, go, row
from tests.serve.uploading import zipped

pytestmark = pytest.mark.real
LONGEST_MS = 300_000
HEAD = "time,seconds_elapsed,z,y,x\n"


@pytest.fixture(scope="session")
def measured() -> Recording:
    """A walk with every sensor but sound."""
    sensors = tuple(Sensor)
    return simulate(load_world("studio"), 107, rounds=2, sensors=sensors, sound=False)[0]


@pytest.fixture(scope="session")
def sensorlogger_zip(measured: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That walk as Sensor Logger on Android would have written it."""
    imu, magnetometer = measured.imu, measured.magnetometer
    assert imu is not None
    assert magnetometer is not None
    file = tmp_path_factory.mktemp("logger") / "2026-11-24_round.zip"
    told = "version,device name,platform,standardisation\n3,Test Phone,android,true\n"
    seen = "".join(f"{k},{k}.0,net,aa:bb:{k % 3},-{50 + k}\n" for k in range(1, 9))
    files = {
        "Metadata.csv": told,
        "TotalAcceleration.csv": table(imu.t_s, imu.accel_mps2),
        "Gyroscope.csv": table(imu.t_s, imu.gyro_radps),
        "Magnetometer.csv": table(magnetometer.t_s, magnetometer.field_ut),
        "WiFi.csv": f"time,seconds_elapsed,ssid,bssid,level\n{seen}",
    }
    file.write_bytes(zipped(files))
    return file


def table(t_s: np.ndarray, values: np.ndarray) -> str:
    rows = [f"0,{t:.5f},{z:.6f},{y:.6f},{x:.6f}" for t, (x, y, z) in zip(t_s, values, strict=True)]
    return HEAD + "\n".join(rows) + "\n"


def test_from_a_dropped_log_to_its_curves_and_its_map(
    working_desk: Any, sensorlogger_zip: Path, measured: Recording
) -> None:
    page = working_desk
    page.locator("input[name=recordings]").set_input_files(sensorlogger_zip)
    page.get_by_text("2026-11-24_round.zip has arrived.").wait_for()
    page.get_by_role("link", name="2026-11-24_round", exact=True).click()
    page.get_by_role("heading", level=1, name="2026-11-24_round").wait_for()
    page.locator("figure.plot").first.wait_for()
    facts = page.locator("dl.facts").inner_text()
    assert "Sensor Logger" in facts
    assert measured.imu is not None
    rate_hz = round(1 / float(np.median(np.diff(measured.imu.t_s))))
    assert f"{rate_hz} Hz" in facts
    titles = page.locator("figure.plot strong").all_inner_texts()
    assert titles == ["Acceleration", "Turning", "Magnetic field", "Wi-Fi access points"]
    with page.expect_download() as taken:
        page.get_by_role("link", name="Download accelerometer.csv").click()
    rows = np.loadtxt(taken.value.path(), delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 1:], measured.imu.accel_mps2, atol=1e-5)
    page.get_by_role("link", name="See the map").click(timeout=LONGEST_MS)
    page.locator(".map-head").get_by_text("One walk").wait_for()


@pytest.fixture
def full(ada: Person, measured: Recording, tmp_path: Path) -> Any:
    """Somebody with a recording of every sensor."""
    write_recording(measured, tmp_path / "walk")
    assert read_recording(tmp_path / "walk").wifi is not None
    ada.recording = ada.plant_recording("round the studio", tmp_path / "walk")
    return ada


def opened(page: Any, ada: Person) -> Any:
    go(page, f"#/recordings/{ada.recording}")
    page.locator("figure.plot").first.wait_for()
    return page


def test_what_is_under_the_mouse_is_told(full: Any) -> None:
    page = opened(full.open(), full)
    assert page.get_by_role("img", name="Acceleration").count() == 1
    here = page.get_by_role("navigation").get_by_role("link", name="Recordings")
    assert here.get_attribute("aria-current")
    plot = page.locator("figure.plot").first
    plot.locator(".plot-area").hover()
    said = plot.locator("output").inner_text()
    assert said.endswith("m/s²")
    assert " to " in said
    page.mouse.move(0, 0)
    page.locator("figure.plot output").first.get_by_text("m/s²", exact=True).wait_for()


def test_a_recording_is_deleted_from_its_page(ada: Person, full: Any) -> None:
    page = opened(full.open(), full)
    page.get_by_role("button", name="Delete round the studio").click()
    page.get_by_role("button", name="Delete for good").click()
    page.get_by_text("No recordings yet").wait_for()
    assert ada.get(f"/api/recordings/{full.recording}") == 404


def test_a_recording_that_is_not_there_says_so(ada: Person) -> None:
    page = ada.open()
    go(page, "#/recordings/0123")
    page.get_by_role("heading", name="This recording is not here").wait_for()
    page.get_by_role("link", name="Back to the recordings").click()
    page.get_by_text("No recordings yet").wait_for()


def test_what_the_server_refuses_has_not_arrived(ada: Person, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("milk, bread\n")
    (tmp_path / "plan.pdf").write_text("%PDF")
    page = ada.open()
    page.locator("input[name=recordings]").set_input_files(
        [tmp_path / "notes.txt", tmp_path / "plan.pdf"]
    )
    alert = page.get_by_role("alert")
    alert.get_by_text("plan.pdf: wanted what ends in .zip, .txt, .mat, .tar.xz").or_(
        alert.get_by_text("notes.txt was refused: begins with 'milk, bread'")
    ).wait_for()
    page.locator("table.list").get_by_text("begins with 'milk, bread', which").wait_for()
    assert page.locator("table.list tbody tr").count() == 1


DROP = """async (files) => {
  const carried = new DataTransfer();
  for (const [name, text] of files) {
    const bytes = Uint8Array.from(atob(text), (each) => each.charCodeAt(0));
    carried.items.add(new File([bytes], name));
  }
  document.dispatchEvent(new DragEvent("drop", { dataTransfer: carried, bubbles: true }));
}"""


def test_several_logs_are_dropped_at_once_and_told_apart(ada: Person) -> None:
    content = zipped(LOGS[LogFormat.PHYPHOX]())
    log = LOGS[LogFormat.GETSENSORDATA]()["walk.txt"].encode()
    files = {"round.zip": content, "hall.txt": log, "plan.dwg": b"AC1032"}
    page = ada.open()
    told = [[name, base64.b64encode(data).decode()] for name, data in files.items()]
    page.evaluate(DROP, told)
    page.get_by_role("alert").get_by_text("plan.dwg: wanted what ends in").wait_for()
    for name in ("round", "hall"):
        page.get_by_role("link", name=name, exact=True).wait_for()
    kept = {each["name"]: each["facts"]["imported"] for each in ada.get("/api/recordings")}
    assert kept == {"round": "phyphox", "hall": "getsensordata"}


LONGEST_MS = 300_000


@pytest.fixture(scope="module")
def walk_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk with sound, as a phone's owner would have packed it."""
    folder = tmp_path_factory.mktemp("sound")
    recording, _ = simulate(load_world("studio"), 107, rounds=2)
    write_recording(recording, folder / "walk", chirp_description=describe_chirp())
    file = folder / "twice round.zip"
    file.write_bytes(zipped(folder / "walk", "walk/"))
    return file


@pytest.mark.real
def test_from_a_dropped_zip_to_a_located_walk(working_desk: Any, walk_zip: Path) -> None:
    page = working_desk
    page.locator("input[name=recordings]").set_input_files(walk_zip)
    page.get_by_text("twice round.zip has arrived.").wait_for()
    row(page, "twice round").get_by_text("0:").first.wait_for()
    page.get_by_role("link", name="See the map").click(timeout=LONGEST_MS)
    page.get_by_role("heading", level=1).wait_for()
    head = page.locator(".map-head p").inner_text()
    assert "One walk" in head
    assert int(head.split(" place")[0].rsplit("· ", 1)[1]) > 10
    page.get_by_role("button", name="Locate a recording").click()
    page.get_by_role("dialog").get_by_role("button", name="Locate").click()
    page.locator(".legend").get_by_text("located").wait_for(timeout=LONGEST_MS)
    go(page, "#/jobs")
    page.get_by_text("Nothing to do at the moment.").wait_for()
    assert page.get_by_text("Done", exact=True).count() == 2


FACTS = {
    "duration_s": 60.0,
    "spans_s": {"sound": [[0.7, 40.0], [43.0, 59.0]], "motion": [[0.0, 60.0]]},
}
MISSING = [{"what": "sound", "from_s": 40.0, "until_s": 43.0}]


@pytest.fixture
def recording(ada: Person) -> str:
    return str(ada.plant_recording("round the hall", facts=FACTS))


def move(page: Any, end: str, value: str) -> None:
    """As a hand moves one end of the time line."""
    slider = page.get_by_role("slider", name=end)
    slider.evaluate("(input, value) => { input.value = value; }", value)
    slider.dispatch_event("input")


def given(ada: Person) -> dict[str, Any]:
    return dict(ada.get("/api/jobs")[0]["given"])


def test_all_of_a_recording_is_mapped_where_nothing_is_moved(ada: Person, recording: str) -> None:
    page = ada.open("#/recordings")
    page.get_by_role("button", name="Map round the hall").click()
    page.get_by_role("dialog").get_by_role("button", name="Map it").click()
    page.get_by_text("is waiting to be mapped").wait_for()
    told = given(ada)
    assert (told["recording"], told["from_s"], told["until_s"]) == (recording, None, None)


def test_a_stretch_is_chosen_on_a_time_line(ada: Person, recording: str) -> None:
    page = ada.open("#/recordings")
    page.get_by_role("button", name="Map round the hall").click()
    dialog = page.get_by_role("dialog")
    sound = dialog.get_by_role("img", name="Sound: 0:00.7 to 0:40.0, 0:43.0 to 0:59.0")
    assert sound.count() == 1
    assert dialog.get_by_role("img", name="Motion: 0:00.0 to 1:00.0").count() == 1
    move(page, "From", "12.5")
    move(page, "Until", "45")
    assert "0:12.5" in dialog.inner_text()
    assert "0:45.0" in dialog.inner_text()
    dialog.get_by_role("button", name="Map it").click()
    page.get_by_text("is waiting to be mapped").wait_for()
    told = given(ada)
    assert (told["recording"], told["from_s"], told["until_s"]) == (recording, 12.5, 45.0)


def test_the_ends_are_moved_by_keys_and_never_cross(ada: Person, recording: str) -> None:
    page = ada.open("#/recordings")
    page.get_by_role("button", name="Map round the hall").click()
    begin, end = (page.get_by_role("slider", name=name) for name in ("From", "Until"))
    begin.focus()
    page.keyboard.press("ArrowRight")
    assert begin.input_value() == "0.1"
    assert begin.get_attribute("aria-valuetext") == "0:00.1"
    page.keyboard.press("End")
    assert (begin.input_value(), end.input_value()) == ("58", "60")
    end.focus()
    page.keyboard.press("Home")
    assert (begin.input_value(), end.input_value()) == ("0", "2")


def test_a_map_says_what_is_missing_and_is_made_again_of_a_stretch(
    ada: Person, recording: str
) -> None:
    facts = {"missing": MISSING, "kept_s": [5.0, 1e6], "footsteps": 9}
    made = ada.plant_map("round the hall", facts=facts, sources=[recording])
    page = ada.open(f"#/maps/{made}")
    part = page.get_by_role("region", name="Recording")
    part.get_by_text("Sound is missing from 0:40.0 to 0:43.0").wait_for()
    part.get_by_text("Mapped from 0:05.0 to the end.").wait_for()
    part.get_by_role("button", name="Trim and map again").click()
    assert page.get_by_role("slider", name="From").input_value() == "5"
    move(page, "Until", "39.9")
    page.get_by_role("dialog").get_by_role("button", name="Map it").click()
    page.get_by_text("Another map of round the hall is being made; this one stays.").wait_for()
    told = given(ada)
    assert (told["from_s"], told["until_s"]) == (5.0, 39.9)
    go(page, "#/maps")
    page.get_by_text("of a stretch of the recording").wait_for()


def test_of_a_recording_that_is_gone_only_what_was_missing_is_told(ada: Person) -> None:
    made = ada.plant_map("round the hall", facts={"missing": MISSING})
    page = ada.open(f"#/maps/{made}")
    page.get_by_text("Sound is missing from 0:40.0 to 0:43.0").wait_for()
    assert page.get_by_role("button", name="Trim and map again").count() == 0
    whole = ada.plant_map("another")
    go(page, f"#/maps/{whole}")
    page.get_by_role("heading", name="another").wait_for()
    assert page.get_by_role("region", name="Recording").count() == 0


@pytest.mark.parametrize("width_px", [320, 390, 1280])
def test_the_time_line_fits(ada: Person, recording: str, width_px: int) -> None:
    page = ada.open("#/recordings", viewport={"width": width_px, "height": 800})
    page.get_by_role("button", name="Map round the hall").click()
    dialog = page.get_by_role("dialog")
    assert dialog.evaluate("(element) => element.scrollWidth - element.clientWidth") <= 0
    for name in ("From", "Until"):
        box = page.get_by_role("slider", name=name).bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width_px
