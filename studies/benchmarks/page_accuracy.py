"""Does the page locate as Python does? The same recordings by `locate` and by the page.

    python -m studies.benchmarks.page_accuracy \\
        [--worlds studio lounge] [--seeds 100 101] [--rounds N]

In development worlds a walk is mapped and another walker is located in it, one shot: by Python,
and by the page's modules in a headless Chromium, block by block as the sound comes in. Printed are
the median errors of both after the best fit of the map's own walk, and how many fixes agree. The
phone that made the map is located, at both rates, and another one.
Needs chromium and the `test` extra.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.values import Fixes, FixStatus, Truth
from elfslam.line.feature import OnnxEncoder, load_encoder
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import locate
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.line_in_page import browsing, run_in_page, write_f32, write_floor_map
from studies.benchmarks.served import serving
from studies.located import STRANGER, Mapped, fix_numbers, mapped_walk

MAPPING_ROUNDS = 3
SAME_M = 0.001
OWN_PHONE, OTHER_PHONE = "simulated phone", "rippled"
WALKS = ((OWN_PHONE, 44_100), (OWN_PHONE, 48_000), (OTHER_PHONE, 48_000))
"""The phone that is located, and its rate."""


@dataclass(frozen=True)
class ComparedWalk:
    """A located walk: the map, what Python says, and the truth."""

    name: str
    kind: str
    mapped: Mapped
    by_python: Fixes
    truth: Truth


def prepared(folder: Path, given: argparse.Namespace) -> list[ComparedWalk]:
    """Maps, walks and the encoder as files, and where Python finds the walks."""
    encoder, parameters = load_encoder("compact"), Parameters()
    assert isinstance(encoder, OnnxEncoder)
    (folder / "encoder.onnx").write_bytes(encoder.content)
    walks, told = [], []
    for name, seed in itertools.product(given.worlds, given.seeds):
        world = load_world(name)
        mapped = mapped_walk(world, seed, MAPPING_ROUNDS, encoder)
        floor_map, map_name = mapped.run.floor_map, f"{name}_{seed}"
        assert floor_map is not None
        write_floor_map(folder / map_name, floor_map, parameters)
        for device, rate_hz in WALKS:
            today = Circumstances(device=device)
            recording, truth = simulate(
                world, seed + STRANGER, rounds=given.rounds, rate_hz=rate_hz, circumstances=today
            )
            fixes = locate(recording, floor_map, encoder, parameters)
            walk = f"{map_name}_{rate_hz}_{device.replace(' ', '_')}"
            assert recording.audio is not None
            write_f32(folder / f"{walk}.f32", recording.audio.samples[0])
            walks.append(ComparedWalk(walk, f"{device}, {rate_hz} Hz", mapped, fixes, truth))
            told.append({"name": walk, "map": map_name, "rateHz": rate_hz})
    (folder / "walks.json").write_text(json.dumps(told))
    return walks


def fixes_of_page(said: list[dict[str, Any]]) -> Fixes:
    """The page's fixes as Python has them."""
    xy = [[np.nan, np.nan] if fix["xyM"] is None else fix["xyM"] for fix in said]
    covariance = [
        np.full((2, 2), np.nan)
        if fix["covarianceM2"] is None
        else np.array(fix["covarianceM2"])[[0, 1, 1, 2]].reshape(2, 2)
        for fix in said
    ]
    return Fixes(
        t_s=np.array([fix["tS"] for fix in said]),
        xy_m=np.array(xy),
        heading_rad=np.array([fix["headingRad"] for fix in said], dtype=np.float64),
        covariance_m2=np.array(covariance),
        score=np.array([fix["score"] for fix in said], dtype=np.float64),
        status=np.array([FixStatus[fix["status"]] for fix in said]),
    )


def agreement(page: Fixes, python: Fixes) -> tuple[float, float, float]:
    """Share of windows of the same status; of those with a position, the share within 1 mm.

    And the distance within which 95 % of them lie, in metres.
    """
    count = min(len(page.t_s), len(python.t_s))
    same = page.status[:count] == python.status[:count]
    placed = same & np.isfinite(python.xy_m[:count, 0])
    apart_m = np.linalg.norm(page.xy_m[:count] - python.xy_m[:count], axis=1)[placed]
    windows = max(len(page.t_s), len(python.t_s))
    return (
        float(same.sum() / windows),
        float(np.mean(apart_m <= SAME_M)),
        float(np.percentile(apart_m, 95)),
    )


def print_agreement(walks: list[ComparedWalk], said: dict[str, Any]) -> None:
    """A row for each kind of walk; medians are those of the walks' medians."""
    print(f"{'phone, rate':52}windows  status  within  95 % are  median  median")
    print(f"{'':52}         equal    1 mm   within  Python    page")
    for kind in sorted({walk.kind for walk in walks}):
        rows = []
        for walk in (walk for walk in walks if walk.kind == kind):
            page = fixes_of_page(said[walk.name])
            mapped = walk.mapped
            medians = [
                fix_numbers(fixes, walk.truth, mapped.run.trajectory, mapped.truth)["median"]
                for fixes in (walk.by_python, page)
            ]
            rows.append([len(page.t_s), *agreement(page, walk.by_python), *medians])
        windows, status, close, apart_m, python_m, page_m = np.array(rows).T
        print(
            f"{kind:52}{windows.sum():7.0f}{np.average(status, weights=windows):8.3f}"
            f"{np.average(close, weights=windows):8.3f}{1000 * np.mean(apart_m):7.2f} mm"
            f"{np.mean(python_m):7.3f}m{np.mean(page_m):7.3f}m"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--worlds", nargs="+", default=["studio", "lounge"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[100, 101])
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "given"
        folder.mkdir()
        walks = prepared(folder, given)
        with serving(Path(name) / "data", "--no-jobs") as address, browsing() as browser:
            said, _ = run_in_page(browser, address, "accuracy", folder)
    print_agreement(walks, said)


if __name__ == "__main__":
    main()
