"""How fast echoes are made: against pyroomacoustics, on both cores, and as a training stream."""

from __future__ import annotations

import multiprocessing
import resource
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from elfslam.base.values import Announce
from elfslam.stages.feature import spectrogram
from elfslam.world.device import named_device
from elfslam.world.diffuse import diffuse_echoes
from elfslam.world.echo_pairs import echo_pairs
from elfslam.world.paths import Reach
from elfslam.world.phone import Engine, air_at, ends_of, image_echoes, poses_at
from elfslam.world.room import Room
from elfslam.world.scattering import as_measured, scattering_of
from elfslam.world.scene import scene_of
from elfslam.world.world_file import load_world
from studies.results import Record
from studies.study import Study, StudyContext

RATE_HZ = 44_100
ECHOES = 2000
PYROOM_ECHOES = 20
STREAM_ECHOES = 600_000
PAIRS, ROOMS = 256, 8
ONE_GIGABYTE = 2**30
ENOUGH_ORDER = 12
"""Of reflections, for all paths of at most 21 m in the living room."""
TRACED_ECHOES = 5
ENGINES = ("images", "diffuse")
RATE, TIMES = "rate (echoes/s and core)", "times as fast"
OURS, PYROOM, PYROOM_DRY = "ours", "pyroomacoustics", "pyroomacoustics, air left out"
OURS_DIFFUSE, PYROOM_RAYS = "ours, diffuse field", "pyroomacoustics, as many rays"
EMPTY, FURNISHED, LAB = "living room, empty", "living room, furnished", "lab"


def measure_speed(
    context: StudyContext, *, echoes: int = ECHOES, stream: int = STREAM_ECHOES
) -> list[Record]:
    """Rates, their ratios, and the time of a training stream, all measured in this one run."""
    furnished = load_world("living_room").room
    empty = replace(furnished, blocks=())
    context.announce("living room", 0.0)
    rates = {
        (OURS, where): _rate(room, 1, echoes)
        for where, room in ((EMPTY, empty), (FURNISHED, furnished), (LAB, load_world("lab").room))
    }
    context.announce("pyroomacoustics", 0.1)
    rates[PYROOM, EMPTY] = _pyroom_rate(furnished, air_absorption=True)
    rates[PYROOM_DRY, EMPTY] = _pyroom_rate(furnished, air_absorption=False)
    rates |= _diffuse_rates(furnished, echoes)
    context.announce("both cores", 0.15)
    one, two = (_rate(furnished, k, echoes, clock=time.perf_counter) for k in (1, 2))
    records = [Record(name, RATE, value, condition=at) for (name, at), value in rates.items()]
    ratios = {
        (OURS, EMPTY): rates[OURS, EMPTY] / rates[PYROOM, EMPTY],
        (OURS, FURNISHED): rates[OURS, FURNISHED] / rates[PYROOM, EMPTY],
        (OURS_DIFFUSE, FURNISHED): rates[OURS_DIFFUSE, FURNISHED] / rates[PYROOM_RAYS, EMPTY],
        ("ours, two threads over one", FURNISHED): two / one,
    }
    records += [Record(name, TIMES, value, condition=at) for (name, at), value in ratios.items()]
    for engine in ENGINES:
        records += _stream_records(stream, engine, context.announce)
    return records


def _places(room: Room, count: int) -> Any:
    generator = np.random.default_rng(0)
    xy_m = room.corner_m + generator.uniform(0, 1, (20 * count, 2)) * room.size_m[:2]
    xy_m = xy_m[room.is_free(xy_m, 1.2, 0.3)][:count]
    yaw_rad = generator.uniform(-np.pi, np.pi, len(xy_m))
    position_m = np.column_stack([xy_m, np.full(len(xy_m), 1.2)])
    return poses_at(position_m, yaw_rad, np.full(len(xy_m), 0.4))


def _diffuse_rates(furnished: Room, echoes: int) -> dict[tuple[str, str], float]:
    """With the diffuse field, beside as many paths traced by pyroomacoustics in the empty room."""
    room = as_measured(furnished)
    scattering = scattering_of(room)
    engine = partial(diffuse_echoes, scattering=scattering)
    return {
        (OURS_DIFFUSE, FURNISHED): _rate(room, 1, echoes, engine=engine),
        (PYROOM_RAYS, EMPTY): _traced_rate(room, len(scattering.chains.to)),
    }


def _rate(
    room: Room,
    threads: int,
    echoes: int,
    clock: Callable[[], float] = time.process_time,
    engine: Engine | None = None,
) -> float:
    """Responses per second of the furnished scene, best of five; sound not yet rendered."""
    scene, poses = scene_of(room), _places(room, echoes)
    ends = ends_of(named_device("simulated phone"), poses)
    extract_echoes = engine or partial(image_echoes, threads=threads)

    def run() -> None:
        extract_echoes(scene, ends, poses.people_m, air_at(), Reach())

    run()
    seconds = []
    for _ in range(5):
        start = clock()
        run()
        seconds.append(clock() - start)
    return len(poses.position_m) / min(seconds)


def _pyroom_rate(room: Room, *, air_absorption: bool) -> float:
    """Responses of the empty room per second by pyroomacoustics, on one thread."""
    import pyroomacoustics

    pyroomacoustics.constants.set("num_threads", 1)
    south, east, north, west = (1 - wall.reflection**2 for wall in room.walls)
    surfaces = {
        "west": west, "east": east, "south": south, "north": north,
        "floor": 1 - room.floor.reflection**2, "ceiling": 1 - room.ceiling.reflection**2,
    }  # fmt: skip
    materials = {name: pyroomacoustics.Material(value) for name, value in surfaces.items()}
    ends = ends_of(named_device("simulated phone"), _places(room, PYROOM_ECHOES))
    lobe = pyroomacoustics.directivities.CardioidFamily
    seconds = []
    for row in range(PYROOM_ECHOES):
        box = pyroomacoustics.ShoeBox(
            room.size_m, fs=RATE_HZ, materials=materials, max_order=ENOUGH_ORDER,
            air_absorption=air_absorption,
        )  # fmt: skip
        box.add_source(ends.speaker[row], directivity=lobe(ends.speaker_axis[row], p=0.65))
        box.add_microphone(ends.microphone[row], directivity=lobe(ends.microphone_axis[row], p=0.8))
        start = time.process_time()
        box.image_source_model()
        length_m = np.linalg.norm(box.sources[0].images - box.mic_array.R[:, :1], axis=0)
        box.visibility[0] &= (length_m <= Reach().longest_m)[None]
        box.compute_rir()
        seconds.append(time.process_time() - start)
    return 1.0 / float(np.median(seconds))


def _traced_rate(room: Room, rays: int) -> float:
    """Responses of the empty room per second by so many rays of pyroomacoustics, on one thread."""
    import pyroomacoustics

    pyroomacoustics.constants.set("num_threads", 1)
    kept = pyroomacoustics.Material(1 - room.walls[0].reflection ** 2, room.walls[0].scattering)
    ends = ends_of(named_device("simulated phone"), _places(room, TRACED_ECHOES))
    seconds = []
    for row in range(TRACED_ECHOES):
        box = pyroomacoustics.ShoeBox(
            room.size_m, fs=RATE_HZ, materials=kept, max_order=0, ray_tracing=True
        )
        longest_s = Reach().longest_m / air_at().speed_mps
        box.set_ray_tracing(n_rays=rays, time_thres=longest_s, hist_bin_size=0.001)
        box.add_source(ends.speaker[row])
        box.add_microphone(ends.microphone[row])
        start = time.process_time()
        box.compute_rir()
        seconds.append(time.process_time() - start)
    return 1.0 / float(np.median(seconds))


def _stream_records(echoes: int, engine: str, announce: Announce) -> Iterator[Record]:
    """The training stream with its spectrograms, by two processes, and what memory it took."""
    steps = -(-echoes // (2 * PAIRS))
    start, done, memory = time.perf_counter(), 0, 0.0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        for _, used in pool.map(partial(_spectrograms, engine), range(steps), chunksize=8):
            done, memory = done + 1, max(memory, used)
            if done % 40 == 0:
                announce(f"{2 * PAIRS * done} echoes, {engine}", 0.2 + 0.8 * done / steps)
    minutes, gigabytes = (time.perf_counter() - start) / 60, memory / ONE_GIGABYTE
    name, of = f"training stream, {engine}", f"{echoes} echoes, 2 cores"
    yield Record(name, "time (min)", minutes, condition=of)
    yield Record(name, "peak memory of a process (GiB)", gigabytes, condition=of)


def _spectrograms(engine: str, step: int) -> tuple[int, float]:
    """Echoes turned into spectrograms in a step, and the most memory (bytes) used so far."""
    pairs = echo_pairs(np.random.default_rng([0, step]), PAIRS, ROOMS, engine)
    count = sum(len(spectrogram(side)) for side in (pairs.first, pairs.second))
    return count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0


STUDY = Study(
    "How fast are echoes simulated, against pyroomacoustics?",
    measure_speed, minutes=20, needs=("pyroomacoustics",), fast={"echoes": 40, "stream": 600},
)  # fmt: skip
