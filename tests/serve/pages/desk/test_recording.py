"""From a dropped Sensor Logger zip to its page, its curves, its files and its map."""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planted_logs import LOGS

from elfslam.base.values import Recording
from elfslam.data.importing import LogFormat
from elfslam.data.recordings import read_recording, write_recording
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world, simulate

pytestmark = pytest.mark.real
Open = Callable[..., Any]
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
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("Metadata.csv", told)
        packed.writestr("TotalAcceleration.csv", table(imu.t_s, imu.accel_mps2))
        packed.writestr("Gyroscope.csv", table(imu.t_s, imu.gyro_radps))
        packed.writestr("Magnetometer.csv", table(magnetometer.t_s, magnetometer.field_ut))
        seen = "".join(f"{k},{k}.0,net,aa:bb:{k % 3},-{50 + k}\n" for k in range(1, 9))
        packed.writestr("WiFi.csv", f"time,seconds_elapsed,ssid,bssid,level\n{seen}")
    return file


def table(t_s: np.ndarray, values: np.ndarray) -> str:
    rows = [f"0,{t:.5f},{z:.6f},{y:.6f},{x:.6f}" for t, (x, y, z) in zip(t_s, values, strict=True)]
    return HEAD + "\n".join(rows) + "\n"


def test_from_a_dropped_log_to_its_curves_and_its_map(
    working_desk: tuple[Any, str], sensorlogger_zip: Path, measured: Recording
) -> None:
    page, _ = working_desk
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
def full(person: Any, measured: Recording, tmp_path: Path) -> Any:
    """Somebody with a recording of every sensor."""
    write_recording(measured, tmp_path / "walk")
    assert read_recording(tmp_path / "walk").wifi is not None
    person.recording = person.plant_recording("round the studio", tmp_path / "walk")
    return person


def opened(page: Any, person: Any) -> Any:
    page.evaluate("id => { location.hash = `#/recordings/${id}`; }", person.recording)
    page.locator("figure.plot").first.wait_for()
    return page


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_its_page_fits_and_can_be_read(full: Any, open_desk: Open, width: int) -> None:
    page = opened(open_desk(full, viewport={"width": width, "height": 800}), full)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    small = page.evaluate(
        """() => [...document.querySelectorAll(".recording .plot *")].filter((each) =>
          each.childElementCount === 0 && each.textContent
            && parseFloat(getComputedStyle(each).fontSize) < 15)
          .map((each) => each.outerHTML)"""
    )
    assert small == []
    assert page.get_by_role("img", name="Acceleration").count() == 1
    assert (
        page.get_by_role("navigation")
        .get_by_role("link", name="Recordings")
        .get_attribute("aria-current")
    )


def test_what_is_under_the_mouse_is_told(full: Any, open_desk: Open) -> None:
    page = opened(open_desk(full), full)
    plot = page.locator("figure.plot").first
    plot.locator(".plot-area").hover()
    said = plot.locator("output").inner_text()
    assert said.endswith("m/s²")
    assert " to " in said
    page.mouse.move(0, 0)
    page.locator("figure.plot output").first.get_by_text("m/s²", exact=True).wait_for()


def test_a_recording_is_deleted_from_its_page(full: Any, open_desk: Open, asked: Any) -> None:
    page = opened(open_desk(full), full)
    page.get_by_role("button", name="Delete round the studio").click()
    page.get_by_role("button", name="Delete for good").click()
    page.get_by_text("No recordings yet").wait_for()
    assert asked(page, f"/api/recordings/{full.recording}") == 404


def test_a_recording_that_is_not_there_says_so(person: Any, open_desk: Open) -> None:
    page = open_desk(person)
    page.evaluate("location.hash = '#/recordings/0123'")
    page.get_by_role("heading", name="This recording is not here").wait_for()
    page.get_by_role("link", name="Back to the recordings").click()
    page.get_by_text("No recordings yet").wait_for()


def test_what_the_server_refuses_has_not_arrived(
    person: Any, open_desk: Open, tmp_path: Path
) -> None:
    (tmp_path / "notes.txt").write_text("milk, bread\n")
    (tmp_path / "plan.pdf").write_text("%PDF")
    page = open_desk(person)
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


def test_several_logs_are_dropped_at_once_and_told_apart(
    person: Any, open_desk: Open, asked: Any
) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as packed:
        for name, text in LOGS[LogFormat.PHYPHOX]().items():
            packed.writestr(name, text)
    log = LOGS[LogFormat.GETSENSORDATA]()["walk.txt"].encode()
    files = {"round.zip": content.getvalue(), "hall.txt": log, "plan.dwg": b"AC1032"}
    page = open_desk(person)
    told = [[name, base64.b64encode(data).decode()] for name, data in files.items()]
    page.evaluate(DROP, told)
    page.get_by_role("alert").get_by_text("plan.dwg: wanted what ends in").wait_for()
    for name in ("round", "hall"):
        page.get_by_role("link", name=name, exact=True).wait_for()
    kept = {each["name"]: each["facts"]["imported"] for each in asked(page, "/api/recordings")}
    assert kept == {"round": "phyphox", "hall": "getsensordata"}
