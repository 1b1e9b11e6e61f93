"""Four rounds over 58 markers: does a footstep find itself again? The paper's section 5.3."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import Echoes
from elfslam.baselines.generic import GenericEncoder
from elfslam.learn.parameters import ScratchParameters
from elfslam.stages.closure import echo_sequence_similarity
from elfslam.stages.feature import Encoder, spectrogram
from elfslam.world.world_file import load_world
from studies.cached import extract_features
from studies.elf import shipped_and_generic
from studies.marked_walk import MARKERS, walk_over_markers
from studies.results import Record, mean_of
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


STUDY = Study(
    "Does a footstep find itself again by its echoes, and by which feature?",
    measure_trace, minutes=8, needs=("torch", "sklearn"),
    fast={"rounds": 2, "learning": ScratchParameters(steps=2, pairs=16, threads=1)},
)  # fmt: skip
