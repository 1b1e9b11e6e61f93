"""How fast echoes are made and used: echoes per second and core, and the stages of the line.

Usage, from the root of the project:

    python -m studies.benchmarks.echo_synthesis [--world NAME] [--echoes N] [--rounds N] [--seed N]

Echo synthesis is `room_responses` and `render_frames` after a warm-up, best of five, per second of
processor time, so that a busy machine or several threads do not flatter it. The stages of the line
are wall-clock seconds of mapping one simulated walk, after a warm-up on one lap.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.values import Recording, Run
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.feature import load_encoder
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.device import built_in_device
from elfslam.world.phone import poses_at, render_frames, room_responses
from elfslam.world.room import Room
from elfslam.world.scene import scene_of
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world

WALL_MARGIN_M = 0.5
PHONE_HEIGHT_M = 1.2


def synthesis(room: Room, echoes: int) -> Callable[[], F32]:
    """Something that renders `echoes` frames at random free places of the room when called."""
    generator = np.random.default_rng(0)
    chirp, device = make_chirp(ChirpParameters(), 44_100), built_in_device("simulated phone")
    scene = scene_of(room)
    xy_m = room.corner_m + generator.uniform(0.0, 1.0, (20 * echoes, 2)) * room.size_m[:2]
    xy_m = xy_m[room.is_free(xy_m, PHONE_HEIGHT_M, WALL_MARGIN_M)][:echoes]
    position_m = np.column_stack([xy_m, np.full(echoes, PHONE_HEIGHT_M)])
    yaw_rad = generator.uniform(-np.pi, np.pi, echoes)
    poses = poses_at(position_m, yaw_rad, np.full(echoes, 0.4))

    def render() -> F32:
        return render_frames(room_responses(scene, device, poses), chirp, device)

    return render


def best_processor_s(work: Callable[[], object], times: int = 5) -> float:
    """Processor seconds of the fastest of `times` calls, after one that is not counted."""
    work()
    seconds = []
    for _ in range(times):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def mapped(recording: Recording) -> Run:
    return map_by_echoes(recording, load_encoder("compact"), Parameters())


def print_line(world_name: str, seed: int, rounds: int) -> None:
    """Simulate a walk, map it, and print the seconds of each."""
    world = load_world(world_name)
    mapped(simulate(world, seed, rounds=1)[0])
    start = time.perf_counter()
    recording, _ = simulate(world, seed, rounds=rounds)
    simulated_s = time.perf_counter() - start
    run = mapped(recording)
    assert run.echoes is not None
    assert recording.imu is not None
    print(
        f"{recording.name}, {rounds} laps: {recording.imu.t_s[-1]:.0f} s of walking, "
        f"{len(run.odometry.t_s)} footsteps, {len(run.echoes.t_s)} echoes"
    )
    for stage, seconds in {"simulation": simulated_s, **run.seconds}.items():
        print(f"  {stage:<12}{seconds:8.3f} s")
    print(f"  {'line in all':<12}{sum(run.seconds.values()):8.3f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time echo synthesis and the stages of the line.")
    parser.add_argument("--world", default="living_room")
    parser.add_argument("--echoes", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    room = load_world(given.world).room
    per_s = given.echoes / best_processor_s(synthesis(room, given.echoes))
    print(f"{given.world}: {len(room.blocks)} blocks, {per_s:,.0f} echoes per second and core")
    print_line(given.world, given.seed, given.rounds)


if __name__ == "__main__":
    main()
