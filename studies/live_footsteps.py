"""The page's live footsteps beside the footsteps of the whole walk, by how long they are awaited.

Walks are simulated with the motion that a browser gives, and go through the page's modules in node,
asked for ten times a second. Of the footsteps in common: how far they lie apart (rms), and how old
one is when it is given out.
"""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import between
from elfslam.base.values import Imu, Odometry
from elfslam.stages.motion import MotionParameters, dead_reckon
from elfslam.world.device import BROWSER
from elfslam.world.world_file import load_world
from studies.cached import SCENARIOS, simulate
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

WORLDS, SEEDS, ROUNDS = ("studio", "lounge", "concourse"), (100, 101), 2
DELAYS_S = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 1.0, 2.0)
SAME_S = 0.15
"""Footsteps closer in time are the same."""


@dataclass(frozen=True)
class Apart:
    """How a live walk differs from the whole one."""

    missed: int
    time_s: F64
    length_share: F64
    turn_rad: F64
    late_s: F64


def measure_live_footsteps(
    context: StudyContext,
    *,
    delays_s: Sequence[float] = DELAYS_S,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
) -> Iterator[Record]:
    """What a delay (the condition) costs and gives, over all walks."""
    usual = MotionParameters()
    imus = [walked(world, seed) for world in worlds for seed in seeds]
    wholes = [dead_reckon(imu, usual) for imu in imus]
    for delay_s in delays_s:
        tried = replace(usual, live_delay_s=delay_s)
        walks = [apart(imu, whole, tried) for imu, whole in zip(imus, wholes, strict=True)]
        yield from Record(
            "live footsteps", condition=f"{delay_s:g} s", scenario=SCENARIOS["quiet"],
            seeds=seeds_text(seeds),
        ).each(numbers(walks))  # fmt: skip


def walked(world: str, seed: int) -> Imu:
    """The motion of a walk with a browser's sensors."""
    recording, _ = simulate(load_world(world), seed, rounds=ROUNDS, sound=False, grade=BROWSER)
    assert recording.imu is not None
    return recording.imu


def apart(imu: Imu, whole: Odometry, parameters: MotionParameters) -> Apart:
    """The walk by the page, step for step beside the whole one."""
    steps = in_node("steps", {"imu": readings(imu), "parameters": asdict(parameters)})
    t_s = np.array([steps[0]["fromS"], *(step["tS"] for step in steps)])
    wanted_s = whole.t_s[whole.t_s <= imu.t_s[-1] - parameters.live_delay_s - 0.1]
    row = np.argmin(abs(whole.t_s[None] - t_s[:, None]), axis=1)
    off_s = t_s - whole.t_s[row]
    same = (abs(off_s) < SAME_S)[1:] & (abs(off_s) < SAME_S)[:-1] & (np.diff(row) == 1)
    moves = between(whole.world_from_body[:-1], whole.world_from_body[1:])[row[1:] - 1]
    live = np.array([step["moveM"] for step in steps])
    length_m, live_m = (np.hypot(each[:, 0], each[:, 1]) for each in (moves, live))
    found = abs(t_s[None] - wanted_s[:, None]).min(axis=1) < SAME_S
    return Apart(
        missed=int((~found).sum()),
        time_s=off_s[1:][same],
        length_share=(live_m / length_m - 1)[same],
        turn_rad=(live[:, 2] - moves[:, 2])[same],
        late_s=np.array([step["takenS"] - step["tS"] for step in steps]),
    )


def numbers(walks: Sequence[Apart]) -> dict[str, float]:
    """Of all walks together."""

    def rms(values: F64) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    def all_of(name: str) -> F64:
        return np.concatenate([getattr(walk, name) for walk in walks])

    turned_rad = np.array([walk.turn_rad.sum() for walk in walks])
    return {
        "missed footsteps": float(sum(walk.missed for walk in walks)),
        "time, rms (ms)": 1000 * rms(all_of("time_s")),
        "step length, rms (%)": 100 * rms(all_of("length_share")),
        "turn of the walk, rms (deg)": float(np.degrees(rms(turned_rad))),
        "age when given, median (s)": float(np.median(all_of("late_s"))),
    }


# --- the page's modules in node ---


SCRIPT = Path(__file__).with_suffix(".mjs")


def in_node(verb: str, given: dict[str, Any]) -> Any:
    """What a verb of live_footsteps.mjs says. Raises InputError where node is not installed."""
    if shutil.which("node") is None:
        raise InputError("node is missing; the page's modules run in it (Debian: nodejs)")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "given.json"
        file.write_text(json.dumps(given))
        command = ["node", str(SCRIPT), verb, str(file)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def readings(imu: Imu) -> dict[str, list[float]]:
    """Motion as the page holds it."""
    rows = {"tS": imu.t_s, "accelMps2": imu.accel_mps2, "gyroRadps": imu.gyro_radps}
    return {name: values.ravel().tolist() for name, values in rows.items()}


STUDY = Study(
    "How long must a live footstep be awaited to be that of the whole walk?",
    measure_live_footsteps, minutes=5,
    fast={"delays_s": (0.1, 0.5), "worlds": ("studio",), "seeds": (100,)},
)  # fmt: skip
