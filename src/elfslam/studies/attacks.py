"""Attacks on a phone that is being located: told how often, how soon, and what they move.

A stranger walks in a mapped place, and from some moment on an attacker plays at the phone. Honest
walks, with everything that a place may have but no attacker, give the false alarms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.choices import Mode
from elfslam.base.geometry import compose, interpolate_poses, inverse
from elfslam.base.values import Audio, Fixes, FixStatus, FloorMap, Recording
from elfslam.senses import Settings
from elfslam.slam import Parameters, locate
from elfslam.studies.attack_sounds import OWN_GAIN, SOUNDS, Victim, chirping_neighbours
from elfslam.studies.attacked_walk import PLACED_M, RATE_HZ, Walked, recorded, walked
from elfslam.studies.attacks_table import attacks_page, attacks_rows
from elfslam.studies.finding import Announce, Finding
from elfslam.studies.localization import shipped
from elfslam.studies.located import MAPPING_ROUNDS, STRANGER, Mapped, mapped_walk, world_from_map
from elfslam.studies.repeats import Numbers, finished
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import World, load_world

ROUNDS: Mapping[str, int] = {"living_room": 3, "office": 1}
SEEDS = (0, 1, 2)
LEVELS_DB = (0.0, 10.0, 20.0)
JITTER_S = 0.025
OTHER_WALK = 2000
"""Added to a seed: the walk that the attacker recorded."""
REGULAR = "predicted, regular schedule"
"""Chirps at the same moment of each period: an attacker knows when the next one comes."""
MODES = (Mode.TRACK, Mode.ONE_SHOT)
APART_S = 5.0
"""Alarms closer than this are one."""
WRONG_M = 1.0
NEIGHBOURS = (1, 3)
HONEST: Mapping[str, Circumstances] = {
    "alone": Circumstances(),
    "6 people": Circumstances(people=6),
    "music": Circumstances(sounds=("music",)),
    "speech and clicks": Circumstances(sounds=("speech", "clicks")),
    "furniture moved, 30 days": Circumstances(state="moved", day=30),
    "a quarter of the volume": Circumstances(volume=0.25),
    **{
        f"phone: {name}": Circumstances(device=name)
        for name in ("flat", "rippled", "cheap", "tablet", "bottom-fired")
    },
}


@dataclass(frozen=True)
class Place:
    """A place that is mapped, and who then walks there."""

    world: str
    seed: int
    rounds: int
    levels_db: tuple[float, ...] = LEVELS_DB
    attacks: tuple[str, ...] = (*SOUNDS, REGULAR)
    honest: tuple[str, ...] = tuple(HONEST)
    mapping_rounds: int = MAPPING_ROUNDS


def measure_attacks(
    data: Path | None,
    announce: Announce,
    kept: Path | None = None,
    *,
    worlds: Mapping[str, int] = ROUNDS,
    seeds: Sequence[int] = SEEDS,
    levels_db: Sequence[float] = LEVELS_DB,
    attacks: Sequence[str] = (*SOUNDS, REGULAR),
    honest: Sequence[str] = tuple(HONEST),
    mapping_rounds: int = MAPPING_ROUNDS,
) -> Finding:
    """What came of every attack, and false alarms of honest walks; `data` is not needed."""
    kinds = tuple(levels_db), tuple(attacks), tuple(honest), mapping_rounds
    tasks = [
        Place(world, seed, rounds, *kinds) for seed in seeds for world, rounds in worlds.items()
    ]
    numbers = finished(partial(measure_place), tasks, announce, kept=kept, workers=1)
    rows = attacks_rows(numbers)
    return Finding(rows, attacks_page(rows))


def measure_place(place: Place) -> Numbers:
    """The numbers of one place: `attack|level|mode|measure` and `honest|kind|mode|measure`."""
    world = load_world(place.world)
    mapped = mapped_walk(world, place.seed, place.mapping_rounds, shipped())
    numbers: Numbers = {}
    for name, victim in _victims(world, place):
        numbers |= _attacked(name, place.levels_db, victim, mapped)
    for name, walk, audio in _honest(world, place):
        numbers |= _quiet(name, walk, audio, mapped)
    return numbers


def _victims(world: World, place: Place) -> Iterator[tuple[str, Victim]]:
    speaker_m = np.append(_standing_place(world, place.seed), PLACED_M)
    for jitter_s in (JITTER_S, 0.0):
        names = [name for name in place.attacks if (name == REGULAR) == (jitter_s == 0)]
        if names:
            walk = walked(world, place.seed + STRANGER, place.rounds, jitter_s)
            other = walked(world, place.seed + OTHER_WALK, place.rounds, jitter_s)
            victim = Victim(walk, other, speaker_m, place.seed)
            yield from ((name, victim) for name in names)


def _standing_place(world: World, seed: int) -> F64:
    """Where a loudspeaker stands: the marked place or the corner of the route, drawn by seed."""
    generator = np.random.default_rng([seed, 22])
    low, size = world.room.corner_m, world.room.size_m[:2]
    while True:
        place = low + generator.uniform(0.0, 1.0, 2) * size
        if world.room.is_free(place[None], PLACED_M, 0.3)[0]:
            return np.asarray(place)


def _attacked(name: str, levels_db: Sequence[float], victim: Victim, mapped: Mapped) -> Numbers:
    numbers: Numbers = {}
    sound_of = SOUNDS["echoes of elsewhere, predicted" if name == REGULAR else name]
    for level_db in levels_db:
        audio = recorded(
            victim.walked, sound_of(victim, level_db), own_gain=OWN_GAIN.get(name, 1.0)
        )
        for mode in MODES:
            key = f"{name}|{level_db:g}|{mode.value}"
            found = _came_of_it(victim.walked, audio, victim.onset / RATE_HZ, mode, mapped)
            numbers |= {f"{key}|{measure}": value for measure, value in found.items()}
    return numbers


def _came_of_it(walk: Walked, audio: Audio, onset_s: float, mode: Mode, mapped: Mapped) -> Numbers:
    """How soon the attack was told, and how far fixes were off before, after and without that."""
    checked = _located(walk, audio, mode, mapped, Settings())
    credulous = _located(walk, audio, mode, mapped, credulous_settings())
    under = checked.t_s >= onset_s
    told = under & (checked.status == FixStatus.SUSPECT)
    first_s = float(checked.t_s[told][0]) if told.any() else np.inf
    off_m, loose_m = (_off_m(fixes, walk, mapped) for fixes in (checked, credulous))
    given = under & (checked.status == FixStatus.OK)
    loose = (credulous.t_s >= onset_s) & (credulous.status == FixStatus.OK)
    return {
        "delay": first_s - onset_s,
        "told": float(told.sum() / under.sum()),
        "refused": float((under & ~told & ~given).sum() / under.sum()),
        "wrong": float((given & (off_m > WRONG_M)).sum() / under.sum()),
        "off before": _most(off_m[given & (checked.t_s < first_s)]),
        "off": _most(off_m[given]),
        "wrong unchecked": float((loose & (loose_m > WRONG_M)).sum() / under.sum()),
        "off unchecked": _most(loose_m[loose]),
    }


def _located(walk: Walked, audio: Audio, mode: Mode, mapped: Mapped, known: Parameters) -> Fixes:
    recording = Recording(
        name="walk", device=walk.device.name, audio=audio, imu=walk.imu, played_t_s=walk.played_t_s
    )
    return locate(recording, _floor_map(mapped), shipped(), known, mode=mode)


def credulous_settings() -> Settings:
    """The settings with every check off."""
    known = Settings()
    trust = replace(known.trust, fewest_frames=600)
    return replace(known, trust=trust, track=replace(known.track, jump=3.0))


def _floor_map(mapped: Mapped) -> FloorMap:
    assert mapped.run.floor_map is not None
    return mapped.run.floor_map


def _off_m(fixes: Fixes, walk: Walked, mapped: Mapped) -> F64:
    """How far each fix (n) is from the truth; NaN where it has no position."""
    t_s = np.clip(fixes.t_s, walk.truth.t_s[0], walk.truth.t_s[-1])
    true = interpolate_poses(walk.truth.t_s, walk.truth.world_from_body, t_s)
    true_m = compose(inverse(world_from_map(mapped)), true)[:, :2]
    return np.asarray(np.linalg.norm(fixes.xy_m - true_m, axis=1))


def _most(off_m: F64) -> float:
    return float(np.nanmax(off_m, initial=0.0))


def _honest(world: World, place: Place) -> Iterator[tuple[str, Walked, Audio]]:
    for name in place.honest:
        walk = walked(world, place.seed + STRANGER, place.rounds, JITTER_S, HONEST[name])
        yield name, walk, recorded(walk)
    if place.honest:
        walk = walked(world, place.seed + STRANGER, place.rounds, JITTER_S)
        for count in NEIGHBOURS:
            places_m = [_standing_place(world, place.seed + 100 * k) for k in range(count)]
            added = chirping_neighbours(walk, np.array(places_m), place.seed)
            yield f"{count} other phones", walk, recorded(walk, added)


def _quiet(name: str, walk: Walked, audio: Audio, mapped: Mapped) -> Numbers:
    numbers: Numbers = {}
    for mode in MODES:
        fixes = _located(walk, audio, mode, mapped, Settings())
        suspect = fixes.status == FixStatus.SUSPECT
        key = f"honest|{name}|{mode.value}"
        numbers |= {
            f"{key}|alarms": float(_alarms(fixes.t_s, suspect)),
            f"{key}|hours": float(walk.truth.t_s[-1]) / 3600,
            f"{key}|told": float(suspect.mean()),
            f"{key}|answered": float((fixes.status == FixStatus.OK).mean()),
        }
    return numbers


def _alarms(t_s: F64, suspect: Bool) -> int:
    """How often it says SUSPECT anew."""
    at_s = t_s[suspect]
    return int(len(at_s) > 0) + int(np.sum(np.diff(at_s) > APART_S))
