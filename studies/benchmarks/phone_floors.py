"""What a building of several floors costs a slow phone that finds its floor by echoes.

Usage, from the root of the project:

    python -m studies.benchmarks.phone_floors [--floors 4] [--spots 7000]

Floors are planted: spots of a walk of ten minutes through a mall's floor, each with a random
feature. A real server packs them, Chromium, its processor slowed fourfold, gets them, and the
page's own modules are timed in it, in medians. What the worker of the view "Where am I" holds is
read from the browser while that view locates; the encoder's WebAssembly counts beside it.
"""

import argparse
import json
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from elfslam.app.console import print_rows
from elfslam.base.values import ELF_SIZE, FloorMap, Payload
from elfslam.data.map_files import ENCODER, MAP, write_map
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store import blobs
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import Map, MapFile, User
from elfslam.stages.feature import SHIPPED_ENCODER, load_encoder
from studies.benchmarks.browser_walk import ARGUMENTS, CHROMIUM, PERMISSIONS
from studies.benchmarks.served import serving
from studies.benchmarks.slow_phone import SLOWER

FLOOR_M = (60.0, 35.0)
STEP_M = 0.7
PATIENCE_MS = 300_000
MB = 1e6
MICROPHONE = "--use-fake-device-for-media-stream"
TIMED = """async (ids) => {
  const load = (name) => import(new URL(name, location.origin).href);
  const { openPackages } = await load("keeping/packages.js");
  const { openStore } = await load("keeping/store.js");
  const { makeFloors } = await load("stages/floor_location.js");
  const { fixOf, similarity } = await load("stages/locate.js");
  const { makeTracker } = await load("stages/track.js");
  const { makeRandom } = await load("stages/particles.js");
  const { openEncoder } = await load("stages/encoder.js");
  const { ECHO_SAMPLES, ELF_SIZE } = await load("stages/constants.js");
  const packages = openPackages(await openStore());
  const times = {};
  const timed = async (name, work) => {
    const began = performance.now();
    const made = await work();
    (times[name] ??= []).push(performance.now() - began);
    return made;
  };
  const opened = [];
  for (const id of ids) opened.push(await timed("open a floor", () => packages.open(id)));
  const [first, ...others] = opened.map(({ floorMap, facts: { level } }) => ({ floorMap, level }));
  const { locate, track } = first.floorMap.parameters;
  const floors = makeFloors(first);
  floors.join(others);
  const { floorMap: there, level: truth } = others[others.length - 1];
  const random = makeRandom(0);
  const spots = there.headingRad.length;
  let tracker;
  const make = () => makeTracker(there, track, random);
  for (let k = 0; k < 5; k += 1) tracker = await timed("make a tracker", make);
  let found = null;
  for (let k = 0; k < 80; k += 1) {
    const at = (40 + k) % spots;
    const own = there.vectors.slice(ELF_SIZE * at, ELF_SIZE * (at + 1));
    const mean = own.map((value) => value + 0.02 * random.normal());
    const scores = await timed("similarity, one floor", () => similarity(mean, there));
    found = (await timed("vote, all floors", () => floors.hear(0.6 * k, mean))).level;
    await timed("fix, echoes alone", () => fixOf(scores, there, locate));
    await timed("fix, steps and echoes", () => tracker.step([0.7, 0, 0], [0.1, 0.1, 0.05], scores));
  }
  if (found !== truth) throw new Error(`the vote is for ${found}, the walker is on ${truth}`);
  const encoder = await openEncoder(opened[0].encoderBytes, {});
  const echoes = new Float32Array(6 * ECHO_SAMPLES).fill(0.01);
  const embed = () => encoder.embed(echoes, 6);
  for (let k = 0; k < 20; k += 1) await timed("encoder, six echoes", embed);
  return { times, sizes: (await packages.list()).map(({ sizeBytes }) => sizeBytes) };
}"""
PLACE_WORKER = "place.worker.js"
HEAP = ("HeapProfiler.collectGarbage", "Runtime.getHeapUsage")
Row = dict[str, object]


def main() -> None:
    """Plant a building, get it, and time what its floors cost."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--floors", type=int, default=4)
    parser.add_argument("--spots", type=int, default=7000)
    asked = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder) / "data", "--no-jobs") as address,
        sync_playwright() as play,
    ):
        ids = plant_building(Path(folder) / "data", asked.floors, asked.spots)
        browser = play.chromium.launch(executable_path=CHROMIUM, args=[*ARGUMENTS, MICROPHONE])
        page = browser.new_page(
            viewport={"width": 390, "height": 844}, permissions=list(PERMISSIONS)
        )
        page.set_default_timeout(PATIENCE_MS)
        get_building(page, address, ids)
        memory = held(page, ids[0], asked.floors * asked.spots * ELF_SIZE * 4)
        session = page.context.new_cdp_session(page)
        session.send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
        told = page.evaluate(TIMED, ids)
        browser.close()
    encoder_mb = SHIPPED_ENCODER.stat().st_size / MB
    floor_mb = sum(told["sizes"]) / MB / asked.floors - encoder_mb
    rows: list[Row] = [
        row_of("package of a floor", floor_mb, "MB"),
        row_of("package of all, one encoder", asked.floors * floor_mb + encoder_mb, "MB"),
        *memory,
        *(row_of(name, median(times), "ms") for name, times in told["times"].items()),
    ]
    title = f"{asked.floors} floors of {asked.spots} spots, a processor {SLOWER} times slower"
    print_rows(rows, title=title, as_json=False)


def row_of(what: str, value: float, unit: str) -> Row:
    """A line of what is printed."""
    return {"what": what, "value": f"{value:.1f}", "unit": unit}


def plant_building(data: Path, floors: int, spots: int) -> list[str]:
    """The maps of a building's floors, as a job would have left them; their ids by level."""
    services, generator = open_services(ServerSettings(data)), np.random.default_rng(0)
    ids: list[str] = []
    store = services.settings.blobs_folder
    for level in range(floors):
        with tempfile.TemporaryDirectory() as folder:
            write_map(planted_floor(generator, spots), Path(folder) / MAP)
            (Path(folder) / ENCODER).write_bytes(SHIPPED_ENCODER.read_bytes())
            with blobs.locked(store), transaction(services.sessions) as session:
                owner = session.query(User).filter_by(is_owner=True).one()
                row = Map(user_id=owner.id, name=f"Floor {level}", kind="run", floor=str(level))
                session.add(row)
                session.flush()
                row.facts = {"level": level, "frame": ids[0] if ids else row.id, "passages": []}
                for name, blob in blobs.put_folder(store, Path(folder)).items():
                    about = {"sha256": blob.sha256, "size_bytes": blob.size_bytes}
                    session.add(MapFile(map_id=row.id, name=name, **about))
                ids.append(row.id)
    services.engine.dispose()
    return ids


def planted_floor(generator: np.random.Generator, spots: int) -> FloorMap:
    """Spots of lanes up and down a floor, each with a feature of its own."""
    along = STEP_M * np.arange(spots)
    lane, there = np.divmod(along, FLOOR_M[0])
    x_m = np.where(lane % 2 == 0, there, FLOOR_M[0] - there)
    xy_m = np.column_stack([x_m, (STEP_M * lane) % FLOOR_M[1]])
    vectors = generator.normal(0, ELF_SIZE**-0.5, (spots, ELF_SIZE)).astype(np.float32)
    return FloorMap(
        xy_m=xy_m,
        heading_rad=np.where(lane % 2 == 0, 0.0, np.pi),
        walk=np.zeros(spots, dtype=np.int64),
        order=np.arange(spots),
        covariance_m2=np.tile(0.01 * np.eye(2), (spots, 1, 1)),
        payloads=(Payload("elf", load_encoder("compact").identity, vectors),),
        parameters_digest="",
        sources=("walk",),
    )


def get_building(page: Page, address: str, ids: list[str]) -> None:
    """Pair and take the floors onto the phone, with the first."""
    page.goto(address)
    page.click("#where")
    page.click(f"[data-map='{ids[0]}'] >> text=Get this map")
    for each in ids:
        page.wait_for_selector(f"[data-map='{each}'] >> text=Find me here")


def held(page: Page, map_id: str, least_bytes: int) -> list[Row]:
    """What page and worker hold while the view locates, once the worker has all floors."""
    session = page.context.new_cdp_session(page)
    sessions: dict[str, str] = {}
    answers: list[dict[str, Any]] = []
    session.on(
        "Target.attachedToTarget",
        lambda told: sessions.update({told["targetInfo"]["url"]: told["sessionId"]}),
    )
    session.on(
        "Target.receivedMessageFromTarget", lambda told: answers.append(json.loads(told["message"]))
    )
    attach = {"autoAttach": True, "waitForDebuggerOnStart": False, "flatten": False}
    session.send("Target.setAutoAttach", attach)
    page.click(f"[data-map='{map_id}'] >> text=Find me here")
    page.wait_for_selector("#place-stop:visible")
    in_worker = 0
    while in_worker < least_bytes:
        (place,) = (its for url, its in sessions.items() if url.endswith(PLACE_WORKER))
        for number, method in enumerate(HEAP):
            message = json.dumps({"id": number, "method": method})
            to_worker = {"sessionId": place, "message": message}
            session.send("Target.sendMessageToTarget", to_worker)
        page.wait_for_timeout(1000)
        heaps = [each["result"] for each in answers if each.get("id") == len(HEAP) - 1]
        in_worker = total_bytes(heaps[-1]) if heaps else 0
    in_page = [session.send(method) for method in HEAP][-1]
    page.click("#place-stop")
    return [
        row_of("memory of the worker that locates", in_worker / MB, "MB"),
        row_of("memory of the page meanwhile", total_bytes(in_page) / MB, "MB"),
    ]


def total_bytes(heap: dict[str, float]) -> int:
    """Objects of JavaScript, and the arrays beside them."""
    return int(heap["usedSize"] + heap["backingStorageSize"])


if __name__ == "__main__":
    main()
