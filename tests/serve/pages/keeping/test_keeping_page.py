"""The kept page and kept maps in Chromium: without the server, after a restart, tampered with."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from elfslam.base.values import FloorMap
from elfslam.serve.network.authority import fingerprint, signing_key
from elfslam.serve.settings import PAGES_FOLDER
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
    start_server: Start, plant: Callable[[Path], Any], maps: tuple[FloorMap, FloorMap], browser: Any
) -> None:
    server = start_server()
    map_id = plant(server.data).put(maps[0])
    with browser.opened() as page:
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
    with browser.opened() as page:  # a browser that was closed meanwhile
        page.goto(server.url)
        assert page.is_visible("#allow")
        assert page.inner_text("h1") == "Walk, and get a map"
        colour = page.evaluate("getComputedStyle(document.querySelector('#allow')).cursor")
        assert colour == "pointer"
        assert page.evaluate(OPEN, map_id) == known
        assert page.evaluate(WALKS) == []


def test_only_changes_are_fetched_forgeries_refused_and_signing_out_forgets_all(
    start_server: Start, plant: Callable[[Path], Any], maps: tuple[FloorMap, FloorMap], browser: Any
) -> None:
    server = start_server()
    planted = plant(server.data)
    map_id = planted.put(maps[0])
    with browser.opened() as page:
        visit(page, pairing(server))
        page.evaluate(UPDATE, map_id)
        first = page.evaluate(OPEN, map_id)
        with httpx.Client(base_url=server.url, headers=server.bearer) as client:
            older = client.get(f"/api/maps/{map_id}/package").json()
            planted.put(maps[1], map_id)
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
    start_server: Start, browser: Any, tmp_path: Path
) -> None:
    pages = tmp_path / "pages"
    shutil.copytree(PAGES_FOLDER, pages)
    server = start_server(pages=pages)
    with browser.opened() as page:
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
    with browser.opened() as page:  # the next visit
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
