"""Tracking in the page: what a footstep costs, and how well it follows beside Python.

    python -m studies.benchmarks.page_tracking cost [--rounds N]
    python -m studies.benchmarks.page_tracking \\
        accuracy [--worlds NAME...] [--seeds N...] [--keep FOLDER]

`cost` prints milliseconds of processor time per footstep, the fastest of some rounds, in node and
in headless Chromium (where that is missing, in node alone): motion (live footsteps, asked for ten
times a second at 60 readings a second) and the tracker at 4,000 and 24,000 spots.

`accuracy` maps a walk, lets another person walk there with a browser's sensors, and locates that
walk by tracking from the same features: by Python with the footsteps of the whole walk, and by the
page's tracker with its live footsteps. Median errors (m) and shares of OK fixes are over the
tracker's seeds. With --keep what was simulated is kept and read again.
"""

from __future__ import annotations

import argparse
import functools
import http.server
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.choices import Mode
from elfslam.base.values import Features, Fixes, FixStatus, FloorMap, Imu, Payload, Truth
from elfslam.line.feature import extract_features, load_encoder
from elfslam.line.locate import elf_payload, likeness, means_between
from elfslam.line.motion import MotionParameters, dead_reckon
from elfslam.line.track import TrackParameters
from elfslam.scoring.alignment import Alignment, match, placement
from elfslam.scoring.errors import fix_distances
from elfslam.slam.front_end import hear
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import footstep_likeness, locate_walk
from elfslam.world.device import BROWSER
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from studies.located import STRANGER, mapped_walk

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_suffix(".mjs")
CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or ""
SPOTS = (4_000, 24_000)
STEPS = 40
WORLDS, SEEDS = ("studio", "lounge", "concourse"), (100, 101)
TRACKER_SEEDS = tuple(range(5))
MAPPING_ROUNDS, ROUNDS = {"concourse": 2}, {"concourse": 1}
KNOWN = Parameters()


def in_node(verb: str, given: dict[str, Any]) -> Any:
    """What a verb of page_tracking.mjs says."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "given.json"
        file.write_text(json.dumps(given))
        done = subprocess.run(
            ["node", str(SCRIPT), verb, str(file)], check=True, stdout=subprocess.PIPE
        )
    return json.loads(done.stdout)


def readings(imu: Imu) -> dict[str, list[float]]:
    """Motion as the page holds it."""
    rows = {"tS": imu.t_s, "accelMps2": imu.accel_mps2, "gyroRadps": imu.gyro_radps}
    return {name: values.ravel().tolist() for name, values in rows.items()}


def costs(rounds: int) -> dict[str, dict[str, float]]:
    """Milliseconds per footstep, by runtime and part."""
    recording, _ = simulate(load_world("studio"), 100, rounds=3, sound=False, grade=BROWSER)
    assert recording.imu is not None
    given = {
        "imu": readings(recording.imu),
        "motion": asdict(MotionParameters()),
        "track": asdict(TrackParameters()),
        "spots": SPOTS,
        "steps": STEPS,
        "rounds": rounds,
    }
    told = {"node": in_node("costs", given)}
    if CHROMIUM:
        told["Chromium"] = in_chromium(given)
    return told


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """The files of a folder on plain HTTP; gives the address."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format: str, *arguments: object) -> None:
            """Say nothing."""

    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def in_chromium(given: dict[str, Any]) -> dict[str, float]:
    """The same in a page: time of its thread on the processor, as the browser itself counts it."""
    from playwright.sync_api import sync_playwright

    with serving(ROOT) as address, sync_playwright() as play:
        options = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = play.chromium.launch(executable_path=CHROMIUM, args=options)
        page = browser.new_page()
        page.goto(f"{address}/src/elfslam/serve/pages/style.css")
        page.evaluate(
            "async ([address, given]) => {"
            " Object.assign(window, await import(address), { given });"
            " window.count = liveSteps({ imu: given.imu, parameters: given.motion }).length; }",
            [f"{address}/{SCRIPT.relative_to(ROOT)}", given],
        )
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})

        def spent_ms(script: str, before_each: str = "() => {}") -> float:
            def so_far() -> float:
                metrics = session.send("Performance.getMetrics")["metrics"]
                return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))

            spent = []
            for _ in range(int(given["rounds"])):
                page.evaluate(before_each)
                before = so_far()
                page.evaluate(script)
                spent.append(so_far() - before)
            return 1000 * min(spent)

        count = page.evaluate("window.count")
        motion = "() => { liveSteps({ imu: given.imu, parameters: given.motion }); }"
        told = {"motion": spent_ms(motion) / count}
        for spots in SPOTS:
            page.evaluate(
                "(spots) => { window.setOff = walkerOn("
                "{ spots, parameters: given.track, steps: given.steps }); setOff()(); }",
                spots,
            )
            walked_ms = spent_ms("() => { work(); }", "() => { window.work = setOff(); }")
            told[str(spots)] = walked_ms / STEPS
        browser.close()
    return told


def walks_of(world: str, seed: int) -> dict[str, Any]:
    """A map, and another person's walk with a browser's sensors: motion, features and truth."""
    encoder = load_encoder("compact")
    mapped = mapped_walk(load_world(world), seed, MAPPING_ROUNDS.get(world, 4), encoder)
    floor_map, trajectory = mapped.run.floor_map, mapped.run.trajectory
    assert floor_map is not None
    recording, truth = simulate(
        load_world(world), seed + STRANGER, rounds=ROUNDS.get(world, 3), grade=BROWSER
    )
    assert recording.imu is not None
    echoes = hear(recording, KNOWN)
    features = extract_features(echoes, encoder)
    matched = match(trajectory.t_s, trajectory.world_from_body, mapped.truth)
    payload = elf_payload(floor_map, features.encoder, features.vectors.shape[1])
    return {
        "xy_m": floor_map.xy_m,
        "heading_rad": floor_map.heading_rad,
        "covariance_m2": floor_map.covariance_m2,
        "spots": payload.vectors,
        "world_from_map": placement(matched, Alignment.ALIGNED).world_from_map,
        "t_s": recording.imu.t_s,
        "accel_mps2": recording.imu.accel_mps2,
        "gyro_radps": recording.imu.gyro_radps,
        "echo_t_s": features.t_s,
        "vectors": features.vectors,
        "truth_t_s": truth.t_s,
        "truth": truth.world_from_body,
    }


def kept_walks(world: str, seed: int, keep: Path | None) -> dict[str, Any]:
    """The same, read where it is kept."""
    file = None if keep is None else keep / f"{world}_{seed}.npz"
    if file is not None and file.is_file():
        return dict(np.load(file, allow_pickle=False))
    made = walks_of(world, seed)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(file, **made)
    return made


def page_fixes(walks: dict[str, Any], imu: Imu, features: Features) -> tuple[Any, list[Fixes]]:
    """Live steps, and the fixes of the page's tracker by seed."""
    steps = in_node("steps", {"imu": readings(imu), "parameters": asdict(KNOWN.motion)})
    edges_s = [[step["fromS"], step["tS"]] for step in steps]
    fewest = KNOWN.locate.fewest_echoes
    means = np.vstack([means_between(features, np.array(edge), fewest) for edge in edges_s])
    scores = likeness(means, Payload("elf", "page", walks["spots"]))
    rows = [None if np.isnan(row[0]) else row.astype(float).tolist() for row in scores]
    covariance = walks["covariance_m2"].reshape(-1, 4)[:, [0, 1, 3]]
    told = in_node(
        "fixes",
        {
            "map": {
                "xyM": walks["xy_m"].ravel().tolist(),
                "headingRad": walks["heading_rad"].tolist(),
                "covarianceM2": covariance.ravel().tolist(),
            },
            "steps": steps,
            "scores": rows,
            "parameters": asdict(KNOWN.track),
            "seeds": TRACKER_SEEDS,
        },
    )
    t_s = np.array([step["tS"] for step in steps])
    return steps, [fixes_from(t_s, each) for each in told]


def fixes_from(t_s: F64, told: list[dict[str, Any]]) -> Fixes:
    """The page's fixes as a value of the line."""
    nowhere = [None, None, None]
    xx, xy, yy = np.array([each["covarianceM2"] or nowhere for each in told], float).T
    return Fixes(
        t_s,
        np.array([each["xyM"] or [None, None] for each in told], float),
        np.array([each["headingRad"] for each in told], float),
        np.stack([np.stack([xx, xy], 1), np.stack([xy, yy], 1)], 1),
        np.array([each["score"] for each in told], float),
        np.array([FixStatus[each["status"]] for each in told], int),
    )


def compared(world: str, seed: int, keep: Path | None) -> dict[str, Any]:
    """Median errors and shares of OK fixes of both, over the tracker's seeds."""
    walks = kept_walks(world, seed, keep)
    imu = Imu(walks["t_s"], walks["accel_mps2"], walks["gyro_radps"])
    features = Features(walks["echo_t_s"], walks["vectors"], "page")
    truth = Truth(walks["truth_t_s"], walks["truth"])
    nodes = dead_reckon(imu, KNOWN.motion)
    floor_map = map_from(walks)
    scores = footstep_likeness(features, nodes, floor_map, KNOWN.locate)
    by_python = [
        locate_walk(nodes, scores, floor_map, KNOWN, mode=Mode.TRACK, seed=k) for k in TRACKER_SEEDS
    ]
    steps, by_page = page_fixes(walks, imu, features)
    late_s = [step["takenS"] - step["tS"] for step in steps]
    return {
        "spots": len(floor_map.xy_m),
        "footsteps": len(nodes.t_s),
        "live footsteps": len(steps) + 1,
        "late_s": float(np.median(late_s)),
        "python": errors_of(by_python, truth, walks["world_from_map"]),
        "page": errors_of(by_page, truth, walks["world_from_map"]),
    }


def map_from(walks: dict[str, Any]) -> FloorMap:
    """The floor map that was kept."""
    count = len(walks["xy_m"])
    payload = Payload("elf", "page", walks["spots"])
    order = np.arange(count)
    xy_m, heading_rad, covariance_m2 = (
        walks[name] for name in ("xy_m", "heading_rad", "covariance_m2")
    )
    one_walk = np.zeros(count, dtype=np.int64)
    return FloorMap(xy_m, heading_rad, one_walk, order, covariance_m2, (payload,), "", ("walk",))


def errors_of(told: list[Fixes], truth: Truth, world_from_map: F64) -> dict[str, float]:
    """Of all seeds together: median and third quartile of the OK fixes (m), and their share."""
    pairs = [fix_distances(fixes, truth, world_from_map) for fixes in told]
    status, errors = (np.concatenate(column) for column in zip(*pairs, strict=True))
    right = errors[status == FixStatus.OK]
    return {
        "median_m": float(np.median(right)),
        "q3_m": float(np.quantile(right, 0.75)),
        "ok": float(np.mean(status == FixStatus.OK)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("verb", choices=["cost", "accuracy"])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--keep", type=Path, default=None)
    given = parser.parse_args()
    if shutil.which("node") is None:
        sys.exit("install first: nodejs")
    if given.verb == "cost":
        for where, told in costs(given.rounds).items():
            print(f"{where}: " + ", ".join(f"{name} {ms:.2f} ms" for name, ms in told.items()))
        return
    for world in given.worlds:
        for seed in given.seeds:
            print(world, seed, json.dumps(rounded(compared(world, seed, given.keep))), flush=True)


def rounded(told: Any) -> Any:
    """Numbers to three places."""
    if isinstance(told, dict):
        return {name: rounded(value) for name, value in told.items()}
    return round(told, 3) if isinstance(told, float) else told


if __name__ == "__main__":
    main()
