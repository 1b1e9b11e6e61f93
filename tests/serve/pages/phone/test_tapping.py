"""Places tapped on a floor plan while a walk is recorded, in Chromium."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from elfslam.base.values import FloorMap, Payload
from elfslam.data.recordings import read_recording
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.stages.feature import load_encoder
from tests.accessibility import violations
from tests.serve.pages.phone.test_phone_page import finished, frame_times_s
from tests.serve.planting import plant_floor_map

pytestmark = pytest.mark.real

WIDTH_M, DEPTH_M, MARGIN_PX = 8.0, 4.0, 12
MIDDLE_M = (WIDTH_M / 2, DEPTH_M / 2)


@pytest.fixture
def planned(server: Any, tmp_path: Path) -> Iterator[str]:
    """A map on the server with a plan of 8 m by 4 m, in the middle of which is a door."""
    xy_m = np.array([[1.0, 1.0], [7.0, 3.0]])
    vectors = np.eye(2, 128, dtype=np.float32)
    spots = FloorMap(
        xy_m=xy_m,
        heading_rad=np.zeros(2),
        walk=np.zeros(2, dtype=np.int64),
        order=np.arange(2),
        covariance_m2=np.tile(0.01 * np.eye(2), (2, 1, 1)),
        payloads=(Payload("elf", load_encoder("compact").identity, vectors),),
        parameters_digest="",
        sources=("walk",),
    )
    (folder := tmp_path / "map").mkdir()
    services = open_services(ServerSettings(server.data))
    map_id = plant_floor_map(services, spots, folder)
    services.engine.dispose()
    image = io.BytesIO()
    Image.new("RGB", (400, 200), "white").save(image, "PNG")
    plan, kind = f"/api/maps/{map_id}/floor-plan", {"Content-Type": "image/png"}
    server.ask(plan, "PUT", content=image.getvalue(), headers=kind)
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


def test_places_tapped_on_the_plan_come_with_the_walk(
    phone: Any, server: Any, planned: str, tmp_path: Path
) -> None:
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
    phone.page.wait_for_function("!document.getElementById('mark-name').value")
    phone.walk(2)
    phone.page.get_by_role("button", name="I am at Way in again").click()
    phone.page.get_by_role("button", name='I am at Door, "left" again').wait_for()
    folder, _ = finished(phone, server, tmp_path)
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
