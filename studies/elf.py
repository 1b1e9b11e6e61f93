"""Does a feature know a place again? Footsteps of different rounds, at one place or elsewhere."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elfslam.app.map import finetuned
from elfslam.app.settings import Settings
from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import interpolate_poses, wrap_angle
from elfslam.base.values import Echoes, Odometry, Truth, silent
from elfslam.baselines.generic import generic_encoders, principal_encoder
from elfslam.learn.parameters import FinetuneParameters, ScratchParameters
from elfslam.scoring.errors import interval
from elfslam.slam.front_end import dead_reckoning_nodes
from elfslam.stages.closure import ClosureParameters, echo_sequence_similarity
from elfslam.stages.feature import Encoder, load_encoder
from elfslam.world.echo_pairs import echo_pairs
from elfslam.world.kinds import QUIET, SURVEYOR, Kind
from elfslam.world.simulate import load_world
from studies.cached import SCENARIOS, extract_echoes, extract_features, simulate
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

SECOND_ENGINE = " by pyroomacoustics"
"""Behind the name of a world: its closed solids, controlled, rendered by the second engine."""
WORLDS = ("living_room", "office", "mall", "living_room" + SECOND_ENGINE)
SEEDS = (0, 1, 2)
ROUNDS = 4
SAME_M = 0.3
SAME_RAD = np.deg2rad(35.0)
ELSEWHERE_M = 1.0
SEQUENCE = 8
"""Footsteps compared in a row."""
PRINCIPAL_ECHOES = 2048
"""From random rooms, never from the worlds that are measured."""
UNITS = ("1 footstep", f"{SEQUENCE} footsteps")
SHIPPED = "ELF, shipped"

Adapt = Callable[[Echoes], Encoder]
"""An encoder made from the echoes of the walk that is measured, without labels."""
Counts = dict[tuple[str, str], list[F64]]
"""Histograms of each walk, by method and by what is compared."""


def measure_elf(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = ROUNDS,
    kind: Kind = SURVEYOR,
    encoders: Mapping[str, Encoder] | None = None,
    learning: bool = True,
) -> list[Record]:
    """How similarity tells the same place from elsewhere, by feature and length (the condition).

    `encoders` are compared by name; by default the generic features and the shipped encoder, and
    where `learning` it after fine-tuning, and one without pre-training, for each walk anew.
    """
    known = shipped_and_generic() if encoders is None else encoders
    compared: dict[str, Adapt] = {name: partial(_as_it_is, each) for name, each in known.items()}
    if encoders is None and learning:
        compared |= _learnt_from_the_walk()
    records: list[Record] = []
    for place, world in enumerate(worlds):
        counts: Counts = {}
        for k, seed in enumerate(seeds):
            share = (place + k / len(seeds)) / len(worlds)
            context.announce(f"{world}, walk {seed}", share)
            _measure_walk(world, seed, rounds, kind, compared, counts)
        scenario = SCENARIOS[QUIET.name if world.endswith(SECOND_ENGINE) else kind.name]
        for (method, unit), walks in counts.items():
            of = Record(method, world=world, scenario=scenario, condition=unit,
                        seeds=seeds_text(seeds))  # fmt: skip
            records += separation_records(walks, ClosureParameters().threshold, of)
    return records


def shipped_and_generic() -> dict[str, Encoder]:
    """Every generic feature and the shipped encoder, by name."""
    echoes = echo_pairs(np.random.default_rng([0, 17]), PRINCIPAL_ECHOES, 64).first
    return {
        **generic_encoders(),
        "principal components": principal_encoder(echoes),
        SHIPPED: load_encoder("compact"),
    }


def _learnt_from_the_walk() -> dict[str, Adapt]:
    """The encoders that learn each walk by itself, by name."""
    from studies.paper_training import learnt_from_walk

    shipped = load_encoder("compact")
    return {
        "ELF without pre-training": lambda echoes: learnt_from_walk(
            echoes, ScratchParameters(), seed=0
        ),
        "ELF fine-tuned": lambda echoes: (
            finetuned(shipped, echoes, FinetuneParameters(), 0, silent).encoder
        ),
    }


def _as_it_is(encoder: Encoder, echoes: Echoes) -> Encoder:
    return encoder


def _measure_walk(
    world: str, seed: int, rounds: int, kind: Kind, compared: Mapping[str, Adapt], counts: Counts
) -> None:
    """Append the histograms (2, 4000) of a walk to `counts`."""
    place, settings = load_world(world.removesuffix(SECOND_ENGINE)), Settings()
    today = kind.mapping(place.room)
    if world.endswith(SECOND_ENGINE):
        today = replace(QUIET.mapping(place.room), engine="pyroomacoustics")
    recording, truth = simulate(place, seed, rounds=rounds, walker=kind.walker, circumstances=today)
    nodes, echoes = dead_reckoning_nodes(recording, settings), extract_echoes(recording, settings)
    same, elsewhere = labelled_pairs(nodes, truth, rounds)
    for method, encoder_for in compared.items():
        single = _similarity(echoes, nodes, encoder_for(echoes))
        for unit, scores in zip(UNITS, (single, sequence_similarity(single)), strict=True):
            known = np.isfinite(scores)
            made = histograms(scores[same & known], scores[elsewhere & known])
            counts.setdefault((method, unit), []).append(made)


def labelled_pairs(nodes: Odometry, truth: Truth, rounds: int) -> tuple[Bool, Bool]:
    """Pairs (n-1, n-1) of footsteps at the same place, and elsewhere; each pair once.

    Both are of different rounds and half a lap of walking apart, so that no pair is of neighbours
    in time.
    """
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    poses = interpolate_poses(truth.t_s, truth.world_from_body, middle_s)
    laps = _walked_laps(truth, middle_s, rounds)
    distance_m = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    turn_rad = np.abs(wrap_angle(poses[:, None, 2] - poses[None, :, 2]))
    later = (laps[None] - laps[:, None] > 0.5) & (np.floor(laps)[None] != np.floor(laps)[:, None])
    same = later & (distance_m < SAME_M) & (turn_rad < SAME_RAD)
    return same, later & (distance_m > ELSEWHERE_M)


def sequence_similarity(scores: F32, length: int = SEQUENCE) -> F32:
    """Mean similarity (n, n) of the `length` footsteps about each two, NaN beyond the ends.

    The better of two: both walked the same way, or the second the other way round.
    """
    ahead = _diagonal_mean(scores, length)
    back = _diagonal_mean(scores[:, ::-1], length)[:, ::-1]
    return np.where(np.isfinite(ahead), np.fmax(ahead, back), ahead)


def _diagonal_mean(scores: F32, length: int) -> F32:
    count = len(scores) - length + 1
    made = np.full_like(scores, np.nan)
    if count > 0:
        middle = slice(length // 2, length // 2 + count)
        made[middle, middle] = sum(scores[k : k + count, k : k + count] for k in range(length))
    return made / np.float32(length)


def _similarity(echoes: Echoes, nodes: Odometry, encoder: Encoder) -> F32:
    """ESS between footsteps; NaN where a footstep has no echo."""
    features = extract_features(echoes, encoder)
    scores = echo_sequence_similarity(features, nodes).scores.copy()
    empty = np.histogram(features.t_s, nodes.t_s)[0] == 0
    scores[empty] = np.nan
    scores[:, empty] = np.nan
    return scores


def _walked_laps(truth: Truth, t_s: F64, rounds: int) -> F64:
    steps_m = np.linalg.norm(np.diff(truth.world_from_body[:, :2], axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    return np.asarray(np.interp(t_s, truth.t_s, rounds * walked_m / walked_m[-1]))


# --- separation of histograms ---


CELLS = 4000
EDGES = np.round(np.linspace(-1.0, 1.0, CELLS + 1), 6)
SAME, ELSEWHERE = 0, 1

Measure = Callable[[F64], float]
"""A figure of the histograms (2, 4000)."""


def histograms(same: F32 | F64, elsewhere: F32 | F64) -> F64:
    """Counts (2, 4000) of the similarities, in [-1, 1], of one place and of different places."""
    return np.stack(
        [np.histogram(np.clip(values, -1.0, 1.0), EDGES)[0] for values in (same, elsewhere)]
    ).astype(np.float64)


def area_under_curve(counts: F64) -> float:
    """Chance that a pair of one place is more similar than one of different places (2, cells).

    Pairs within a cell of 0.0005 count half (Hanley and McNeil 1982).
    """
    below = np.cumsum(counts[ELSEWHERE]) - counts[ELSEWHERE] / 2
    return float(counts[SAME] @ below / (counts[SAME].sum() * counts[ELSEWHERE].sum()))


def recall_at(counts: F64, false_positive_rate: float) -> float:
    """Share of same-place pairs found by the lowest threshold that keeps false positives so few."""
    found, false = shares_above(counts)
    return float(found[false <= false_positive_rate].max())


def shares_above(counts: F64) -> tuple[F64, F64]:
    """Shares (4001) of same-place pairs and of others at or above each threshold of `EDGES`."""
    above = np.cumsum(counts[:, ::-1], axis=1)[:, ::-1]
    shares = np.pad(above, ((0, 0), (0, 1))) / counts.sum(axis=1, keepdims=True)
    return shares[SAME], shares[ELSEWHERE]


def separation_records(walks: Sequence[F64], threshold: float, of: Record) -> list[Record]:
    """Measures of the pooled histograms (2, 4000) of walks, with 95 % intervals over walks.

    Raises InputError where no walk has a pair of both kinds.
    """
    walks = [counts for counts in walks if counts.sum(axis=1).all()]
    if not walks:
        raise InputError("separation: no walk comes back to a place; walk more rounds")
    stacked = [counts[None] for counts in walks]
    measures = {**MEASURES, **_at(threshold)}
    return [
        _record(of, metric, stacked, partial(_of_pooled, measure))
        for metric, measure in measures.items()
    ]


def _record(of: Record, metric: str, walks: Sequence[F64], measure: Measure) -> Record:
    low, high = interval(walks, measure, np.random.default_rng(0))
    value = measure(np.concatenate(walks))
    return replace(of, metric=metric, value=value, low=low, high=high)


def _at(threshold: float) -> Mapping[str, Measure]:
    """What a threshold keeps of both kinds of pairs."""
    at = int(np.searchsorted(EDGES, threshold))
    return {
        f"recall at {threshold:g}": lambda counts: float(shares_above(counts)[SAME][at]),
        f"false positives at {threshold:g}": (
            lambda counts: float(shares_above(counts)[ELSEWHERE][at])
        ),
    }


MEASURES: Mapping[str, Measure] = {
    "AUC": area_under_curve,
    "recall at 1 % false positives": partial(recall_at, false_positive_rate=0.01),
    "recall at 0.1 % false positives": partial(recall_at, false_positive_rate=0.001),
}


def _of_pooled(measure: Measure, walks: F64) -> float:
    """A measure of the sum of histograms (walks, 2, 4000)."""
    return measure(walks.sum(axis=0))


STUDY = Study(
    "How well does each feature know a place again in another round?",
    measure_elf, minutes=30, scenarios=("surveyor",), encoders=True,
    needs=("torch", "pyroomacoustics"),
    fast={"worlds": ("studio",), "seeds": (100,), "rounds": 2, "learning": False},
)  # fmt: skip
