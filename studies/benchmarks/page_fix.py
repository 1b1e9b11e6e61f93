"""What a fix costs in the page, and a footstep of tracking; and what the browser fetches for it.

    python -m studies.benchmarks.page_fix [--spots N] [--rate HZ]

A real server and a headless Chromium. The modules of the page locate a simulated walk in a map of
`--spots` spots (what a walk's own map lacks is filled with unlike ones), 0.6 s of sound at a time,
in a worker as on the phone; then they follow a walk with the motion of a browser, footstep by
footstep, by the particle filter. Last comes what a first visit weighs. Wall clock: run it on a
quiet machine. Needs chromium and the `test` extra.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from playwright.sync_api import Browser, Route, sync_playwright

from elfslam.base.arrays import F32, F64
from elfslam.base.parameters import as_dict
from elfslam.base.values import FloorMap, Payload
from elfslam.serve.people.guards import CONTENT_POLICY
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import OnnxEncoder, load_encoder
from elfslam.world.device import BROWSER
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.served import serving
from studies.live_footsteps import readings

STAGES = ("echoes", "encoder", "likeness", "fix", "together")
INSIDE = ("to 44.1 kHz", "envelope")
PASSES = ((1, 1), (11, 1), (1, 5))
"""Over the walk, with its sound in windows and as it comes: few, many, and many as it comes."""
TRACKED_SPOTS, TRACKED_STEPS, TRACKED_ROUNDS = (4_000, 24_000), 40, 7
SPOT_BYTES = 4 * (2 + 1 + 3 + 1 + 128)
HERE = Path(__file__).parent / "page_stages"
CHROMIUM = shutil.which("chromium")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
PATIENCE_MS = 600_000
TYPES = {".html": "text/html", ".js": "text/javascript"}


def prepare(folder: Path, spots: int, rate_hz: int) -> float:
    """A map, a walk and the encoder, as files; gives how long the walk is (s)."""
    parameters, encoder = Parameters(), load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    world = load_world("studio")
    mapped, _ = simulate(world, 100, rounds=1)
    run = map_by_echoes(mapped, encoder, parameters)
    assert run.floor_map is not None
    write_floor_map(folder / "map", filled(run.floor_map, spots), parameters)
    walked, _ = simulate(world, 101, rounds=1, rate_hz=rate_hz)
    assert walked.audio is not None
    write_f32(folder / "sound.f32", walked.audio.samples[0])
    (folder / "encoder.onnx").write_bytes(encoder.content)
    return float(walked.audio.samples.shape[1] / rate_hz)


def filled(floor_map: FloorMap, spots: int) -> FloorMap:
    """The map with so many spots: those it lacks lie elsewhere and sound like nothing known."""
    generator = np.random.default_rng(0)
    count = spots - len(floor_map.xy_m)
    elf, *others = floor_map.payloads
    unlike = generator.standard_normal((count, elf.vectors.shape[1]))
    unlike /= np.linalg.norm(unlike, axis=1, keepdims=True)
    phones = [Payload(o.kind, o.encoder, np.repeat(o.vectors[:1], spots, axis=0)) for o in others]
    return FloorMap(
        xy_m=np.vstack([floor_map.xy_m, generator.uniform(20.0, 60.0, (count, 2))]),
        heading_rad=np.append(floor_map.heading_rad, generator.uniform(-3.0, 3.0, count)),
        walk=np.zeros(spots, dtype=np.int64),
        order=np.arange(spots),
        covariance_m2=np.vstack(
            [floor_map.covariance_m2, np.tile(0.01 * np.eye(2), (count, 1, 1))]
        ),
        payloads=(Payload(elf.kind, elf.encoder, np.vstack([elf.vectors, unlike])), *phones),
        parameters_digest="",
        sources=floor_map.sources,
    )


def print_times(said: dict[str, Any]) -> None:
    """Milliseconds by stage."""
    ms = np.array([window["ms"] for window in said["windows"]])
    print(f"\n0.6 s of sound pushed at once, {len(ms)} windows   median    p95   fastest")
    for name, column in zip(STAGES, ms.T, strict=True):
        print_row(name, column)
    for name, column in zip(INSIDE, np.array(said["inside"]).T, strict=True):
        print_row(f"  of echoes: {name}", column)
    print_row("behind the last block, live", np.array(said["live"]))
    first = dict(zip(STAGES, (f"{ms:.1f}" for ms in said["first"]["ms"]), strict=True))
    print(f"the very first fix: {first} ms")
    statuses = [window["status"] for window in said["windows"]]
    print({status: statuses.count(status) for status in sorted(set(statuses))})


def print_row(name: str, ms: np.ndarray) -> None:
    """One stage."""
    print(f"{name:40} {np.median(ms):7.1f} {np.percentile(ms, 95):6.1f} {ms.min():7.1f}  ms")


def print_footsteps(browser: Browser, address: str, folder: Path) -> None:
    """Milliseconds of a footstep: of motion, asked for ten times a second, and of the tracker."""
    walked, _ = simulate(load_world("studio"), 100, rounds=3, sound=False, grade=BROWSER)
    assert walked.imu is not None
    parameters = Parameters()
    told = {
        "imu": readings(walked.imu),
        "motion": asdict(parameters.motion),
        "track": asdict(parameters.track),
        "spots": TRACKED_SPOTS,
        "steps": TRACKED_STEPS,
        "rounds": TRACKED_ROUNDS,
    }
    (folder / "walk.json").write_text(json.dumps(told))
    said, _ = run_in_page(browser, address, "track", folder)
    print(
        "\nfastest of a footstep: " + ", ".join(f"{name} {ms:.2f} ms" for name, ms in said.items())
    )


def print_weight(address: str, folder: Path, spots: int) -> None:
    """What the first visit weighs, raw and as sent."""
    url = address.split("#", maxsplit=1)[0].rstrip("/")
    files = httpx.get(f"{url}/precache.json").raise_for_status().json()["files"]
    print(f"\n{'bytes on the first visit':32}{'raw':>12}{'sent':>12}")
    runtime = [file for file in files if "onnxruntime" in file["path"]]
    rest = [file for file in files if file not in runtime]
    for name, some in (("runtime", runtime), ("page", rest), ("together", files)):
        raw, sent = (sum(f[key] for f in some) for key in ("size_bytes", "sent_bytes"))
        print(f"{name:32}{raw:12,}{sent:12,}  {len(some)} files")
    encoder = (folder / "encoder.onnx").stat().st_size
    print(f"model {encoder:,} and map {spots * SPOT_BYTES:,}: {encoder + spots * SPOT_BYTES:,}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--spots", type=int, default=4000)
    parser.add_argument("--rate", type=int, default=48_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "given"
        walk_s = prepare(folder, given.spots, given.rate)
        with serving(Path(name) / "data", "--no-jobs") as address, browsing() as browser:
            runs = [measured(browser, address, folder, given.rate, *passes) for passes in PASSES]
            print_times(runs[0][0])
            print_processor([spent_s for _, spent_s in runs], len(runs[0][0]["windows"]), walk_s)
            opened = " and ".join(f"{said['runtimeMs']:.0f}" for said, _ in runs[:2])
            print(f"runtime and encoder opened in {opened} ms")
            print_footsteps(browser, address, folder)
            print_weight(address, folder, given.spots)


def measured(
    browser: Browser, address: str, folder: Path, rate_hz: int, passes: int, live_passes: int
) -> tuple[dict[str, Any], float]:
    """What the worker says of so many passes over the walk, and the processor seconds."""
    window_s = Parameters().locate.window_s
    told = {"rateHz": rate_hz, "windowS": window_s, "passes": passes, "livePasses": live_passes}
    (folder / "sound.json").write_text(json.dumps(told))
    return run_in_page(browser, address, "fix", folder)


def print_processor(spent_s: Sequence[float], windows: int, walk_s: float) -> None:
    """What more passes cost beyond few: by the clock of the processor, whatever else runs."""
    few, many, live = spent_s
    fixes = windows // PASSES[0][0] * (PASSES[1][0] - PASSES[0][0])
    print(f"processor: {1000 * (many - few) / fixes:.1f} ms for a fix from sound pushed at once")
    lived_s = walk_s * (PASSES[2][1] - PASSES[0][1])
    print(f"processor: {(live - few) / lived_s:.1%} of a core while each echo makes a fix")


# --- a worker of the page ---


@contextmanager
def browsing() -> Iterator[Browser]:
    """Chromium without a window."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        yield browser
        browser.close()


def run_in_page(browser: Browser, address: str, worker: str, given: Path) -> tuple[Any, float]:
    """What a worker of `page_stages/` says with the files of the folder `given`.

    And the processor seconds that the page took.
    """
    context = browser.new_context()
    context.route("**/benchmarks/**", lambda route: _answer(route, given))
    page, before_s = context.new_page(), processor_s(browser)
    page.goto(f"{address.split('#', maxsplit=1)[0].rstrip('/')}/benchmarks/page.html#{worker}")
    page.wait_for_selector("#result:not(:empty)", timeout=PATIENCE_MS)
    said, spent_s = json.loads(page.inner_text("#result")), processor_s(browser) - before_s
    context.close()
    if "failed" in said:
        raise RuntimeError(said["failed"])
    return said, spent_s


def processor_s(browser: Browser) -> float:
    """Processor seconds of all pages so far."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return float(sum(each["cpuTime"] for each in processes if each["type"] == "renderer"))


def _answer(route: Route, given: Path) -> None:
    path = route.request.url.partition("/benchmarks/")[2].partition("#")[0]
    inside = path.removeprefix("data/")
    file = given / inside if inside != path else HERE / path
    kind = TYPES.get(file.suffix, "application/octet-stream")
    headers = {"Content-Type": kind, "Content-Security-Policy": CONTENT_POLICY}
    route.fulfill(body=file.read_bytes(), headers=headers)


def write_floor_map(folder: Path, floor_map: FloorMap, parameters: Parameters) -> None:
    """A map as `given.js` reads it."""
    folder.mkdir(parents=True, exist_ok=True)
    elf = next(item for item in floor_map.payloads if item.kind == "elf")
    told = {"encoder": elf.encoder, "parameters": as_dict(parameters)}
    (folder / "map.json").write_text(json.dumps(told))
    write_f32(folder / "xy.f32", floor_map.xy_m)
    write_f32(folder / "heading.f32", floor_map.heading_rad)
    covariance = floor_map.covariance_m2[:, [0, 0, 1], [0, 1, 1]]
    write_f32(folder / "covariance.f32", covariance)
    write_f32(folder / "vectors.f32", elf.vectors)


def write_f32(file: Path, values: F32 | F64) -> None:
    """An array as little-endian float32."""
    file.parent.mkdir(parents=True, exist_ok=True)
    np.asarray(values, "<f4").tofile(file)


if __name__ == "__main__":
    main()
