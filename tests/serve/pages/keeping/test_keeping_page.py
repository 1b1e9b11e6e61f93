"""The kept page and kept maps in Chromium: without the server, after a restart, tampered with."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from elfslam.base.values import FloorMap
from elfslam.data.tiles import stretches_of, tiles_of
from elfslam.serve.network.authority import fingerprint, signing_key
from elfslam.serve.settings import PAGES_FOLDER
from tests.data.phone_maps import map_of_parts
from tests.in_node import needs_node, passed_in_node
from tests.serve.conftest import Maps, Somebody
from tests.serve.planting import plant_floor_map
from tests.waiting import until

Start = Callable[..., Any]
PATIENCE_S = 60.0
HOLD = """
const { openPackages } = await import("/keeping/packages.js");
const { openStore } = await import("/keeping/store.js");
const packages = openPackages(await openStore());
"""
UPDATE = f"""async (id) => {{ {HOLD}
  try {{ return await packages.update(id); }} catch (error) {{ return error.message; }}
}}"""
OPEN = f"""async (id) => {{ {HOLD}
  try {{
    const {{ floorMap, encoderBytes, facts }} = await packages.open(id);
    return {{ spots: facts.spots, revision: facts.revision, encoder: encoderBytes.length,
      x: Array.from(floorMap.xyM.slice(0, 4)), listed: (await packages.list()).length }};
  }} catch (error) {{ return error.message; }}
}}"""
WALKS = (
    """async () => (await import("/phone/storage_client.js")).startStorage().ask({ do: "list" })"""
)
CACHED = """async () => {
  const found = [];
  for (const name of await caches.keys()) {
    for (const { url } of await (await caches.open(name)).keys()) found.push(new URL(url).pathname);
  }
  return found;
}"""


def pairing(server: Any) -> str:
    """The address that the server's code holds."""
    key = fingerprint(signing_key(server.data / "authority"))
    return f"{server.url}#token={server.token}&key={key}"


def wait_for(page: Any, happened: Callable[[], bool], what: str) -> None:
    """Wait until something has happened."""
    until(happened, what, patience_s=PATIENCE_S, between=lambda: page.wait_for_timeout(50))


def visit(page: Any, address: str) -> None:
    """Open the page and wait until it is kept."""
    page.goto(address)
    page.wait_for_selector("html[data-offline=kept]", state="attached", timeout=1000 * PATIENCE_S)


def stop(server: Any) -> None:
    """Switch the server off."""
    server.process.kill()
    server.process.wait()
    with pytest.raises(httpx.TransportError):
        httpx.get(server.url)


def test_after_one_visit_nothing_of_the_server_is_needed(
    start_server: Start, maps: Maps, pocket: Any
) -> None:
    server = start_server()
    map_id = plant_floor_map(server.data, maps[0])
    with pocket.on() as page:
        visit(page, pairing(server))
        made = page.evaluate(UPDATE, map_id)
        assert made["fetchedBytes"] == made["sizeBytes"] > 1e6
        known = page.evaluate(OPEN, map_id)
        assert known["spots"] == len(maps[0].xy_m)
        listed = {file["path"] for file in httpx.get(f"{server.url}precache.json").json()["files"]}
        assert set(page.evaluate(CACHED)) == listed | {"/precache.json"}
        stop(server)
        page.reload()
        assert page.is_visible("#allow")
        assert page.evaluate(OPEN, map_id) == known
        assert page.evaluate(WALKS) == []
        refused = page.evaluate(UPDATE, map_id)
        assert "does not answer" in refused
    with pocket.on() as page:  # a browser that was closed meanwhile
        page.goto(server.url)
        assert page.is_visible("#allow")
        assert page.inner_text("h1") == "Walk, and get a map"
        colour = page.evaluate("getComputedStyle(document.querySelector('#allow')).cursor")
        assert colour == "pointer"
        assert page.evaluate(OPEN, map_id) == known
        assert page.evaluate(WALKS) == []


def test_only_changes_are_fetched_forgeries_refused_and_signing_out_forgets_all(
    start_server: Start, maps: Maps, pocket: Any
) -> None:
    server = start_server()
    map_id = plant_floor_map(server.data, maps[0])
    with pocket.on() as page:
        visit(page, pairing(server))
        page.evaluate(UPDATE, map_id)
        first = page.evaluate(OPEN, map_id)
        with httpx.Client(base_url=server.url, headers=server.bearer) as client:
            older = client.get(f"/api/maps/{map_id}/package").json()
            plant_floor_map(server.data, maps[1], map_id)
            newer = client.get(f"/api/maps/{map_id}/package").json()
        tile = changed_tile(older, newer)
        kept = server.data / "blobs" / tile[:2] / tile
        whole = kept.read_bytes()
        kept.chmod(0o600)
        kept.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))  # on the server's own disk
        assert "A part of the map" in page.evaluate(UPDATE, map_id)
        assert page.evaluate(OPEN, map_id) == first
        kept.write_bytes(whole)
        signing = server.data / "authority" / "signing.key"
        signing.rename(signing.with_suffix(".true"))  # the server makes another one
        assert "The server's key is not the one" in page.evaluate(UPDATE, map_id)
        assert page.evaluate(OPEN, map_id) == first
        signing.with_suffix(".true").replace(signing)
        made = page.evaluate(UPDATE, map_id)
        assert 0 < made["fetchedBytes"] < made["sizeBytes"] / 10
        second = page.evaluate(OPEN, map_id)
        assert second["revision"] > first["revision"]
        page.route("**/package", lambda route: route.fulfill(json=older))
        assert "an older state" in page.evaluate(UPDATE, map_id)
        assert page.evaluate(OPEN, map_id) == second
        page.goto(f"{server.url}desk")
        page.click("text=Sign out")
        page.wait_for_selector("body[data-page=door]")
        page.wait_for_load_state("networkidle")
        page.goto(server.url)
        assert "not on this phone" in page.evaluate(OPEN, map_id)
        assert "does not know the server's key" in page.evaluate(UPDATE, map_id)
        left = page.evaluate(f"async () => {{ {HOLD} return (await openStore()).names(); }}")
        assert left == [], "signing out forgets the maps"


def changed_tile(older: dict[str, str], newer: dict[str, str]) -> str:
    """A tile that only the newer package has."""
    tiles = [
        {tile["sha256"] for tile in json.loads(told["manifest"])["tiles"]}
        for told in (older, newer)
    ]
    return min(tiles[1] - tiles[0])


def test_a_new_version_takes_the_place_of_the_old_one(
    start_server: Start, pocket: Any, tmp_path: Path
) -> None:
    pages = tmp_path / "pages"
    shutil.copytree(PAGES_FOLDER, pages)
    server = start_server(pages=pages)
    with pocket.on() as page:
        visit(page, pairing(server))
        assert page.evaluate("(async () => (await caches.keys()).length)()") == 1
        before = page.evaluate("(async () => (await caches.keys())[0])()")
        edited(pages / "phone.html", "Walk, and get a map", "Go, and get a map")
        page.reload()  # shows what is kept, finds the new version, and changes to it by itself
        wait_for(page, lambda: title(page) == "Go, and get a map", "the new version")
        wait_for(page, lambda: names_of_caches(page) != [before], "the old version is dropped")
        assert len(names_of_caches(page)) == 1
        edited(pages / "phone.html", "Go, and get a map", "Run, and get a map")
        page.evaluate("document.getElementById('start').hidden = true")  # something goes on
        page.evaluate("(async () => (await navigator.serviceWorker.ready).update())()")
        wait_for(page, lambda: len(names_of_caches(page)) == 2, "the next version is fetched")
        page.wait_for_timeout(500)
        assert page.inner_text("h1", timeout=1000) == "Go, and get a map"
    with pocket.on() as page:  # the next visit
        page.goto(server.url)
        wait_for(page, lambda: title(page) == "Run, and get a map", "the next version")
        wait_for(page, lambda: len(names_of_caches(page)) == 1, "the old version is dropped")
        stop(server)
        page.reload()
        assert title(page) == "Run, and get a map"


def edited(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def title(page: Any) -> str:
    """The heading, while pages come and go."""
    try:
        return str(page.text_content("#start-title", timeout=2000))
    except Exception:  # the page is being left
        return ""


def names_of_caches(page: Any) -> list[str]:
    """The versions that are kept."""
    try:
        return list(page.evaluate("(async () => caches.keys())()"))
    except Exception:  # the page is being left
        return []


HERE = Path(__file__).parent


def state_of(client: Somebody, map_id: str, parts: Path) -> dict[str, Any]:
    """A signed package, its parts put into a folder."""
    signed: dict[str, Any] = client.get(f"/api/maps/{map_id}/package").raise_for_status().json()
    told = json.loads(signed["manifest"])
    for part in [*told["tiles"], *told["features"], told["encoder"]]:
        answer = client.get(f"/api/maps/{map_id}/package/{part['sha256']}").raise_for_status()
        (parts / part["sha256"]).write_bytes(answer.content)
    return signed


def wanted(floor_map: FloorMap, file: Path) -> None:
    """What a phone should hold of a map, as one block of float32."""
    tiles = [tile.content for tile in tiles_of(floor_map)]
    stretches = [(each.walk, each.content) for each in stretches_of(floor_map)]
    read = map_of_parts(tiles, stretches, encoder="", sources=("",))
    flat = read.covariance_m2.reshape(-1, 4)[:, [0, 1, 3]]
    columns = (
        read.walk,
        read.order,
        read.xy_m,
        read.heading_rad,
        flat,
        read.weight,
        read.payloads[0].vectors,
    )
    file.write_bytes(np.concatenate([c.ravel() for c in columns]).astype("<f4").tobytes())


@needs_node
def test_the_modules_that_keep_maps(owner: Somebody, maps: Maps, tmp_path: Path) -> None:
    parts, first, second = tmp_path / "parts", *maps
    parts.mkdir()
    data = owner.services.settings.data_folder
    map_id, other = plant_floor_map(data, first), plant_floor_map(data, second)
    states = {"first": state_of(owner, map_id, parts), "other": state_of(owner, other, parts)}
    plant_floor_map(data, second, map_id)
    states["second"] = state_of(owner, map_id, parts)
    told = {**states, "key": owner.get("/api/key").json(), "map": map_id, "otherMap": other}
    (tmp_path / "states.json").write_text(json.dumps(told))
    wanted(first, tmp_path / "first.f32")
    wanted(second, tmp_path / "second.f32")
    passed_in_node(HERE / "keeping.test.mjs", ELFSLAM_PACKAGES=tmp_path)
