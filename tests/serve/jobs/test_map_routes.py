"""Maps over HTTP: looked at, taken home, deleted; and their points of interest."""

import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from httpx import Response
from PIL import Image

from elfslam.data.geographic import Origin, from_lon_lat
from elfslam.data.map_files import read_map
from elfslam.data.named_places import LONGEST_NAME, MOST, POINTS_OF_INTEREST
from elfslam.data.position_files import read_tum
from elfslam.serve.maps.view import view_of
from elfslam.serve.services import Services
from elfslam.serve.store.tables import new_id
from tests.serve.conftest import Somebody
from tests.serve.jobs.conftest import Keep
from tests.serve.planting import picture, plan_of_levels, put_plan
from tests.serve.uploading import unzipped

PLACE = {
    "name": "Studio", "category": "businesscampus", "address": "1 Long Street",
    "locality": "Zurich", "country": "CH", "level": "Ground floor", "ordinal": "0",
}  # fmt: skip
ZURICH = Origin(47.3769, 8.5417, 90.0)
ORIGIN = {"origin": "47.3769,8.5417,90"}


def files_of(services: Services) -> list[str]:
    return sorted(file.name for file in services.settings.blobs_folder.glob("*/*"))


def test_a_map_is_told_and_drawn(owner: Somebody, one: str, runs: Path) -> None:
    [told] = owner.get("/api/maps").json()
    assert told == owner.get(f"/api/maps/{one}").json()
    assert (told["id"], told["name"], told["kind"]) == (one, "one", "run")
    assert {file["name"] for file in told["files"]} == {
        file.name for file in (runs / "one").iterdir()
    }
    assert owner.get(f"/api/maps/{one}/view").json() == view_of(runs / "one")


def test_the_report_cannot_reach_the_server(owner: Somebody, one: str, runs: Path) -> None:
    answer = owner.get(f"/api/maps/{one}/report.html")
    assert answer.content == (runs / "one" / "report.html").read_bytes()
    assert answer.headers["content-security-policy"].startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in answer.headers["content-security-policy"]
    assert answer.headers["content-type"].startswith("text/html")


def test_the_drawing_script_of_a_report_is_public(
    owner: Somebody, anyone: Somebody, one: str, runs: Path
) -> None:
    [script] = re.findall('script src="([^"]+)"', owner.get(f"/api/maps/{one}/report.html").text)
    answer = anyone.get(f"/api/maps/{one}/{script}")
    assert answer.content == (runs / "one" / script).read_bytes()
    assert answer.headers["cross-origin-resource-policy"] == "cross-origin"


@pytest.mark.parametrize("name", ["one", "floor"])
def test_the_zip_is_the_folder(owner: Somebody, keep_map: Keep, runs: Path, name: str) -> None:
    answer = owner.get(f"/api/maps/{keep_map(owner, name)}/map.zip")
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        found = {each: archive.read(each) for each in archive.namelist()}
    files = (file for file in (runs / name).rglob("*") if file.is_file())
    wanted = {f"{name}/{file.relative_to(runs / name).as_posix()}": file for file in files}
    assert found == {each: file.read_bytes() for each, file in wanted.items()}
    assert f"''{name}.zip" in answer.headers["content-disposition"]


def test_exports_say_where_the_map_is(
    owner: Somebody, one: str, runs: Path, tmp_path: Path
) -> None:
    base = f"/api/maps/{one}/exports"
    assert owner.get(base).json() == ["tum", "g2o", "onnx", "geojson", "imdf", "ros", "parquet"]
    (tmp_path / "one.tum").write_bytes(owner.get(f"{base}/tum").content)
    _, poses = read_tum(tmp_path / "one.tum")
    npt.assert_allclose(poses, read_tum(runs / "one" / "trajectory.tum")[1], atol=1e-9)
    assert owner.get(f"{base}/onnx").content == (runs / "one" / "encoder.onnx").read_bytes()
    assert owner.get(f"{base}/g2o").text.startswith("VERTEX_SE2 0 ")
    assert owner.get(f"{base}/parquet").content[:4] == b"PAR1"
    spots = owner.get(f"{base}/geojson", params=ORIGIN).json()["features"]
    lon_lat = np.array(
        [each["geometry"]["coordinates"] for each in spots if each["geometry"]["type"] == "Point"]
    )
    xy_m = from_lon_lat(ZURICH, lon_lat)
    npt.assert_allclose(
        np.sort(xy_m, axis=0), np.sort(read_map(runs / "one").xy_m, axis=0), atol=1e-3
    )
    ros = unzipped(owner.get(f"{base}/ros").content)
    assert sorted(ros) == ["one.pgm", "one.yaml"]
    assert 'image: "one.pgm"' in ros["one.yaml"].decode()
    imdf = unzipped(owner.get(f"{base}/imdf", params={**ORIGIN, **PLACE}).content)
    venue = json.loads(imdf["venue.geojson"])
    assert venue["features"][0]["properties"]["name"] == {"en": "Studio"}


def test_what_an_export_needs_is_said_in_a_line(owner: Somebody, keep_map: Keep) -> None:
    base = f"/api/maps/{keep_map(owner, 'floor')}/exports"
    assert owner.get(base).json() == ["onnx", "geojson", "imdf", "ros", "parquet"]
    for path, params, words in (
        ("geojson", {}, "origin: a map does not know where"),
        ("geojson", {"origin": "95,8"}, "wanted LAT,LON"),
        ("imdf", {**ORIGIN, "name": "Studio"}, "category: imdf asks for category, address"),
        ("imdf", {**ORIGIN, **PLACE, "category": "palace"}, "category"),
        ("ros", {"resolution_m": "7"}, "resolution_m: got 7, wanted"),
        ("g2o", {}, "floor: wanted the run of one walk"),
    ):
        answer = owner.get(f"{base}/{path}", params=params)
        assert answer.status_code == 422, path
        assert answer.headers["content-type"] == "application/problem+json"
        assert words in answer.json()["detail"]
        assert "--" not in answer.json()["detail"]
        assert str(owner.services.settings.data_folder) not in answer.json()["detail"]
    assert owner.get(f"{base}/dwg").status_code == 422
    assert list(owner.services.settings.work_folder.iterdir()) == []


def test_a_floor_plan_is_kept_placed_and_replaced(owner: Somebody, one: str) -> None:
    before, place = files_of(owner.services), f"/api/maps/{one}/floor-plan"
    assert owner.get(place).status_code == 404
    assert (
        owner.put(f"{place}/placement", json={"width_m": 1, "x_m": 0, "y_m": 0}).status_code == 404
    )
    assert put_plan(owner, one, picture()).status_code == 200
    assert owner.get(place).content == picture()
    assert owner.get(place).headers["content-type"] == "image/png"
    where = {"width_m": 12.5, "x_m": -1.0, "y_m": 2.0, "heading_rad": 0.1, "opacity": 0.4}
    told = owner.put(f"{place}/placement", json=where).json()
    assert told["floor_plan"]["placement"] == where
    assert "floor-plan" not in {file["name"] for file in told["files"]}
    assert put_plan(owner, one, picture("JPEG", 50, 20, turned=6), "image/jpeg").status_code == 200
    plan = owner.get(f"/api/maps/{one}").json()["floor_plan"]
    shown = {"width_px": 20, "height_px": 50, "type": "image/jpeg", "width_m": None}
    assert plan == {**shown, "placement": where}
    assert len(files_of(owner.services)) == len(before) + 1
    assert owner.delete(place).status_code == 204
    assert owner.get(f"/api/maps/{one}").json()["floor_plan"] is None
    assert files_of(owner.services) == before
    assert owner.delete(place).status_code == 404


NO_PLANS = [
    (b"", "image/png", 422),
    (picture()[:60], "image/png", 422),
    (b"<svg onload='alert(1)'/>", "image/svg+xml", 422),
    (b"GIF89a", "image/gif", 415),
    (b"%PDF-1.7 and no more", "application/pdf", 422),
    (b'{"features": []}', "application/geo+json", 422),
    (b"<svg onload='alert(1)'/>", "image/png", 422),
    (picture("GIF"), "image/png", 422),
    (picture("PNG", 10_000, 10_000), "image/png", 422),
    (b"\0" * (17 * 2**20), "image/png", 413),
]


def test_what_is_no_floor_plan_is_refused(owner: Somebody, one: str, services: Services) -> None:
    before = files_of(services)
    for content, kind, status in NO_PLANS:
        assert put_plan(owner, one, content, kind).status_code == status, (content[:30], kind)
    assert owner.get(f"/api/maps/{one}").json()["floor_plan"] is None
    assert files_of(services) == before


SVG = (
    b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 30" onload="alert(1)">'
    b'<script>alert(1)</script><rect width="20" height="30" fill="black"/></svg>'
)
SHAPES = {"type": "LineString", "coordinates": [[0, 0], [19.8, 0], [19.8, 9.8]]}


@pytest.mark.parametrize(
    ("content", "kind", "width_m"),
    [
        (SVG, "image/svg+xml", None),
        (SVG, "image/png", None),
        (json.dumps(SHAPES).encode(), "application/geo+json", 20.0),
        (json.dumps(SHAPES).encode(), "application/json", 20.0),
    ],
)
def test_what_is_no_picture_is_drawn_as_one(
    owner: Somebody, one: str, services: Services, content: bytes, kind: str, width_m: float | None
) -> None:
    assert put_plan(owner, one, content, kind).status_code == 200
    told = owner.get(f"/api/maps/{one}").json()["floor_plan"]
    assert (told["type"], told["placement"]) == ("image/png", None)
    assert told["width_m"] == (width_m and pytest.approx(width_m, abs=0.02))
    answer = owner.get(f"/api/maps/{one}/floor-plan")
    assert answer.headers["content-type"] == "image/png"
    with Image.open(io.BytesIO(answer.content)) as drawn:
        assert drawn.size == (told["width_px"], told["height_px"])
        assert drawn.format == "PNG"
        assert {each for _, each in drawn.convert("L").getcolors(256) or []} >= {0, 255}
    assert list(services.settings.work_folder.iterdir()) == []


def test_a_level_of_a_plan_is_chosen_from_those_that_the_refusal_lists(
    owner: Somebody, one: str
) -> None:
    place = f"/api/maps/{one}/floor-plan"
    house = plan_of_levels(**{"0": 6, "-1": 9})

    def answer(**level: str) -> Response:
        return put_plan(owner, one, house.encode(), "application/geo+json", **level)

    refused = answer()
    assert (refused.status_code, refused.json()["levels"]) == (422, ["-1", "0"])
    assert refused.json()["detail"] == "the plan has the levels -1, 0; choose one"
    assert answer(level="7").json()["levels"] == ["-1", "0"]
    assert owner.get(place).status_code == 404
    widths_m = [answer(level=level).json()["floor_plan"]["width_m"] for level in ("0", "-1")]
    assert widths_m == pytest.approx([6.2, 9.2], abs=0.02)
    assert answer(level="x" * 81).status_code == 422


def test_a_deleted_map_is_gone_from_the_disk(
    owner: Somebody, guest: Somebody, keep_map: Keep, services: Services
) -> None:
    before = files_of(services)
    mine, theirs = keep_map(owner, "one"), keep_map(guest, "one")
    put_plan(owner, mine, picture())
    both = files_of(services)
    assert owner.delete(f"/api/maps/{mine}").status_code == 204
    assert owner.delete(f"/api/maps/{mine}").status_code == 404
    assert len(files_of(services)) == len(both) - 1, "the other's files stay, the plan goes"
    assert guest.get(f"/api/maps/{theirs}/view").status_code == 200
    guest.delete(f"/api/maps/{theirs}")
    assert files_of(services) == before


def test_a_damaged_map_is_a_problem_and_no_crash(owner: Somebody, one: str) -> None:
    named = {file["name"]: file["sha256"] for file in owner.get(f"/api/maps/{one}").json()["files"]}
    sha256 = named["trajectory.tum"]
    file = owner.services.settings.blobs_folder / sha256[:2] / sha256
    file.unlink()
    for path in ("view", "map.zip", "exports/tum"):
        assert owner.get(f"/api/maps/{one}/{path}").status_code == 404
    file.write_text("1 2 x\n")
    for path in ("view", "exports/tum"):
        answer = owner.get(f"/api/maps/{one}/{path}")
        assert answer.status_code == 422
        assert str(owner.services.settings.data_folder) not in answer.json()["detail"]


def test_whatever_lost_its_blobs_is_not_found(owner: Somebody, one: str) -> None:
    put_plan(owner, one, picture())
    manifest = json.loads(owner.get(f"/api/maps/{one}/package").json()["manifest"])
    part = manifest["tiles"][0]["sha256"]
    paths = ("report.html", "floor-plan", f"package/{part}", "map.zip", "view", "exports/tum")
    for path in paths:
        assert owner.get(f"/api/maps/{one}/{path}").status_code == 200, path
    for file in owner.services.settings.blobs_folder.glob("*/*"):
        file.unlink()
    for path in paths:
        answer = owner.get(f"/api/maps/{one}/{path}")
        assert answer.status_code == 404, path
        assert answer.json()["detail"].endswith("here; it may have been deleted")


def test_ids_that_are_none_are_not_found(owner: Somebody) -> None:
    for each in (new_id(), "x", "%2e%2e", "a" * 300):
        assert owner.get(f"/api/maps/{each}").status_code == 404
        assert owner.get(f"/api/jobs/{each}").status_code == 404


ROOM = {"name": "Room 5", "kind": "room", "x_m": 1.25, "y_m": -2.0}
DOOR = {"name": "Tür, links", "kind": "door", "x_m": 3.0, "y_m": 0.5}


def address(map_id: str) -> str:
    return f"/api/maps/{map_id}/points-of-interest"


def put_points(client: Somebody, map_id: str, version: str, *points: dict[str, Any]) -> Any:
    return client.put(address(map_id), json={"version": version, "points": list(points)})


def test_they_are_kept_in_their_order_and_taken_away(owner: Somebody, one: str) -> None:
    assert owner.get(address(one)).json() == {"version": "", "points": []}
    first = put_points(owner, one, "", ROOM, DOOR).json()
    assert first["points"] == [ROOM, DOOR]
    assert owner.get(address(one)).json() == first
    second = put_points(owner, one, first["version"], DOOR).json()
    assert (second["points"], second["version"] != first["version"]) == ([DOOR], True)
    assert put_points(owner, one, second["version"]).json() == {"version": "", "points": []}
    names = {file["name"] for file in owner.get(f"/api/maps/{one}").json()["files"]}
    assert POINTS_OF_INTEREST not in names


def test_who_changed_another_version_is_told_and_changes_nothing(owner: Somebody, one: str) -> None:
    kept = put_points(owner, one, "", ROOM).json()
    for version in ("", "0" * 64):
        refused = put_points(owner, one, version, DOOR)
        assert refused.status_code == 409
        assert "load them again" in refused.json()["detail"]
    assert owner.get(address(one)).json() == kept


def test_what_cannot_be_meant_is_refused(owner: Somebody, one: str) -> None:
    names = (" ", "two\nlines", "x" * (LONGEST_NAME + 1), "\u0958" * LONGEST_NAME)
    for wrong in (
        *({"name": each} for each in names),
        {"kind": "gate"},
        {"x_m": "here"},
        {"y_m": 2e8},
    ):
        assert put_points(owner, one, "", {**ROOM, **wrong}).status_code == 422, wrong
    assert owner.get(address(one)).json()["points"] == []


def test_there_are_not_too_many(owner: Somebody, one: str) -> None:
    assert put_points(owner, one, "", *[ROOM] * (MOST + 1)).status_code == 422
    assert len(put_points(owner, one, "", *[ROOM] * MOST).json()["points"]) == MOST


def test_exports_and_the_folder_carry_them(owner: Somebody, one: str) -> None:
    put_points(owner, one, "", ROOM, DOOR).raise_for_status()
    asked = {"origin": "47.3769,8.5417"}
    told = owner.get(f"/api/maps/{one}/exports/geojson", params=asked).json()
    points = [
        each["properties"]["name"]
        for each in told["features"]
        if each["properties"]["kind"] == "point_of_interest"
    ]
    assert points == ["Room 5", "Tür, links"]
    venue = {
        "name": "Office", "category": "businesscampus", "address": "Street 1", "locality": "Town",
        "country": "CH", "level": "Ground floor", "ordinal": 0,
    }  # fmt: skip
    archive = owner.get(f"/api/maps/{one}/exports/imdf", params={**asked, **venue}).content
    amenities = json.loads(unzipped(archive)["amenity.geojson"])["features"]
    assert [each["properties"]["category"] for each in amenities] == ["unspecified", "entry"]
    table = unzipped(owner.get(f"/api/maps/{one}/map.zip").content)[POINTS_OF_INTEREST]
    assert table.decode().splitlines()[1] == "Room 5,room,1.250,-2.000"


def test_phones_are_told_and_told_anew(owner: Somebody, one: str) -> None:

    def manifest() -> Any:
        return json.loads(owner.get(f"/api/maps/{one}/package").json()["manifest"])

    first = manifest()
    assert "points_of_interest" not in first
    kept = put_points(owner, one, "", ROOM).json()
    second = manifest()
    assert second["points_of_interest"] == [ROOM]
    assert second["revision"] > first["revision"]
    assert second["tiles"] == first["tiles"]
    put_points(owner, one, kept["version"]).raise_for_status()
    assert "points_of_interest" not in manifest()
