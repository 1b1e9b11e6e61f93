"""Four rounds over 58 markers: does a footstep find itself again? The paper's section 5.3."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import Echoes, Odometry
from elfslam.baselines.generic import GenericEncoder
from elfslam.learn.parameters import ScratchParameters
from elfslam.stages.closure import echo_sequence_similarity
from elfslam.stages.feature import Encoder, spectrogram
from elfslam.world.phone import Poses, phone_axes
from elfslam.world.world_file import World, load_world
from studies.cached import extract_features
from studies.elf import shipped_and_generic
from studies.results import Record, mean_of
from studies.still_phone import BODY_M, HEIGHT_M, PITCH_RAD, hear_at, listener_in
from studies.study import Study, StudyContext

ROUNDS = 4
FOOTSTEP = 4
"""The one whose trace is drawn, counted from 0."""
SHOWN = (0, 30, 58)
"""Of the paper's figure of similarity: the second is elsewhere, the third at the first's marker."""
NEAR_STEPS = 3
"""Footsteps no farther from a return than this are neither returns nor elsewhere."""
BLOCK_STEPS = 8
"""Neighbouring footsteps are resampled together."""
SHIPPED = "ELF, shipped"
PSD = "PSD"
LEARNING = ScratchParameters()
"""For the encoder that knows nothing but this walk."""
ESS, TRACE = "ESS", f"ESS with footstep {FOOTSTEP}"
RETURNS, ELSEWHERE = "ESS at returns", "ESS elsewhere"
HIGHER, ON_TOP = "higher elsewhere (%)", "all three on top (%)"
PAPER = {
    (PSD, f"footsteps 0 and {SHOWN[1]}"): 0.42, (PSD, f"footsteps 0 and {SHOWN[2]}"): 0.40,
    (SHIPPED, f"footsteps 0 and {SHOWN[1]}"): 0.22, (SHIPPED, f"footsteps 0 and {SHOWN[2]}"): 0.61,
}  # fmt: skip
"""The paper's similarities of two pairs of footsteps, by feature."""


def measure_trace(
    context: StudyContext,
    *,
    encoders: Mapping[str, Encoder] | None = None,
    rounds: int = ROUNDS,
    learning: ScratchParameters = LEARNING,
) -> list[Record]:
    """By feature, how far the returns to a marker stand out of all other footsteps, and one trace.

    `encoders` are compared by name; by default the generic features, t-SNE, and ELFs without any
    learning, without pre-training and shipped.
    """
    context.announce("walking and learning this walk", None)
    nodes, echoes = walk_over_markers(load_world("lab"), rounds, np.random.default_rng(58))
    compared = encoders or all_encoders(echoes, learning)
    records: list[Record] = []
    for k, (name, encoder) in enumerate(compared.items()):
        context.announce(name, k / len(compared))
        similarity = echo_sequence_similarity(extract_features(echoes, encoder), nodes)
        records += _records(name, similarity.scores.astype(np.float64))
    footsteps = range(FOOTSTEP + MARKERS, rounds * MARKERS, MARKERS)
    return records + [
        Record("returns", TRACE, 1.0, world="lab", condition=str(footstep))
        for footstep in footsteps
    ]


def returns_of(scores: F64) -> dict[str, F64]:
    """What the similarity (n, n) of a walk says of each footstep (58) of its first round.

    Its mean at the same marker in the other rounds and elsewhere, the share of footsteps elsewhere
    that are more similar than its lowest return, and whether there is none (100 or 0 %).
    """
    first, every = np.arange(MARKERS)[:, None], np.arange(len(scores))[None]
    ahead = (every - first) % MARKERS
    back = (ahead == 0) & (every != first)
    elsewhere = np.minimum(ahead, MARKERS - ahead) > NEAR_STEPS
    own = scores[:MARKERS]
    lowest = np.where(back, own, np.inf).min(axis=1, keepdims=True)
    higher = (elsewhere & (own > lowest)).sum(axis=1) / elsewhere.sum(axis=1)
    return {
        RETURNS: np.asarray((own * back).sum(axis=1) / back.sum(axis=1)),
        ELSEWHERE: np.asarray((own * elsewhere).sum(axis=1) / elsewhere.sum(axis=1)),
        HIGHER: 100 * higher,
        ON_TOP: 100.0 * (higher == 0),
    }


def all_encoders(echoes: Echoes, learning: ScratchParameters) -> dict[str, Encoder]:
    """What is compared on a walk with these echoes, by name, in the order of the paper's figure."""
    known = shipped_and_generic()
    shipped = known.pop(SHIPPED)
    return {
        **known,
        "t-SNE": GenericEncoder("t-sne-of-this-walk", embedded),
        "ELF, random weights": learnt_on(echoes, replace(learning, steps=0)),
        "ELF without pre-training": learnt_on(echoes, learning),
        SHIPPED: shipped,
    }


def embedded(samples: F32, iterations: int = 1000) -> F32:
    """All log spectrograms in two dimensions (n, 2) about their centre, by t-SNE."""
    from sklearn.manifold import TSNE
    from threadpoolctl import threadpool_limits

    level = np.log(spectrogram(samples) + 1e-7).reshape(len(samples), -1)
    known = {"perplexity": 30, "init": "pca", "random_state": 0, "max_iter": iterations}
    with threadpool_limits(1):  # rounding depends on how many threads there are
        plane = TSNE(2, **known).fit_transform(level)
    return np.asarray(plane - plane.mean(axis=0), dtype=np.float32)


def learnt_on(echoes: Echoes, parameters: ScratchParameters) -> Encoder:
    """The compact encoder learnt on the echoes of one walk alone; without a step it is random."""
    from studies.paper_training import learnt_from_walk

    return learnt_from_walk(echoes, parameters, seed=0)


def _records(name: str, scores: F64) -> Iterator[Record]:
    """Means over the footsteps of the first round, by blocks of them, and the trace of one."""
    for metric, values in returns_of(scores).items():
        blocks = [values[k : k + BLOCK_STEPS].mean() for k in range(0, MARKERS, BLOCK_STEPS)]
        mean = mean_of(Record(name, metric, 0.0, world="lab"), blocks)
        yield replace(mean, value=float(values.mean()))
    for other in SHOWN[1:]:
        pair, value = f"footsteps {SHOWN[0]} and {other}", float(scores[SHOWN[0], other])
        yield Record(name, ESS, value, world="lab", condition=pair, paper=PAPER.get((name, pair)))
    for footstep, score in enumerate(scores[FOOTSTEP]):
        if footstep != FOOTSTEP:
            yield Record(
                name, TRACE, round(float(score), 3), world="lab",
                condition=str(footstep),
            )  # fmt: skip


# --- a walk over markers ---


MARKERS = 58
ROUTE_M = np.array([[0.66, 1.5], [10.46, 1.5], [10.46, 12.85], [0.66, 12.85]])
"""Round two islands of cubicles: 42.3 m, 0.73 m from marker to marker."""
SPEED_MPS = 5 / 3.6
PACE = 0.03
"""How much the time of a step varies, one standard deviation, as a share of it."""
FOOT_M = 0.03
FOOT_RAD = np.deg2rad(3.0)
"""How far the phone is off at each footstep, one standard deviation, in every direction."""
BOUNCE_M = 0.028
PERIOD_S = 0.1
INSTANT_S = 0.01


def walk_over_markers(
    world: World, rounds: int, generator: np.random.Generator
) -> tuple[Odometry, Echoes]:
    """The footsteps (58 per round, and the one that closes the last) and the echoes between."""
    markers = marker_poses()
    step_s = np.linalg.norm(np.diff(markers[:2, :2], axis=0)) / SPEED_MPS
    steps = rounds * MARKERS
    steps_s = np.cumsum(step_s * (1 + PACE * generator.standard_normal(steps)))
    footsteps_s = np.concatenate([[0.0], steps_s])
    held = _held_at_footsteps(markers, steps + 1, generator)
    t_s = np.arange(generator.uniform(0, PERIOD_S), footsteps_s[-1], PERIOD_S)
    samples = hear_at(listener_in(world.room), _poses(footsteps_s, held, t_s), generator)
    nodes = Odometry(footsteps_s, held[:, [0, 1, 3]], np.full((steps, 3), FOOT_M))
    return nodes, Echoes(t_s, samples, np.zeros((0, 2)))


def marker_poses() -> F64:
    """Markers (58, 3) evenly along the route, each with the way that the walker faces there."""
    closed = np.vstack([ROUTE_M, ROUTE_M[:1]])
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at_m = np.linspace(0.0, along_m[-1], MARKERS, endpoint=False)
    xy_m = np.column_stack([np.interp(at_m, along_m, closed[:, axis]) for axis in range(2)])
    ahead = np.roll(xy_m, -1, axis=0) - np.roll(xy_m, 1, axis=0)
    return np.column_stack([xy_m, np.arctan2(ahead[:, 1], ahead[:, 0])])


def _held_at_footsteps(markers: F64, count: int, generator: np.random.Generator) -> F64:
    """Where and how the phone is held at each footstep (n, 6): x, y, z, yaw, pitch and roll."""
    on = markers[np.arange(count) % MARKERS]
    still = np.tile([HEIGHT_M, 0.0, PITCH_RAD, 0.0], (count, 1))
    held = np.column_stack([on[:, :2], still])
    held[:, 3] = np.unwrap(on[:, 2])
    scatter = np.repeat([FOOT_M, FOOT_RAD], 3)
    return np.asarray(held + scatter * generator.standard_normal(held.shape))


def _poses(footsteps_s: F64, held: F64, t_s: F64) -> Poses:
    """The phone at each of the times, moving on from footstep to footstep."""

    def at(when_s: F64) -> F64:
        now = np.column_stack([np.interp(when_s, footsteps_s, column) for column in held.T])
        share = np.interp(when_s, footsteps_s, np.arange(len(footsteps_s)))
        now[:, 2] += BOUNCE_M * np.cos(2 * np.pi * share)
        return now

    now, moved = at(t_s), at(t_s + INSTANT_S) - at(t_s - INSTANT_S)
    return Poses(
        now[:, :3], phone_axes(*now[:, 3:].T), moved[:, :3] / (2 * INSTANT_S),
        np.full(len(t_s), BODY_M), np.zeros((len(t_s), 0, 2)),
    )  # fmt: skip


STUDY = Study(
    "Does a footstep find itself again by its echoes, and by which feature?",
    measure_trace, minutes=8, needs=("torch", "sklearn"),
    fast={"rounds": 2, "learning": ScratchParameters(steps=2, pairs=16, threads=1)},
)  # fmt: skip
