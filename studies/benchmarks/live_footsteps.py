"""The page's live footsteps beside the footsteps of the whole walk, by delay and window.

    python -m studies.benchmarks.live_footsteps [--delays S...] [--windows S...] [--worlds NAME...]
        [--seeds N...] [--rounds N]

Walks are simulated with the motion that a browser gives. A line per delay and window: footsteps of
the whole walk that live ones miss, and those that live alone are found; then, of those in common,
how far they lie apart (rms): in time, in length, in the turn of a step, and in the turn of the
whole walk; how old a footstep is when it is given out (median and 95 %, asked for ten times a
second), and processor milliseconds in node per time that they are asked for.
Needs node.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.geometry import between
from elfslam.base.values import Imu, Odometry
from elfslam.line.motion import MotionParameters, dead_reckon
from elfslam.world.device import BROWSER
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from studies.benchmarks.page_tracking import in_node, readings

WORLDS = ("studio", "lounge", "concourse")
SAME_S = 0.15
"""Footsteps closer in time are the same."""


@dataclass(frozen=True)
class Apart:
    """How a live walk differs from the whole one."""

    footsteps: int
    missed: int
    extra: int
    time_s: F64
    length_share: F64
    turn_rad: F64
    turned_rad: float
    late_s: F64
    ask_ms: float


def simulated(world: str, seed: int, rounds: int) -> Imu:
    """A walk with a browser's sensors."""
    recording, _ = simulate(load_world(world), seed, rounds=rounds, sound=False, grade=BROWSER)
    assert recording.imu is not None
    return recording.imu


def apart(imu: Imu, whole: Odometry, parameters: MotionParameters) -> Apart:
    """The walk by the page, step for step beside the whole one."""
    told = in_node("timed", {"imu": readings(imu), "parameters": asdict(parameters)})
    steps = told["steps"]
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
        footsteps=len(wanted_s),
        missed=int((~found).sum()),
        extra=int((abs(off_s) >= SAME_S).sum()),
        time_s=off_s[1:][same],
        length_share=(live_m / length_m - 1)[same],
        turn_rad=(live[:, 2] - moves[:, 2])[same],
        turned_rad=float((live[:, 2] - moves[:, 2])[same].sum()),
        late_s=np.array([step["takenS"] - step["tS"] for step in steps]),
        ask_ms=told["askMs"],
    )


def line_of(walks: list[Apart]) -> str:
    """All walks in one line."""

    def rms(values: Any) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    both = {name: np.concatenate([getattr(walk, name) for walk in walks])
            for name in ("time_s", "length_share", "turn_rad", "late_s")}  # fmt: skip
    count = {name: sum(getattr(walk, name) for walk in walks)
             for name in ("footsteps", "missed", "extra")}  # fmt: skip
    return (
        f"{', '.join(f'{number} {name}' for name, number in count.items())}; "
        f"time {1000 * rms(both['time_s']):.1f} ms, "
        f"length {100 * rms(both['length_share']):.2f} % "
        f"(mean {100 * both['length_share'].mean():+.2f}), "
        f"turn {np.degrees(rms(both['turn_rad'])):.2f} deg, "
        f"of the walk {np.degrees(rms([walk.turned_rad for walk in walks])):.1f} deg; "
        f"late {np.median(both['late_s']):.2f} s ({np.quantile(both['late_s'], 0.95):.2f}); "
        f"{np.mean([walk.ask_ms for walk in walks]):.2f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parameters = MotionParameters()
    parser.add_argument("--delays", nargs="+", type=float, default=[parameters.live_delay_s])
    parser.add_argument("--windows", nargs="+", type=float, default=[parameters.live_window_s])
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(100, 106)))
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    imus = [simulated(world, seed, given.rounds) for world in given.worlds for seed in given.seeds]
    wholes = [dead_reckon(imu, parameters) for imu in imus]
    for window_s in given.windows:
        for delay_s in given.delays:
            tried = replace(parameters, live_window_s=window_s, live_delay_s=delay_s)
            walks = [apart(imu, whole, tried) for imu, whole in zip(imus, wholes, strict=True)]
            print(f"window {window_s:g} s, delay {delay_s:g} s: {line_of(walks)}", flush=True)


if __name__ == "__main__":
    main()
