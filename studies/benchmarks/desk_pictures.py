"""Pictures of the desk page, made with a real server, real jobs and a real browser.

Usage, from the root of the project:

    python -m studies.benchmarks.desk_pictures docs/desk

Three walks and a visitor are simulated in the studio, uploaded, mapped, merged and located; a floor
plan is drawn from the world and laid under the map. Takes some minutes.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
import tomllib
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from PIL import Image, ImageDraw
from playwright.sync_api import Browser, Page, sync_playwright

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose
from elfslam.base.values import Truth
from elfslam.data.recordings import write_recording
from elfslam.world import worlds
from elfslam.world.simulate import describe_chirp, load_world, simulate
from studies.benchmarks.served import PIECE, metadata, owner_of, serving

WORLD = "studio"
WALKS = {"First walk": (100, 3), "Second walk": (101, 3), "Third walk": (102, 3)}
VISITOR = ("A visitor", (200, 1))
VENUE, FLOORS = "North Mall", ("Ground floor", "Floor 1")
PLACES = {
    "Way in": ("door", 1.2, 1.0),
    "Stairs": ("stairs", 6.9, 5.6),
    "Desk": ("room", 5.4, 4.9),
}
"""By name their kind, and where they are in the world."""
ME, OTHERS = "Ada", ("Eve", "The facility team")
PIXELS_PER_M = 80
COLOURS = 256
LONGEST_S = 1200
BROWSER = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def main() -> None:
    """Write the pictures into a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    out: Path = parser.parse_args().folder
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as data, serving(Path(data)) as at:
        address = at.replace("/desk", "/")
        with owner_of(address) as client:
            floor = fill(client)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=BROWSER)
            for scheme in ("light", "dark"):
                take(browser, address, scheme, floor, out)
            browser.close()


def fill(client: httpx.Client) -> str:
    """Upload, map, merge and locate; gives the id of the floor map, its plan in place."""
    truths = {name: upload(client, name, *how) for name, how in [*WALKS.items(), VISITOR]}
    wait(client)
    lay_on_floors(client)
    maps = [each for each in client.get("/api/maps").json() if each["name"] in WALKS]
    start(client, {"kind": "merge", "maps": [each["id"] for each in maps], "name": "Studio"})
    wait(client)
    floor = next(each["id"] for each in client.get("/api/maps").json() if each["kind"] == "floor")
    recordings = client.get("/api/recordings").json()
    visitor = next(each["id"] for each in recordings if each["name"] == VISITOR[0])
    start(client, {"kind": "locate", "recording": visitor, "map": floor})
    name_places(client, floor, put_plan(client, floor, truths))
    share(client, floor)
    wait(client)
    first = next(each["id"] for each in recordings if each["name"] in WALKS)
    start(client, {"kind": "map", "recording": first, "by": ["elf"]})
    return str(floor)


def lay_on_floors(client: httpx.Client) -> None:
    """The walks on one floor of a venue, the visitor's on another."""
    for each in client.get("/api/maps").json():
        place = {"venue": VENUE, "floor": FLOORS[each["name"] not in WALKS]}
        client.patch(f"/api/maps/{each['id']}", json=place).raise_for_status()


def share(client: httpx.Client, floor: str) -> None:
    """Let two people in, one of whom may see the map; so may everyone who has its link."""
    client.patch("/api/me", json={"name": ME}).raise_for_status()
    ids = [client.post("/api/users", json={"name": name}).json()["id"] for name in OTHERS]
    may = {"may": "read"}
    client.put(f"/api/maps/{floor}/shares/{ids[0]}", json=may).raise_for_status()
    client.put(f"/api/maps/{floor}/link", json=may).raise_for_status()


def upload(client: httpx.Client, name: str, seed: int, rounds: int, world: str = WORLD) -> Truth:
    """Simulate a walk and send it as a .zip; gives its truth, which is not sent."""
    recording, truth = simulate(load_world(world), seed, rounds=rounds)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "walk"
        write_recording(replace(recording, name=name), folder, chirp_description=describe_chirp())
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for file in folder.iterdir():
                archive.write(file, f"walk/{file.name}")
    told = {"Upload-Length": str(len(packed.getvalue()))}
    told["Upload-Metadata"] = metadata(filename=f"{name}.zip")
    content = packed.getvalue()
    client.post("/api/uploads", content=content, headers={**PIECE, **told}).raise_for_status()
    return truth


def start(client: httpx.Client, job: dict[str, Any]) -> None:
    """Queue a job."""
    client.post("/api/jobs", json=job).raise_for_status()


def wait(client: httpx.Client) -> None:
    """Until every recording is read and every job has ended."""
    until_s = time.monotonic() + LONGEST_S
    while time.monotonic() < until_s:
        receiving = any(
            each["state"] == "receiving" for each in client.get("/api/recordings").json()
        )
        open_ = any(
            each["state"] in ("queued", "running") for each in client.get("/api/jobs").json()
        )
        if not (receiving or open_):
            return
        time.sleep(2)
    raise SystemExit("the jobs take too long")


def put_plan(client: httpx.Client, floor: str, truths: dict[str, Truth], world: str = WORLD) -> F64:
    """Draw the world's plan and lay it where the walks say that it lies; gives that pose."""
    plan, width_m = plan_of(world)
    address, kind = f"/api/maps/{floor}/floor-plan", {"Content-Type": "image/png"}
    client.put(address, content=plan, headers=kind).raise_for_status()
    walks = client.get(f"/api/maps/{floor}/view").json()["walks"]
    x_m, y_m, heading_rad = where(walks, truths)
    placement = {
        "width_m": width_m,
        "x_m": x_m,
        "y_m": y_m,
        "heading_rad": heading_rad,
        "opacity": 0.7,
    }
    client.put(f"{address}/placement", json=placement).raise_for_status()
    return np.array([x_m, y_m, heading_rad])


def name_places(client: httpx.Client, floor: str, map_from_world: F64) -> None:
    """Give places of the world their names on its map."""
    named = []
    for name, (kind, *where_m) in PLACES.items():
        x_m, y_m, _ = compose(map_from_world, np.array([*where_m, 0.0])).tolist()
        named.append({"name": name, "kind": kind, "x_m": x_m, "y_m": y_m})
    change = {"version": "", "points": named}
    client.put(f"/api/maps/{floor}/points-of-interest", json=change).raise_for_status()


def where(walks: list[dict[str, Any]], truths: dict[str, Truth]) -> tuple[float, float, float]:
    """The pose of the world in the map: the best rigid fit of true places to mapped ones."""
    mapped = np.vstack([walk["xy_m"] for walk in walks])
    true = np.vstack([truth_at(truth_of(truths, walk["name"]), walk["t_s"]) for walk in walks])
    middle_map, middle_true = mapped.mean(axis=0), true.mean(axis=0)
    one, other = (true - middle_true) @ [1, 1j], (mapped - middle_map) @ [1, 1j]
    heading_rad = float(np.angle(np.vdot(one, other)))
    corner = middle_map @ [1, 1j] - (middle_true @ [1, 1j]) * np.exp(1j * heading_rad)
    return float(corner.real), float(corner.imag), heading_rad


def truth_of(truths: dict[str, Truth], name: str) -> Truth:
    """That of a walk; a merge puts a mark behind its name."""
    return truths[name] if name in truths else truths[name.rpartition("-")[0]]


def truth_at(truth: Truth, t_s: list[float]) -> np.ndarray:
    """True places (n, 2) at some times."""
    columns = [np.interp(t_s, truth.t_s, truth.world_from_body[:, axis]) for axis in (0, 1)]
    return np.column_stack(columns)


def plan_of(name: str) -> tuple[bytes, float]:
    """A drawing of a world as PNG, and its width in metres."""
    told = tomllib.loads((Path(worlds.__path__[0]) / f"{name}.toml").read_text())
    width_m, depth_m = told["size_m"][:2]
    image = Image.new(
        "RGB", (round(width_m * PIXELS_PER_M), round(depth_m * PIXELS_PER_M)), "white"
    )
    draw = ImageDraw.Draw(image)
    for piece in told["furniture"]:
        (x, y, _), (w, d, _) = piece["corner_m"], piece["size_m"]
        box = [v * PIXELS_PER_M for v in (x, depth_m - y - d, x + w, depth_m - y)]
        draw.rectangle(box, fill="#eeeeee", outline="#777777", width=3)
        draw.text((box[0] + 8, box[1] + 8), piece["name"], fill="#555555", font_size=16)
    draw.rectangle([0, 0, image.width - 1, image.height - 1], outline="black", width=9)
    kept = io.BytesIO()
    image.save(kept, "PNG")
    return kept.getvalue(), float(width_m)


def take(browser: Browser, address: str, scheme: Any, floor: str, out: Path) -> None:
    """The recordings, the maps, how one is shared, and that map with its plan."""
    page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme=scheme)
    page.goto(address.replace("/#", "/desk#"))
    page.wait_for_selector("table.list")
    page.wait_for_timeout(2500)
    keep(page, out / f"recordings_{scheme}.png")
    page.evaluate("() => { location.hash = '#/maps'; }")
    page.get_by_role("heading", name=VENUE).wait_for()
    keep(page, out / f"maps_{scheme}.png")
    page.get_by_role("button", name="Share Studio").click()
    page.get_by_role("textbox", name="Address").wait_for()
    keep(page, out / f"share_{scheme}.png")
    page.get_by_role("button", name="Close").click()
    page.evaluate("id => { location.hash = `#/maps/${id}`; }", floor)
    page.get_by_role("button", name="Move the plan").wait_for()
    page.get_by_text("located", exact=True).wait_for()
    page.get_by_role("button", name="Show all").click()
    page.wait_for_timeout(1500)
    keep(page, out / f"map_{scheme}.png")
    page.close()


def keep(page: Page, file: Path) -> None:
    """A picture in few colours, so that it stays small."""
    shot = Image.open(io.BytesIO(page.screenshot()))
    shot.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
