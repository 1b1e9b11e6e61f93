"""A phone that the map never met: what both ways and a learnt translation are worth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elfslam.app.merge import drawn
from elfslam.app.settings import Settings
from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Features, FloorMap
from elfslam.stages.device_adaptation import PhoneParameters, learn_phone, to_map_domain
from elfslam.stages.feature import OnnxEncoder, load_encoder, walk_vectors
from elfslam.stages.floormap import SpotEchoes, floor_spots, superimposed_map
from elfslam.world.kinds import ASKING_PHONE, SURVEYOR, Kind, kind_named
from elfslam.world.simulate import load_world
from studies.cached import extract_echoes, record_of, simulate
from studies.floor_spots import SPACING_M, TOGETHER, fixes_m
from studies.located import GROSS_M, MEDIAN_M, OVER_1_M
from studies.opposite_ways import walking
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

WORLDS = ("studio", "lounge")
SEEDS = (110, 111, 112, 113)
PHONES = (ASKING_PHONE, "cheap", "bottom-fired")
BACK, ASKER, LEARNER = 700, 500, 600
"""Added to the seed of a map for who walks back, who is located, and for the phone's own walk."""
MEAN_M = "mean error (m)"


@dataclass(frozen=True)
class Place:
    """A room mapped both ways round by one phone, in which each other is heard days later."""

    world: str
    seed: int
    kind: str
    phones: tuple[str, ...] = PHONES
    rounds: int = 4
    learner_rounds: int = 3
    steps: int = 200


@dataclass(frozen=True, eq=False)
class PhoneWalk:
    """Echoes (n, 2352) of a walk, when (n) they were heard and at which poses (n, 3)."""

    t_s: F64
    samples: F32
    poses: F64


def measure_unknown_phone(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    phones: Sequence[str] = PHONES,
    rounds: int = 4,
    steps: int = 200,
    kind: Kind = SURVEYOR,
) -> list[Record]:
    """One-shot errors of each phone by map and by what is done about it."""
    folder = (context.kept or Path("unknown-phone.partial")).parent
    tasks = [
        Place(world, seed, kind.name, tuple(phones), rounds, min(rounds, 3), steps)
        for seed in seeds
        for world in worlds
    ]
    measure = partial(measure_place, folder=folder)
    return averaged(finished(measure, tasks, context), seeds)


def measure_place(task: Place, folder: Path) -> list[Record]:
    """Errors of each phone (the condition) by map and by what was done about the phone."""
    there = _walk(task, task.seed, task.rounds)
    back = _walk(task, task.seed + BACK, task.rounds, reverse=True)
    maps = list(_maps(task, [there, back], folder))
    records: list[Record] = []
    for phone in task.phones:
        asked = _walk(task, task.seed + ASKER, 1, phone=phone)
        own = _walk(task, task.seed + LEARNER, task.learner_rounds, phone=phone)
        for name, encoder, floor_map in maps:
            for done, features in _heard(encoder, floor_map, asked, own):
                error_m = np.linalg.norm(_fixes(features, floor_map) - _middles(asked), axis=1)
                of = record_of(task, f"{name}, {done}", phone)
                records += of.each({
                    MEDIAN_M: np.median(error_m), MEAN_M: error_m.mean(),
                    OVER_1_M: (error_m > GROSS_M).mean(),
                })  # fmt: skip
    return records


def _heard(
    encoder: OnnxEncoder, floor_map: FloorMap, asked: PhoneWalk, own: PhoneWalk
) -> Iterator[tuple[str, Features]]:
    """The features of who is located: as they are, and translated."""
    plain = _features(encoder, asked)
    yield "as it is", plain
    translation = learn_phone(_features(encoder, own), floor_map, PhoneParameters())
    yield "translated", to_map_domain(plain, translation)


def _maps(
    task: Place, walks: Sequence[PhoneWalk], folder: Path
) -> Iterator[tuple[str, OnnxEncoder, FloorMap]]:
    """One walk with the shipped encoder, and both superimposed; all placed truly."""
    from elfslam.learn.floor_level import floor_elfs, learn_floor
    from elfslam.learn.parameters import FloorLevelParameters

    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    every = [SpotEchoes(walk.samples, walk.poses[:, :2], walk.poses[:, 2]) for walk in walks]

    parameters = FloorLevelParameters(steps=task.steps)

    def mapped(encoder: OnnxEncoder, heard: Sequence[SpotEchoes]) -> FloorMap:
        spots_m = floor_spots(np.vstack([each.xy_m for each in heard]), SPACING_M)
        vectors = floor_elfs(encoder, spots_m, heard)
        return superimposed_map(
            spots_m, vectors, encoder.identity, spacing_m=SPACING_M, sources=(task.world,)
        )

    checkpoint = folder / f"phones-{task.world}-{task.seed}.checkpoint"
    spots_m = floor_spots(np.vstack([each.xy_m for each in every]), SPACING_M)
    learnt = learn_floor(
        shipped, spots_m, lambda step: drawn(every, parameters, task.seed, step), parameters,
        seed=task.seed, checkpoint=checkpoint,
    ).encoder  # fmt: skip
    checkpoint.unlink()
    yield "one way", shipped, mapped(shipped, every[:1])
    yield "superimposed", learnt, mapped(learnt, every)


def _walk(
    task: Place, seed: int, rounds: int, *, phone: str | None = None, reverse: bool = False
) -> PhoneWalk:
    """One of those who map, or one who comes later with a phone."""
    world, kind = load_world(task.world), kind_named(task.kind)
    today = kind.mapping(world.room)
    if phone is not None:
        today = replace(kind.asking(world.room), device=phone)
    recording, truth = simulate(
        world, seed, rounds=rounds, reverse=reverse, walker=kind.walker, circumstances=today
    )
    echoes = extract_echoes(recording, Settings())
    rows = walking(truth, echoes.t_s)
    poses = interpolate_poses(truth.t_s, truth.world_from_body, echoes.t_s[rows])
    return PhoneWalk(echoes.t_s[rows], echoes.samples[rows], poses)


def _features(encoder: OnnxEncoder, walk: PhoneWalk) -> Features:
    return Features(walk.t_s, walk_vectors(walk.samples, encoder), encoder.identity)


def _fixes(features: Features, floor_map: FloorMap) -> F64:
    whole = len(features.vectors) // TOGETHER * TOGETHER
    spots = floor_map.payloads[0].vectors
    return fixes_m(features.vectors[:whole], spots, floor_map.xy_m)


def _middles(walk: PhoneWalk) -> F64:
    whole = len(walk.poses) // TOGETHER * TOGETHER
    middles: F64 = walk.poses[:whole, :2].reshape(-1, TOGETHER, 2).mean(axis=1)
    return middles


STUDY = Study(
    "What helps a phone that nobody mapped with?",
    measure_unknown_phone, minutes=8, long=True, scenarios=("surveyor",),
    needs=("torch",),
    fast={"worlds": ("studio",), "seeds": (110,), "phones": ("bottom-fired",), "rounds": 1,
          "steps": 10},
)  # fmt: skip
