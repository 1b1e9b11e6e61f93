"""What a fix costs in the page: milliseconds by stage, and what the browser fetches for it.

    python benchmarks/page_fix.py [--spots N] [--rate HZ]

A real server and a headless Chromium. The modules of the page locate a simulated walk in a map of
`--spots` spots (what a walk's own map lacks is filled with unlike ones), 0.6 s of sound at a time,
in a worker as on the phone. Then the same browser fetches the page for the first time. Wall clock:
run it on a quiet machine. Needs chromium and the `test` extra.
"""

from __future__ import annotations

import argparse
import gzip
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from line_in_page import browsing, run_in_page, serving, write_f32, write_floor_map

from elfslam.base.values import FloorMap, Payload
from elfslam.line.feature import OnnxEncoder, calibrated, load_encoder
from elfslam.serve.settings import PAGES_FOLDER
from elfslam.slam import Parameters, map_by_echoes
from elfslam.world.simulate import load_world, simulate

STAGES = ("echoes", "encoder", "likeness", "fix", "together")
INSIDE = ("to 44.1 kHz", "envelope")
SPOT_BYTES = 4 * (2 + 1 + 3 + 1 + 128)
UNSEEN = ("desk", "LICENSE", "LICENSES", "ThirdParty")
"""Files that the phone does not ask for."""


@dataclass(frozen=True)
class File:
    """A file of the page: its bytes, as they are sent, and as short as gzip makes them."""

    name: str
    raw: int
    sent: int
    squeezed: int


def prepare(folder: Path, spots: int, rate_hz: int) -> None:
    """A map, a walk and the encoder, as files."""
    parameters, encoder = Parameters(), load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    world = load_world("studio")
    mapped, _ = simulate(world, 100, rounds=1)
    run = map_by_echoes(mapped, encoder, parameters, adapt=calibrated)
    assert run.floor_map is not None
    write_floor_map(folder / "map", filled(run.floor_map, spots), parameters)
    walked, _ = simulate(world, 101, rounds=1, rate_hz=rate_hz)
    assert walked.audio is not None
    write_f32(folder / "sound.f32", walked.audio.samples[0])
    (folder / "encoder.onnx").write_bytes(encoder.content)
    told = {"rateHz": rate_hz, "windowS": parameters.locate.window_s}
    (folder / "sound.json").write_text(json.dumps(told))


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
    print_row("behind the last block, live", np.array(said["live"]["afterLastMs"]))
    print(f"the very first fix: {said['first']['ms'][-1]:.1f} ms")
    print(f"share of one core while every echo makes a fix: {said['live']['busyShare']:.1%}")
    print(f"runtime and encoder opened in {said['runtimeMs']:.0f} ms")
    statuses = [window["status"] for window in said["windows"]]
    print({status: statuses.count(status) for status in sorted(set(statuses))})


def print_row(name: str, ms: np.ndarray) -> None:
    """One stage."""
    print(f"{name:40} {np.median(ms):7.1f} {np.percentile(ms, 95):6.1f} {ms.min():7.1f}  ms")


def page_files(address: str) -> list[File]:
    """Everything that the phone may fetch of the page, asked for as a browser does."""
    files = []
    for path in sorted(path for path in PAGES_FOLDER.rglob("*") if path.is_file()):
        name = path.relative_to(PAGES_FOLDER).as_posix()
        if any(part.startswith(UNSEEN) for part in Path(name).parts) or name == "package.json":
            continue
        content = path.read_bytes()
        files.append(
            File(name, len(content), sent_bytes(address, name), len(gzip.compress(content)))
        )
    return files


def sent_bytes(address: str, name: str) -> int:
    """How long the body is that the server sends."""
    url = f"{address.split('#', maxsplit=1)[0].rstrip('/')}/{name}"
    with httpx.stream("GET", url, headers={"Accept-Encoding": "gzip, br"}) as answer:
        answer.raise_for_status()
        return sum(len(part) for part in answer.iter_raw())


def print_weight(files: Sequence[File], folder: Path, spots: int) -> None:
    """What the first visit weighs."""
    print("\nbytes on the first visit                  raw      sent   gzip -9")
    runtime = [file for file in files if "onnxruntime" in file.name]
    rest = [file for file in files if file not in runtime]
    for name, some in (("runtime", runtime), ("page", rest), ("together", files)):
        sums = [sum(getattr(file, what) for file in some) for what in ("raw", "sent", "squeezed")]
        print(f"{name:32}" + "".join(f"{size:12,}" for size in sums))
    encoder = (folder / "encoder.onnx").stat().st_size
    print(f"model {encoder:,} and map {spots * SPOT_BYTES:,}: {encoder + spots * SPOT_BYTES:,}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--spots", type=int, default=4000)
    parser.add_argument("--rate", type=int, default=48_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder / "given", given.spots, given.rate)
        with serving(folder / "data") as address, browsing() as browser:
            said = run_in_page(browser.new_context(), address, "fix", folder / "given")
            print_times(said)
            print_weight(page_files(address), folder / "given", given.spots)


if __name__ == "__main__":
    main()
