"""The paper's table of localization errors: one-shot, trajectory matching and particle filter.

Echoes and baselines are each located in the map that they made themselves. Features are compared
where every window is answered, as each would need a threshold of its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.app.settings import Settings, sense_of
from elfslam.base.arrays import F32
from elfslam.base.enums import Modality, Mode
from elfslam.base.values import Fixes, FixStatus, FloorMap, Orientation, Recording, Run
from elfslam.baselines.magnetic import level_by_gravity
from elfslam.baselines.maps import (
    MAGNETIC_LOCATE,
    MAGNETIC_SEGMENTS,
    WIFI_LOCATE,
    WIFI_SEGMENTS,
    magnetic_map,
    magnetic_spot_scores,
    wifi_map,
    wifi_spot_scores,
)
from elfslam.slam.pipeline import map_by
from elfslam.stages.locate import fixes_of
from elfslam.stages.segments import locate_by_segments
from elfslam.world.kinds import PEOPLE, QUIET, Kind, kind_named
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world
from studies.cached import extract_features, record_of
from studies.located import (
    MAPPING_ROUNDS,
    MEDIAN_M,
    Mapped,
    Stranger,
    fix_numbers,
    located,
    located_in,
    mapped_walk,
    stranger,
)
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import ELF, feature_maps, tracking_by
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(10))
ROUNDS = 2
"""Of the query walk."""
ELSEWHERE: Mapping[str, str] = {"studio": "lounge"}
"""Where the query walk of an unmapped place goes: the studio, unless that is the map's."""
SENSORS = (Sensor.WIFI, Sensor.MAGNETIC)
BASELINES = (Modality.WIFI, Modality.MAGNETIC)
ONE_SHOT, TRAJECTORY, TRACK = Mode.ONE_SHOT.value, Mode.TRAJECTORY.value, Mode.TRACK.value
"""The way of locating is the condition; `track` is the particle filter."""
ALWAYS_ANSWERED = "{}, always answered"
ANSWERED_ELSEWHERE = "answered elsewhere"
"""The share answered of a query walk that is not in the map at all."""
VARIANTS: Mapping[str, str] = {"tuned": "", "paper": ", paper's"}
ERRORS = (MEDIAN_M, "mean error (m)", "third quartile (m)")
PAPER_M: Mapping[tuple[str, str], Mapping[str, tuple[float, float, float]]] = {
    (ELF, ONE_SHOT): {
        "living_room": (0.10, 0.29, 0.14), "office": (0.54, 0.60, 0.80), "mall": (0.42, 0.79, 0.67),
    },
    ("wifi, paper's", ONE_SHOT): {
        "living_room": (1.67, 2.17, 3.30), "office": (3.44, 4.27, 6.16), "mall": (3.04, 3.86, 5.22),
    },
    ("magnetic, paper's", ONE_SHOT): {
        "living_room": (1.06, 2.31, 3.93), "office": (2.19, 3.95, 5.38),
        "mall": (12.48, 13.36, 19.28),
    },
    (ELF, TRAJECTORY): {
        "living_room": (0.10, 0.22, 0.64), "office": (0.41, 0.54, 0.97), "mall": (0.47, 0.53, 0.86),
    },
    ("wifi, paper's", TRAJECTORY): {
        "living_room": (0.54, 0.73, 1.13), "office": (1.74, 1.86, 3.09), "mall": (1.46, 1.90, 3.73),
    },
    ("magnetic, paper's", TRAJECTORY): {
        "living_room": (0.56, 0.56, 0.78), "office": (1.75, 1.81, 2.39),
        "mall": (8.70, 8.29, 14.59),
    },
}  # fmt: skip
"""Median, mean and third quartile, m, of localization in three real places."""


@dataclass(frozen=True)
class Pair:
    """A mapping walk and a query walk, in one world."""

    world: str
    seed: int
    mapping_rounds: int = MAPPING_ROUNDS
    rounds: int = ROUNDS
    kind: str = QUIET.name


def measure_localization(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    mapping_rounds: int = MAPPING_ROUNDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Errors of every way to be located, and the share of queries answered."""
    tasks = [
        Pair(world, seed, mapping_rounds, rounds, kind.name) for world in worlds for seed in seeds
    ]
    walks = averaged(finished(_measured, tasks, context), seeds)
    return [replace(each, paper=paper_m(each)) for each in walks]


def paper_m(record: Record) -> float | None:
    """What the paper has in its three places."""
    known = PAPER_M.get((record.method, record.condition), {}).get(record.world, ())
    return dict(zip(ERRORS, known, strict=False)).get(record.metric)


def _measured(pair: Pair) -> list[Record]:
    world, kind = load_world(pair.world), kind_named(pair.kind)
    mapped = mapped_walk(world, pair.seed, pair.mapping_rounds, sensors=SENSORS, kind=kind)
    other = stranger(world, pair.seed, pair.rounds, sensors=SENSORS, kind=kind)
    strange = load_world(ELSEWHERE.get(pair.world, "studio"))
    lost = stranger(strange, pair.seed, 1, kind=kind)
    records: list[Record] = []
    for mode in Mode:
        wrongly = located(mapped, lost, mode, Settings()).status == FixStatus.OK
        numbers = {ANSWERED_ELSEWHERE: float(np.mean(wrongly))}
        records += record_of(pair, ELF, mode.value).each(numbers)
    ways = (*_by_echoes(mapped, other), *_by_features(pair, mapped, other),
            *_baselines(pair, mapped, other))  # fmt: skip
    for method, way, fixes, run in ways:
        numbers = fix_numbers(fixes, other.truth, run.trajectory, mapped.truth)
        records += record_of(pair, method, way).each(numbers)
    return records


def _by_echoes(mapped: Mapped, other: Stranger) -> Iterator[tuple[str, str, Fixes, Run]]:
    """As the pipeline locates, in each mode."""
    for mode in Mode:
        yield ELF, mode.value, located(mapped, other, mode, Settings()), mapped.run


def _by_features(
    pair: Pair, mapped: Mapped, other: Stranger
) -> Iterator[tuple[str, str, Fixes, Run]]:
    """Each feature in a map of its own making: every window is where the most similar spot is.

    Hand-made ones go through the particle filter too, which answers every footstep.
    """
    settings = walkers(pair.seed, kind_named(pair.kind))[CALIBRATED]
    for feature, own in feature_maps(mapped.recording, mapped.run, settings).items():
        yield ALWAYS_ANSWERED.format(feature), ONE_SHOT, own.asked(other.echoes), own.run
        if feature != ELF:
            assert own.run.floor_map is not None
            heard = replace(other, features=extract_features(other.echoes, own.encoder))
            known = replace(Settings(), track=tracking_by(feature, Settings()))
            yield feature, TRACK, located_in(own.run.floor_map, heard, Mode.TRACK, known), own.run


def _baselines(
    pair: Pair, mapped: Mapped, other: Stranger
) -> Iterator[tuple[str, str, Fixes, Run]]:
    """Each baseline in a map of its own making, by its tuned scores and by the paper's."""
    settings = walkers(pair.seed, kind_named(pair.kind))[CALIBRATED]
    nodes = other.nodes
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    for modality in BASELINES:
        run = map_by(mapped.recording, [sense_of(modality, settings)], settings)
        by_wifi = modality is Modality.WIFI
        known, segments = (
            (WIFI_LOCATE, WIFI_SEGMENTS) if by_wifi else (MAGNETIC_LOCATE, MAGNETIC_SEGMENTS)
        )
        for variant, suffix in VARIANTS.items():
            floor_map, scores = _spots_and_scores(modality, variant, run, mapped.recording, other)
            name = modality.value + suffix
            yield name, ONE_SHOT, fixes_of(middle_s, scores, floor_map, known), run
            yield name, TRAJECTORY, locate_by_segments(nodes, scores, floor_map, segments), run


def _spots_and_scores(
    modality: Modality, variant: str, run: Run, recording: Recording, other: Stranger
) -> tuple[FloorMap, F32]:
    settings, theirs = Settings(), other.recording
    if modality is Modality.WIFI:
        assert recording.wifi is not None
        assert theirs.wifi is not None
        wifi = replace(settings.wifi, variant=variant)
        floor_map = wifi_map(recording.wifi, run.odometry, run.trajectory, wifi)
        return floor_map, wifi_spot_scores(theirs.wifi, other.nodes, floor_map, wifi)
    assert recording.magnetometer is not None
    assert theirs.magnetometer is not None
    magnetic = replace(settings.magnetic, variant=variant)
    floor_map = magnetic_map(
        recording.magnetometer, _level(recording), run.odometry, run.trajectory, magnetic
    )
    scores = magnetic_spot_scores(
        theirs.magnetometer, _level(theirs), other.nodes, floor_map, magnetic
    )
    return floor_map, scores


def _level(recording: Recording) -> Orientation:
    assert recording.imu is not None
    return level_by_gravity(recording.imu)


STUDY = Study(
    "How far off are fixes in a map of another walk, by method, in the paper's three places?",
    measure_localization, minutes=40, scenarios=("people", "surveyor"), long=True,
    fast={"worlds": ("studio",), "seeds": (100,), "mapping_rounds": 2, "rounds": 1},
)  # fmt: skip
