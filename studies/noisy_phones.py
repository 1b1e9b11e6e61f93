"""Phones whose echoes lie near their noise: the maps that they make, and fixes in another's map.

Each phone is as it was measured (`elfslam.world.device.MEASURED`). For maps, mean features are
corrected for what noise takes of them, or left as they are; fixes go by cosines, which the
correction does not reach.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.enums import Mode
from elfslam.base.errors import InputError
from elfslam.base.values import (
    NO_CLOSURES,
    Closures,
    Echoes,
    Features,
    Odometry,
    Trajectory,
    Truth,
)
from elfslam.scoring.errors import score_closures
from elfslam.slam.front_end import apply_acoustic_scale, dead_reckoning_nodes
from elfslam.slam.pipeline import closures_by
from elfslam.stages.closure import echo_sequence_similarity
from elfslam.stages.feature import Encoder
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.kinds import PEOPLE, Kind, kind_named
from elfslam.world.simulate import load_world
from studies.cached import at_its_start, extract_echoes, extract_features, record_of, simulate
from studies.localization import ALWAYS_ANSWERED
from studies.located import MEDIAN_M, OVER_1_M, Stranger, fix_numbers, located_in, stranger
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import ELF, PLAIN, closing_by, compared_encoders, tracking_by
from studies.results import Record, averaged
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, finished, median_aligned_m

WORLDS = ("studio", "lounge")
SEEDS = (120, 121, 122, 123)
ROUNDS, QUERY_ROUNDS = 4, 2
QUIET_PHONE = "galaxy s4 mic 1"
PHONES = (QUIET_PHONE, "galaxy s4 mic 0", "galaxy s5 mic 0", "iphone 5c up")
"""Echoes lay 17, 5 and 4 dB over the noise of a chirp, and 4 dB under it."""
FEATURES = (ELF, PLAIN)
CORRECTED, UNCORRECTED = "corrected", "uncorrected"
WALKED = "dead reckoning"
KEPT, FALSE, OVER_NOISE = "closures kept", "false closures kept", "echo over noise (dB)"
FOUND, ANSWERED = "chirps found", "answered"


@dataclass(frozen=True)
class Room:
    """A room that each of the phones maps, and in which each is located later."""

    world: str
    seed: int
    kind: str
    phones: tuple[str, ...] = PHONES
    rounds: int = ROUNDS


@dataclass(frozen=True, eq=False)
class Walked:
    """A walk with a phone, the settings that know its walker, and the truth about it."""

    nodes: Odometry
    echoes: Echoes
    settings: Settings
    truth: Truth


@dataclass(frozen=True, eq=False)
class Mapped:
    """A walk corrected by the closures that its features made."""

    walk: Walked
    features: Features
    closures: Closures
    trajectory: Trajectory


def measure_noisy_phones(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    phones: Sequence[str] = PHONES,
    rounds: int = ROUNDS,
    kind: Kind = PEOPLE,
) -> list[Record]:
    """Errors and closures of maps by phone (the condition), and fixes by phone and whose map.

    The first of the phones is the quiet one, in whose maps all are located. Numbers of maps are
    of those walks in which chirps are found at all; all rooms are taken together.
    """
    rooms = [
        Room(world, seed, kind.name, tuple(phones), rounds) for world in worlds for seed in seeds
    ]
    together = " and ".join(worlds)
    walks = finished(_measured, rooms, context)
    return averaged([[replace(each, world=together) for each in walk] for walk in walks], seeds)


def _measured(room: Room) -> list[Record]:
    walks = {phone: _walked(room, phone) for phone in room.phones}
    maps = {phone: _maps(walk) for phone, walk in walks.items() if walk is not None}
    records: list[Record] = []
    for phone, walk in walks.items():
        records += record_of(room, WALKED, phone).each(_walk_numbers(walk))
        for method, mapped in maps.get(phone, {}).items():
            records += record_of(room, method, phone).each(_map_numbers(mapped))
        query = _query(room, phone)
        for mapper in dict.fromkeys((room.phones[0], phone)):
            whose = "its own map" if mapper == phone else f"the map by {mapper}"
            for method, numbers in _fixes(maps.get(mapper, {}), query):
                records += record_of(room, method, f"{phone} in {whose}").each(numbers)
    return records


def _walked(room: Room, phone: str) -> Walked | None:
    """Who maps: from a known start, with steps of known length. None where no chirp is found."""
    world, kind = load_world(room.world), kind_named(room.kind)
    today = replace(kind.mapping(world.room), device=phone)
    recording, truth = simulate(
        world, room.seed, rounds=room.rounds, walker=kind.walker, circumstances=today
    )
    settings = walkers(room.seed, kind)[CALIBRATED]
    try:
        echoes = extract_echoes(recording, settings)
    except InputError:
        return None
    nodes = dead_reckoning_nodes(at_its_start(recording, truth), settings)
    return Walked(apply_acoustic_scale(nodes, echoes, settings), echoes, settings, truth)


def _query(room: Room, phone: str) -> Stranger | None:
    """Who is located days later, where chirps are found."""
    world, kind = load_world(room.world), kind_named(room.kind)
    later = replace(kind.asking(world.room), device=phone)
    try:
        return stranger(world, room.seed, QUERY_ROUNDS, circumstances=later, kind=kind)
    except InputError:
        return None


def _maps(walk: Walked) -> dict[str, Mapped]:
    """By each feature, corrected and not."""
    maps = {}
    for feature, encoder in _encoders():
        features = extract_features(walk.echoes, encoder)
        plain = replace(features, attenuation=1.0)
        maps[f"{feature}, {UNCORRECTED}"] = _mapped(walk, feature, plain)
        maps[f"{feature}, {CORRECTED}"] = _mapped(walk, feature, features)
    return maps


def _encoders() -> Iterator[tuple[str, Encoder]]:
    return ((feature, compared_encoders()[feature]) for feature in FEATURES)


def _mapped(walk: Walked, feature: str, features: Features) -> Mapped:
    similarity = echo_sequence_similarity(features, walk.nodes)
    strictness = closing_by(feature, walk.settings)
    closures = closures_by(walk.nodes, [(similarity, strictness)], walk.settings)
    return Mapped(walk, features, closures, _solved(walk, closures))


def _solved(walk: Walked, closures: Closures) -> Trajectory:
    return optimise(build_graph(walk.nodes, closures), walk.nodes.t_s, walk.settings.graph)


def _walk_numbers(walk: Walked | None) -> dict[str, float]:
    if walk is None:
        return {FOUND: 0.0}
    reckoned_m = median_aligned_m(_solved(walk, NO_CLOSURES), walk.truth)
    return {FOUND: 1.0, MEDIAN_ALIGNED: reckoned_m, OVER_NOISE: walk.echoes.over_noise_db}


def _map_numbers(mapped: Mapped) -> dict[str, float]:
    trajectory, truth = mapped.trajectory, mapped.walk.truth
    kept = mapped.closures.chosen(trajectory.closure_weights > 0.5)
    right = score_closures(kept, trajectory.t_s, truth).right
    error_m = median_aligned_m(trajectory, truth)
    return {MEDIAN_ALIGNED: error_m, KEPT: len(right), FALSE: float(np.sum(~right))}


def _fixes(
    maps: Mapping[str, Mapped], query: Stranger | None
) -> Iterator[tuple[str, dict[str, float]]]:
    """By the particle filter: with thresholds by the ELF, every footstep by each feature.

    No footstep is answered where chirps were not found, neither then nor by who mapped.
    """
    if query is None or not maps:
        yield ELF, {ANSWERED: 0.0}
        return
    for feature, encoder in _encoders():
        mapped = maps[f"{feature}, {CORRECTED}"]
        asked = replace(query, features=extract_features(query.echoes, encoder))
        always = replace(Settings(), track=tracking_by(feature, Settings()))
        if feature == ELF:
            yield ELF, _fix_numbers(mapped, asked, Settings())
        yield ALWAYS_ANSWERED.format(feature), _fix_numbers(mapped, asked, always)


def _fix_numbers(mapped: Mapped, query: Stranger, settings: Settings) -> dict[str, float]:
    floor_map = trajectory_map(
        mapped.trajectory, mapped.features, settings.floormap, parameters_digest="", source=""
    )
    fixes = located_in(floor_map, query, Mode.TRACK, settings)
    found = fix_numbers(fixes, query.truth, mapped.trajectory, mapped.walk.truth)
    return {name: found[name] for name in (ANSWERED, MEDIAN_M, OVER_1_M)}


STUDY = Study(
    "How good are maps by noisy phones, with and without correction, and fixes of such phones?",
    measure_noisy_phones, minutes=10, long=True, scenarios=("people", "surveyor"),
    fast={"worlds": ("studio",), "seeds": (120,), "phones": PHONES[:2], "rounds": 2},
)  # fmt: skip
