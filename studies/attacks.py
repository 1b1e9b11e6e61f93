"""Replay and spoofing of a phone that is located: what is detected, how soon, what moves a fix.

A query walk goes through a mapped place, and from some moment on an attacker plays at the phone.
Honest walks, with everything that a place may have but no attacker, give the false alarms.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import stats

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64, Bool
from elfslam.base.enums import Mode
from elfslam.base.geometry import compose, interpolate_poses, inverse
from elfslam.base.values import Audio, Fixes, FixStatus, Recording
from elfslam.slam.front_end import dead_reckoning_nodes, extract_query_echoes
from elfslam.slam.pipeline import footstep_similarity, locate_walk
from elfslam.stages.feature import extract_features
from elfslam.stages.locate import trusted_one_shot
from elfslam.stages.medium_access import MediumAccessParameters
from elfslam.stages.spoofing import nothing_suspect
from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import QUIET
from elfslam.world.simulate import World, load_world
from studies.attack_sounds import OWN_GAIN, SOUNDS, Victim, chirping_neighbours
from studies.attacked_walk import PLACED_M, RATE_HZ, Walked, recorded, walked
from studies.cached import SCENARIOS, shipped
from studies.located import MAPPING_ROUNDS, STRANGER, Mapped, mapped_walk, world_from_map
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext, finished

ROUNDS: Mapping[str, int] = {"living_room": 3, "office": 1}
"""Of the query walk: a minute or more."""
SEEDS = (0, 1, 2, 3, 4)
LEVELS_DB = (0.0, 10.0, 20.0)
JITTER_S, SOFTER_DB = MediumAccessParameters().jitter_s, MediumAccessParameters().softer_db
OTHER_WALK = 2000
"""Added to a seed: the walk that the attacker recorded."""
PREDICTED = "echoes of elsewhere, predicted"
REGULAR = f"{PREDICTED}, regular schedule"
"""Chirps at the same moment of each period: an attacker knows when the next one comes."""
APART_S = 5.0
"""Alarms closer than this are one."""
WRONG_M = 1.0
NEIGHBOURS: Mapping[str, int] = {"1 other phone": 1, "3 other phones": 3}
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
KINDS = (*HONEST, *NEIGHBOURS, *SOUNDS, REGULAR)
HONEST_WALK, ALL = "honest walk", "all but other phones"
MODES = {Mode.TRACK: "tracker", Mode.ONE_SHOT: "one-shot"}
DELAY = "delay (s)"
ALARMS = ("alarms", "hours")
Numbers = dict[str, float]


@dataclass(frozen=True)
class Task:
    """One attack at every level, or one kind of honest walk, in a place that was mapped."""

    world: str
    seed: int
    rounds: int
    what: str
    levels_db: tuple[float, ...] = LEVELS_DB
    mapping_rounds: int = MAPPING_ROUNDS


def measure_attacks(
    context: StudyContext,
    *,
    worlds: Mapping[str, int] = ROUNDS,
    seeds: Sequence[int] = SEEDS,
    levels_db: Sequence[float] = LEVELS_DB,
    kinds: Sequence[str] = KINDS,
    mapping_rounds: int = MAPPING_ROUNDS,
) -> list[Record]:
    """What came of every attack (the method) by level, and false alarms of honest walks."""
    tasks = [
        Task(world, seed, rounds, what, tuple(levels_db), mapping_rounds)
        for seed in seeds
        for world, rounds in worlds.items()
        for what in kinds
    ]
    of = Record("", world=" and ".join(worlds), scenario=SCENARIOS[QUIET.name],
                seeds=seeds_text(seeds))  # fmt: skip
    return list(summarised(finished(measured, tasks, context), of))


def measured(task: Task) -> list[Record]:
    """One task: by attack and level, or by kind of honest walk, each metric of either mode."""
    mapped = _mapped(task.world, task.seed, task.mapping_rounds)
    if task.what in HONEST or task.what in NEIGHBOURS:
        return _records(_honest(task, mapped), HONEST_WALK, task.what)
    victim = _victim(task.world, task.seed, task.rounds, 0.0 if task.what == REGULAR else JITTER_S)
    sound_of = SOUNDS[PREDICTED if task.what == REGULAR else task.what]
    own_gain = OWN_GAIN.get(task.what, 1.0)
    found: list[Record] = []
    for level_db in task.levels_db:
        sound = sound_of(victim, level_db)
        audio = recorded(victim.walked, sound, own_gain=own_gain, since=victim.onset)
        came_of_it = _came_of_it(victim, audio, mapped)
        found += _records(came_of_it, task.what, f"{level_db:g} dB")
    return found


def _records(by_mode: Mapping[str, Numbers], method: str, condition: str) -> list[Record]:
    return [
        Record(method, f"{name}, {mode}", value, condition=condition)
        for mode, numbers in by_mode.items()
        for name, value in numbers.items()
    ]


@lru_cache(maxsize=1)
def _mapped(world: str, seed: int, rounds: int) -> Mapped:
    return mapped_walk(load_world(world), seed, rounds)


@lru_cache(maxsize=2)
def _victim(world: str, seed: int, rounds: int, jitter_s: float) -> Victim:
    place = load_world(world)
    walk = walked(place, seed + STRANGER, rounds, jitter_s, Circumstances(softer_db=SOFTER_DB))
    other = walked(place, seed + OTHER_WALK, rounds, jitter_s)
    return Victim(walk, other, np.append(_free_place(place, seed), PLACED_M), seed)


def _free_place(world: World, seed: int) -> F64:
    """A free place (2) in the room for a loudspeaker."""
    generator = np.random.default_rng([seed, 22])
    low, size = world.room.corner_m, world.room.size_m[:2]
    while True:
        place = low + generator.uniform(0.0, 1.0, 2) * size
        if world.room.is_free(place[None], PLACED_M, 0.3)[0]:
            return np.asarray(place)


def _came_of_it(victim: Victim, audio: Audio, mapped: Mapped) -> dict[str, Numbers]:
    """By mode: how soon it was detected, how far fixes were off, with and without the checks."""
    checked, loose = _located(victim.walked, audio, mapped)
    onset_s = victim.onset / RATE_HZ
    numbers: dict[str, Numbers] = {}
    for mode, fixes in checked.items():
        off_m = _off_m(fixes, victim.walked, mapped)
        loose_m = _off_m(loose[mode], victim.walked, mapped)
        under = fixes.t_s >= onset_s
        told = under & (fixes.status == FixStatus.SUSPECT)
        given = under & (fixes.status == FixStatus.OK)
        believed = (loose[mode].t_s >= onset_s) & (loose[mode].status == FixStatus.OK)
        first_s = float(fixes.t_s[told][0]) if told.any() else np.inf
        share = 100 / under.sum()
        numbers[mode] = {
            DELAY: first_s - onset_s,
            "wrong fixes (%)": float(share * (given & (off_m > WRONG_M)).sum()),
            "wrong fixes, unchecked (%)": float(share * (believed & (loose_m > WRONG_M)).sum()),
        }
    return numbers


def _located(
    walk: Walked, audio: Audio, mapped: Mapped
) -> tuple[dict[str, Fixes], dict[str, Fixes]]:
    """Fixes of the tracker and in one shot from one and the same sound: checked, and believed."""
    known, floor_map = Settings(), mapped.run.floor_map
    assert floor_map is not None
    recording = Recording(
        name="walk", device=walk.device.name, audio=audio, imu=walk.imu,
        played_t_s=walk.played_t_s, gain_db=walk.gain_db,
    )  # fmt: skip
    echoes, suspicious = extract_query_echoes(recording, known)
    features = extract_features(echoes, shipped())
    nodes = dead_reckoning_nodes(recording, known)
    scores = footstep_similarity(features, nodes, floor_map, known.locate)
    credulous = replace(known, track=replace(known.track, jump=3.0))
    found = []
    for settings, suspect in ((known, suspicious), (credulous, nothing_suspect)):
        doubt = suspect(nodes.t_s)
        one_shot = trusted_one_shot(features, floor_map, settings.locate, suspect)
        track = locate_walk(nodes, scores, floor_map, settings, mode=Mode.TRACK, suspect=doubt)
        found.append({MODES[Mode.TRACK]: track, MODES[Mode.ONE_SHOT]: one_shot})
    return found[0], found[1]


def _off_m(fixes: Fixes, walk: Walked, mapped: Mapped) -> F64:
    """How far each fix (n) is from the truth; NaN where it has no position."""
    t_s = np.clip(fixes.t_s, walk.truth.t_s[0], walk.truth.t_s[-1])
    true = interpolate_poses(walk.truth.t_s, walk.truth.world_from_body, t_s)
    true_m = compose(inverse(world_from_map(mapped)), true)[:, :2]
    return np.asarray(np.linalg.norm(fixes.xy_m - true_m, axis=1))


def _honest(task: Task, mapped: Mapped) -> dict[str, Numbers]:
    """False alarms of one walk without an attacker, by mode."""
    world, today = load_world(task.world), HONEST.get(task.what, Circumstances())
    today = replace(today, softer_db=SOFTER_DB)
    walk = walked(world, task.seed + STRANGER, task.rounds, JITTER_S, today)
    places = range(NEIGHBOURS.get(task.what, 0))
    speakers_m = [_free_place(world, task.seed + 100 * (k + 1)) for k in places]
    added = chirping_neighbours(walk, speakers_m, task.seed) if speakers_m else None
    checked, _ = _located(walk, recorded(walk, added), mapped)
    numbers: dict[str, Numbers] = {}
    for mode, fixes in checked.items():
        numbers[mode] = {
            "alarms": float(_alarms(fixes.t_s, fixes.status == FixStatus.SUSPECT)),
            "hours": float(walk.truth.t_s[-1]) / 3600,
        }
    return numbers


def _alarms(t_s: F64, suspect: Bool) -> int:
    """How often it says SUSPECT anew."""
    at_s = t_s[suspect]
    return int(len(at_s) > 0) + int(np.sum(np.diff(at_s) > APART_S))


# --- all walks together ---


def summarised(walks: Iterable[Sequence[Record]], of: Record) -> Iterator[Record]:
    """Of attacks the shares of walks and fixes, of honest walks the alarms per hour."""
    found: dict[tuple[str, str, str], list[float]] = {}
    for each in (record for walk in walks for record in walk):
        found.setdefault((each.method, each.condition, each.metric), []).append(each.value)
    for mode in MODES.values():
        yield from _honest_records(found, mode, of)
    for (method, condition, metric), values in found.items():
        name, _, mode = metric.rpartition(", ")
        of_it = replace(of, method=method, condition=condition)
        if name in ALARMS:
            continue
        if name == DELAY:
            yield from _told(np.array(values), mode, of_it)
        else:
            yield replace(of_it, metric=metric, value=float(np.mean(values)))


def _told(delays_s: F64, mode: str, of: Record) -> Iterator[Record]:
    """How many walks were told, and within what time half of them were."""
    told = 100 * float(np.isfinite(delays_s).mean())
    yield replace(of, metric=f"attacks detected (%), {mode}", value=told)
    median_s = float(np.quantile(delays_s, 0.5, method="inverted_cdf"))
    if np.isfinite(median_s):
        yield replace(of, metric=f"median delay (s), {mode}", value=median_s)


def _honest_records(
    found: Mapping[tuple[str, str, str], Sequence[float]], mode: str, of: Record
) -> Iterator[Record]:
    kinds = [what for method, what, metric in found if metric == f"alarms, {mode}"]
    groups = {what: [what] for what in kinds}
    alone = [what for what in kinds if what not in NEIGHBOURS]
    for what, some in {**groups, ALL: alone}.items():
        alarms, hours = (
            sum(sum(found[HONEST_WALK, each, f"{name}, {mode}"]) for each in some)
            for name in ALARMS
        )
        if hours == 0:
            continue
        low, high = poisson_interval(int(alarms))
        yield replace(
            of, method=HONEST_WALK, condition=what, metric=f"false alarms (1/h), {mode}",
            value=alarms / hours, low=low / hours, high=high / hours,
        )  # fmt: skip


def poisson_interval(count: int) -> tuple[float, float]:
    """Between which expected counts a counted one lies with 95 % (exact, Garwood 1936)."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low), float(stats.chi2.ppf(0.975, 2 * count + 2) / 2)


STUDY = Study(
    "Which attacks on a phone that is located are detected, and which move its fix?",
    measure_attacks, minutes=27, long=True,
    fast={"worlds": {"studio": 1}, "seeds": (100,), "levels_db": (10.0,),
          "kinds": ("alone", "noise"), "mapping_rounds": 1},
)  # fmt: skip
