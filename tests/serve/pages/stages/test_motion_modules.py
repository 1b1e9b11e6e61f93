"""Motion of the page in node, on vectors that the line computes."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

from elfslam.base.values import Imu
from elfslam.stages.motion import BEGINNING, MotionParameters, find_footsteps, go_on
from elfslam.stages.motion.level import evenly_sampled, level, rate_of, still_bias
from elfslam.stages.motion.reckoning import (
    bounce_rms,
    lengths_between,
    phone_turn,
    smooth_heading,
    vertical_bounce,
)
from elfslam.world.device import BROWSER, LSM6DSO
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent
PARAMETERS = MotionParameters()


def listed(value: Any) -> Any:
    """Arrays as plain lists, row by row."""
    if isinstance(value, dict):
        return {name: listed(each) for name, each in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [listed(each) for each in value]
    return np.asarray(value, np.float64).ravel().tolist() if hasattr(value, "shape") else value


def simulated(world: str, seed: int, grade: Any = BROWSER) -> Imu:
    recording, _ = simulate(load_world(world), seed, rounds=1, sound=False, grade=grade)
    assert recording.imu is not None
    return recording.imu


def pausing(imu: Imu, pause_s: float) -> Imu:
    """The same walk, which stands still for a while in its middle and is sampled unevenly."""
    middle = len(imu.t_s) // 2
    rate_hz = 1 / float(np.median(np.diff(imu.t_s)))
    still = round(pause_s * rate_hz)
    rows = np.concatenate(
        [np.arange(middle), np.full(still, middle), np.arange(middle, len(imu.t_s))]
    )
    rest = (np.arange(len(rows)) >= middle) & (np.arange(len(rows)) < middle + still)
    generator = np.random.default_rng(3)
    t_s = np.arange(len(rows)) / rate_hz + generator.uniform(0, 0.3 / rate_hz, len(rows))
    gyro = np.where(rest[:, None], [0.01, -0.02, 0.004], imu.gyro_radps[rows])
    return Imu(t_s, imu.accel_mps2[rows], gyro)


def live_vectors(imu: Imu, every: int) -> dict[str, Any]:
    """The steps that come of a walk whose readings come in lots, and after which lot each came."""
    going, told = BEGINNING, []
    for first in range(0, len(imu.t_s), every):
        rows = slice(first, first + every)
        lot = Imu(imu.t_s[rows], imu.accel_mps2[rows], imu.gyro_radps[rows])
        going, steps = go_on(going, lot, PARAMETERS)
        told.append(np.column_stack([steps.t_s, steps.from_s, steps.moves, steps.sigma]))
    return {"every": every, "lots": [len(rows) for rows in told], "steps": np.vstack(told)}


def broken(imu: Imu) -> Imu:
    """The same walk with a second missing."""
    behind = np.arange(len(imu.t_s)) > 0.65 * len(imu.t_s)
    return Imu(imu.t_s + 1.0 * behind, imu.accel_mps2, imu.gyro_radps)


WALKS: dict[str, Callable[[], Imu]] = {
    "browser": lambda: simulated("studio", 100),
    "quick": lambda: simulated("lounge", 101, replace(LSM6DSO, rate_hz=104.0)),
    "pausing": lambda: pausing(simulated("studio", 102), 4.0),
}
LIVE: dict[str, Callable[[], Imu]] = {
    "browser": WALKS["browser"],
    "broken": lambda: broken(pausing(simulated("lounge", 103), 4.0)),
    "long pause": lambda: pausing(simulated("studio", 104), 14.0),
}


def as_page(imu: Imu) -> dict[str, Any]:
    return {"tS": imu.t_s, "accelMps2": imu.accel_mps2, "gyroRadps": imu.gyro_radps}


def motion_vectors(imu: Imu) -> dict[str, Any]:
    """What Python makes of a walk, stage by stage."""
    levelled = level(imu, PARAMETERS)
    bounce = vertical_bounce(levelled, PARAMETERS)
    footsteps_s = find_footsteps(imu, PARAMETERS)
    lengths_m = lengths_between(levelled, footsteps_s, PARAMETERS)
    return {
        "imu": as_page(imu),
        "rate_hz": levelled.rate_hz,
        "even": {"tS": levelled.t_s, "accel": levelled.accel_mps2, "gyro": levelled.gyro_radps},
        "up": levelled.up,
        "bounce": bounce,
        "rms": bounce_rms(bounce, PARAMETERS.bounce_window_s, levelled.rate_hz),
        "footsteps_s": footsteps_s,
        "lengths_m": lengths_m,
        "turn_rad": phone_turn(levelled),
        "heading_rad": smooth_heading(levelled, PARAMETERS),
    }


def peak_vectors(seed: int) -> dict[str, Any]:
    """Peaks of noise that is rounded, so that there are plateaus and equal heights."""
    values = np.round(np.cumsum(np.random.default_rng(seed).normal(size=400)), 1)
    values = values + np.linspace(0, 1e-6, len(values)) * np.r_[np.zeros(200), np.ones(200)]
    peaks, found = signal.find_peaks(values, prominence=0.5)
    apart, beside = signal.find_peaks(values + 1e-9 * np.arange(400), distance=12, prominence=0.5)
    return {
        "values": values,
        "peaks": peaks,
        "prominences": found["prominences"],
        "apart": apart,
        "apart_prominences": beside["prominences"],
    }


@pytest.fixture(scope="module")
def motion_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("motion") / "motion.json"
    walks = {name: motion_vectors(make()) for name, make in WALKS.items()}
    live = {}
    for name, make in LIVE.items():
        live[name] = {"imu": as_page(make()), **live_vectors(make(), 30)}
    peaks = [peak_vectors(seed) for seed in range(3)]
    given = {"parameters": asdict(PARAMETERS), "walks": walks, "live": live, "peaks": peaks}
    file.write_text(json.dumps(listed(given)))
    return file


@needs_node
def test_motion_is_that_of_the_line(motion_file: Path) -> None:
    """Five tests look at each walk, one at each that comes in live, six at no walk of ours."""
    passed = passed_in_node(HERE / "motion.test.mjs", ELFSLAM_VECTORS=motion_file)
    assert passed == 4 * len(WALKS) + len(LIVE) + 5


def test_the_walks_are_those_that_were_wanted(motion_file: Path) -> None:
    walks = json.loads(motion_file.read_text())["walks"]
    assert all(len(each["footsteps_s"]) > 20 for each in walks.values())
    t_s, accel, gyro = evenly_sampled(WALKS["pausing"]())
    found = still_bias(accel, gyro, rate_of(t_s), PARAMETERS)
    assert found == pytest.approx([0.01, -0.02, 0.004], abs=0.003)
