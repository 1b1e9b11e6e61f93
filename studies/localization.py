"""The paper's table of localization errors: one shot, trajectory and tracker; echoes and rivals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from elfslam.app.modalities import sense_of
from elfslam.app.settings import Settings
from elfslam.base.arrays import F32
from elfslam.base.choices import Modality, Mode
from elfslam.base.values import Fixes, FixStatus, FloorMap, Orientation, Recording, Run
from elfslam.baselines.magnetic import level_by_gravity
from elfslam.baselines.rival_maps import (
    MAGNETIC_LOCATE,
    MAGNETIC_SEGMENTS,
    WIFI_LOCATE,
    WIFI_SEGMENTS,
    magnetic_map,
    magnetic_spot_scores,
    wifi_map,
    wifi_spot_scores,
)
from elfslam.line.feature import Encoder, load_encoder
from elfslam.line.locate import fixes_of
from elfslam.line.segments import locate_by_segments
from elfslam.slam.pipeline import map_by
from elfslam.world.kinds import PEOPLE, QUIET, Kind, kind_named
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import load_world
from studies.finding import Finding, Given
from studies.localization_table import localization_page, localization_rows
from studies.located import (
    MAPPING_ROUNDS,
    Mapped,
    Stranger,
    fix_numbers,
    located,
    mapped_walk,
    stranger,
)
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import feature_maps
from studies.repeats import Numbers, by_world, finished

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(10))
ROUNDS = 2
"""Of the walk to be located."""
ELSEWHERE = {"studio": "lounge"}
"""Where someone walks who is not in the map at all: in the studio, unless that is the map's."""
SENSORS = (Sensor.WIFI, Sensor.MAGNETIC)
RIVALS = (Modality.WIFI, Modality.MAGNETIC)
ALWAYS_ANSWERED = "always answered"
VARIANTS = {"tuned": "", "paper": ", paper's"}


@dataclass(frozen=True)
class Pair:
    """A walk to map and another to be located, in one world."""

    world: str
    seed: int
    mapping_rounds: int = MAPPING_ROUNDS
    rounds: int = ROUNDS
    kind: str = QUIET.name


def measure_localization(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    mapping_rounds: int = MAPPING_ROUNDS,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> Finding:
    """Errors of every way to be located, and how many queries got an answer."""
    tasks = [
        Pair(world, seed, mapping_rounds, rounds, kind.name) for world in worlds for seed in seeds
    ]
    numbers = finished(_measured, tasks, given)
    rows = localization_rows(by_world(tasks, numbers))
    return Finding(rows, localization_page(rows))


def _measured(pair: Pair) -> Numbers:
    world, encoder, kind = load_world(pair.world), shipped(), kind_named(pair.kind)
    mapped = mapped_walk(world, pair.seed, pair.mapping_rounds, encoder, sensors=SENSORS, kind=kind)
    other = stranger(world, pair.seed, pair.rounds, encoder, sensors=SENSORS, kind=kind)
    strange = load_world(ELSEWHERE.get(pair.world, "studio"))
    lost = stranger(strange, pair.seed, 1, encoder, kind=kind)
    numbers: Numbers = {}
    for mode in Mode:
        fixes = located(mapped, other, mode, Settings())
        found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
        wrongly = located(mapped, lost, mode, Settings()).status == FixStatus.OK
        found["elsewhere"] = float(np.mean(wrongly))
        numbers |= {f"ELF|{mode.value}|{name}": value for name, value in found.items()}
    for name, mode, fixes, run in (*_always(pair, mapped, other), *_rivals(pair, mapped, other)):
        found = fix_numbers(fixes, other.truth, run.trajectory, mapped.truth)
        numbers |= {f"{name}|{mode.value}|{key}": value for key, value in found.items()}
    return numbers


def _always(pair: Pair, mapped: Mapped, other: Stranger) -> Iterator[tuple[str, Mode, Fixes, Run]]:
    """Each feature in a map of its own making; every window is where the most alike spot is."""
    settings = walkers(pair.seed, kind_named(pair.kind))[CALIBRATED]
    for feature, own in feature_maps(mapped.recording, mapped.run, settings).items():
        yield f"{feature}, {ALWAYS_ANSWERED}", Mode.ONE_SHOT, own.asked(other.echoes), own.run


@cache
def shipped() -> Encoder:
    """The encoder that comes with the package."""
    return load_encoder("compact")


def _rivals(pair: Pair, mapped: Mapped, other: Stranger) -> Iterator[tuple[str, Mode, Fixes, Run]]:
    """Each rival in a map of its own making, by its tuned scores and by the paper's."""
    settings = walkers(pair.seed, kind_named(pair.kind))[CALIBRATED]
    nodes, segments = (
        other.nodes,
        {Modality.WIFI: WIFI_SEGMENTS, Modality.MAGNETIC: MAGNETIC_SEGMENTS},
    )
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    for rival in RIVALS:
        run = map_by(mapped.recording, [sense_of(rival, settings)], settings)
        known = WIFI_LOCATE if rival is Modality.WIFI else MAGNETIC_LOCATE
        for variant, suffix in VARIANTS.items():
            floor_map, scores = _spots_and_scores(rival, variant, run, mapped.recording, other)
            name = rival.value + suffix
            yield name, Mode.ONE_SHOT, fixes_of(middle_s, scores, floor_map, known), run
            fixes = locate_by_segments(nodes, scores, floor_map, segments[rival])
            yield name, Mode.TRAJECTORY, fixes, run


def _spots_and_scores(
    rival: Modality, variant: str, run: Run, recording: Recording, other: Stranger
) -> tuple[FloorMap, F32]:
    settings, theirs = Settings(), other.recording
    if rival is Modality.WIFI:
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
