"""Phones in one room, with and without slotted medium access: frames spoiled, and fixes left."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64, I64, Bool
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, Fixes, FixStatus
from elfslam.scoring.errors import fix_distances
from elfslam.stages.echo import EchoParameters, Frames, echoes_of, find_frames
from elfslam.stages.feature import extract_features
from elfslam.stages.locate import LocateParameters, elf_payload, fixes_of, spot_similarity
from elfslam.stages.medium_access import MediumAccessParameters
from elfslam.world.kinds import QUIET
from elfslam.world.simulate import load_world
from studies.cached import SCENARIOS, shipped
from studies.crowd import Crowd, Overheard, alone, crowd_in, overhear
from studies.located import MAPPING_ROUNDS, Mapped, mapped_walk, world_from_map
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

PLACES = ("living_room",)
SEEDS = tuple(range(4))
COUNTS = (1, 2, 3, 4, 5)
ALONE = 5
"""Where one phone chirps alone so many are looked at, one after the other."""
SECONDS = 40.0
SETTLED_S = 10.0
"""What is heard before that is left out: phones find their turns."""
SPOILED_DB = -10.0
"""Others' sound over the own echoes in a trace, from which on it counts as spoiled."""
LONGEST_S = 2.0
FEWEST = 2
"""Of sparse echoes two make as good a fix as three, and sooner."""
GROSS_M = 1.0
BAND_HZ = (14_500.0, 20_500.0)


@dataclass(frozen=True)
class Task:
    """So many phones in a world."""

    world: str
    seed: int
    phones: int
    seconds: float = SECONDS
    mapping_rounds: int = MAPPING_ROUNDS


def measure_contention(
    context: StudyContext,
    *,
    places: Sequence[str] = PLACES,
    seeds: Sequence[int] = SEEDS,
    counts: Sequence[int] = COUNTS,
    seconds: float = SECONDS,
    mapping_rounds: int = MAPPING_ROUNDS,
) -> list[Record]:
    """Frames spoiled and fixes left by way of chirping and number of phones (the condition)."""
    tasks = [
        Task(place, seed, count, seconds, mapping_rounds)
        for place in places
        for seed in seeds
        for count in counts
    ]
    return averaged(finished(_measured, tasks, context), seeds)


def _measured(task: Task) -> list[Record]:
    """The means over the phones of a room."""
    mapped = _mapped(task.world, task.seed, task.mapping_rounds)
    count = max(task.phones, ALONE if task.phones == 1 else 0)
    everybody = crowd_in(load_world(task.world), count, task.seed, rounds=_rounds(task))
    seconds = min(task.seconds, *(phone.motion.t_s[-1] for phone in everybody.phones)) - 1.0
    crowds = [alone(everybody, k) for k in range(count)] if task.phones == 1 else [everybody]
    found: dict[tuple[str, str], list[float]] = {}
    for crowd in crowds:
        for way, slotted in (("at will", False), ("in turns", True)):
            heard = overhear(
                crowd, MediumAccessParameters(), task.seed, slotted=slotted, seconds=seconds
            )
            for k, phone in enumerate(heard):
                for metric, value in _of_phone(crowd, k, phone, mapped, seconds).items():
                    found.setdefault((way, metric), []).append(value)
    condition = f"{task.phones} phone{'s' if task.phones > 1 else ''}"
    return [
        Record(way, metric, float(np.nanmean(values)), world=task.world,
               scenario=SCENARIOS[QUIET.name], condition=condition)
        for (way, metric), values in found.items()
        if not np.isnan(values).all()
    ]  # fmt: skip


def _rounds(task: Task) -> int:
    """Enough laps for the time that is asked for."""
    route_m = load_world(task.world).route_m
    lap_m = np.linalg.norm(np.diff(route_m, axis=0, append=route_m[:1]), axis=1).sum()
    return int(np.ceil(1.7 * task.seconds / lap_m)) + 1


@cache
def _mapped(world: str, seed: int, rounds: int) -> Mapped:
    return mapped_walk(load_world(world), seed, rounds)


def _of_phone(
    crowd: Crowd, k: int, heard: Overheard, mapped: Mapped, seconds: float
) -> dict[str, float]:
    frames = find_frames(heard.audio, crowd.chirp, EchoParameters(), heard.played_t_s)
    arrivals = frames.arrivals.samples
    settled = arrivals > SETTLED_S * ECHO_RATE_HZ
    spoiled = _others_db(heard, arrivals) > SPOILED_DB
    span_s = seconds - SETTLED_S
    return {
        "spoiled frames (%)": 100 * float(spoiled[settled].mean()),
        "clean chirps (1/s)": (settled & ~spoiled).sum() / span_s,
        **_fix_numbers(_fixes(frames, ~settled, mapped), crowd, k, mapped, span_s),
    }


def _others_db(heard: Overheard, arrivals: I64) -> F64:
    """Energy of the others' sound over that of the own in each trace, in the band."""
    band = signal.butter(6, BAND_HZ, "bandpass", fs=ECHO_RATE_HZ, output="sos")

    def energy(sound: F32) -> F64:
        total = np.concatenate([[0.0], np.cumsum(signal.sosfilt(band, sound.astype(float)) ** 2)])
        first = arrivals + DISCARDED_SAMPLES
        last = np.minimum(first + ECHO_SAMPLES, len(sound))
        return np.asarray(total[last] - total[first])

    return np.asarray(10 * np.log10((energy(heard.others) + 1e-15) / (energy(heard.own) + 1e-15)))


def _fixes(frames: Frames, dropped: Bool, mapped: Mapped) -> Fixes | None:
    """One-shot fixes, each from at least half a second of sound and two echoes."""
    if dropped.all():
        return None
    floor_map, known = mapped.run.floor_map, LocateParameters()
    assert floor_map is not None
    echoes = echoes_of(frames, EchoParameters(), None, dropped)
    groups = together(echoes.t_s, known)
    if not groups:
        return None
    features = extract_features(echoes, shipped())
    payload = elf_payload(floor_map, features.encoder, features.vectors.shape[1])
    means = np.stack([features.vectors[rows].mean(axis=0) for rows in groups])
    t_s = np.array([echoes.t_s[rows].mean() for rows in groups])
    return fixes_of(t_s, spot_similarity(means.astype(np.float32), payload), floor_map, known)


def together(t_s: F64, parameters: LocateParameters) -> list[list[int]]:
    """Rows of echoes that make a fix each: as soon as they are enough and last long enough."""
    groups: list[list[int]] = []
    rows: list[int] = []
    for row, now_s in enumerate(t_s):
        rows = [each for each in rows if now_s - t_s[each] <= LONGEST_S]
        rows.append(row)
        if len(rows) >= FEWEST and now_s - t_s[rows[0]] >= parameters.window_s - 0.11:
            groups.append(rows)
            rows = []
    return groups


def _fix_numbers(
    fixes: Fixes | None, crowd: Crowd, k: int, mapped: Mapped, span_s: float
) -> dict[str, float]:
    if fixes is None:
        return {"fixes within 1 m (1/min)": 0.0}
    later = Fixes(
        fixes.t_s - crowd.phones[k].in_s, fixes.xy_m, fixes.heading_rad, fixes.covariance_m2,
        fixes.score, fixes.status,
    )  # fmt: skip
    status, errors = fix_distances(later, crowd.phones[k].truth, world_from_map(mapped))
    answered = errors[status == FixStatus.OK]
    return {
        "median error (m)": float(np.median(answered)) if len(answered) else float("nan"),
        "fixes within 1 m (1/min)": 60 * float(np.sum(answered <= GROSS_M)) / span_s,
    }


STUDY = Study(
    "What do phones that chirp in one room cost each other, at will and in turns?",
    measure_contention, minutes=25, long=True,
    fast={"places": ("studio",), "seeds": (100,), "counts": (1, 2), "seconds": 20.0,
          "mapping_rounds": 1},
)  # fmt: skip
