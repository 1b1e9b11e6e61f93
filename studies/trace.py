"""Four rounds over 58 markers: does a footstep find itself again? The paper's section 5.3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elfslam.app.anchor import floor_plan
from elfslam.base.arrays import F32, F64
from elfslam.base.values import Echoes, Odometry
from elfslam.baselines.generic import GenericEncoder
from elfslam.learn.parameters import ScratchParameters
from elfslam.line.feature import Encoder, extract_features, spectrogram
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.scoring.figures import SLAM, floor_traces, plan, walk_traces
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.room import Room
from elfslam.world.world_file import load_world
from studies.elf import shipped_and_generic
from studies.figures.curves import traces_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_range
from studies.marked_walk import MARKERS, walk_over_markers

ROUNDS = 4
FOOTSTEP = 4
"""The one whose traces are drawn, counted from 0."""
NEAR_STEPS = 3
"""Footsteps no farther from a return than this are neither returns nor elsewhere."""
BLOCK_STEPS = 8
"""Neighbouring footsteps are resampled together."""
SHIPPED = "ELF, shipped"
LEARNING = ScratchParameters()
"""For the encoder that knows nothing but this walk."""
NOTE = (
    f"ESS of footstep {FOOTSTEP} of the first round and every footstep of the walk. t-SNE is "
    "fitted on this very walk, since it has no place for new echoes."
)
ROWS_NOTE = (
    "Returns: the same marker in the other rounds. Elsewhere: more than "
    f"{NEAR_STEPS} footsteps from any of them. Higher elsewhere: the share of those that are more "
    f"similar than the lowest return. Intervals: 95 %, by blocks of {BLOCK_STEPS} footsteps."
)


def measure_trace(
    given: Given, *, encoders: Mapping[str, Encoder] | None = None, rounds: int = ROUNDS
) -> Finding:
    """A row per feature: how far the returns to a marker stand out of all other footsteps.

    `encoders` are compared by name; by default the generic features, t-SNE, and ELFs without any
    learning, without pre-training and shipped.
    """
    given.announce("walking", None)
    world = load_world("lab")
    nodes, echoes = walk_over_markers(world, rounds, np.random.default_rng(58))
    given.announce("learning this walk", None)
    compared = all_encoders(echoes) if encoders is None else encoders
    scores: dict[str, F64] = {}
    for k, (name, encoder) in enumerate(compared.items()):
        given.announce(name, k / len(compared))
        similarity = echo_sequence_similarity(extract_features(echoes, encoder), nodes)
        scores[name] = similarity.scores.astype(np.float64)
    rows = [_row(name, each) for name, each in scores.items()]
    return Finding(rows, _page(rows, scores, world.room, nodes))


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
        "returns": np.asarray((own * back).sum(axis=1) / back.sum(axis=1)),
        "elsewhere": np.asarray((own * elsewhere).sum(axis=1) / elsewhere.sum(axis=1)),
        "higher elsewhere (%)": 100 * higher,
        "all three on top (%)": 100.0 * (higher == 0),
    }


def all_encoders(echoes: Echoes) -> dict[str, Encoder]:
    """What is compared on a walk with these echoes, by name, in the order of the paper's figure."""
    known = shipped_and_generic()
    shipped = known.pop(SHIPPED)
    return {
        **known,
        "t-SNE": GenericEncoder("t-sne-of-this-walk", embedded),
        "ELF, random weights": learnt_on(echoes, replace(LEARNING, steps=0)),
        "ELF without pre-training": learnt_on(echoes, LEARNING),
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


def _row(name: str, scores: F64) -> Row:
    """Means over the footsteps of the first round; intervals by resampling blocks of them."""
    row: Row = {"feature": name}
    for measure, values in returns_of(scores).items():
        row[measure] = round(float(values.mean()), 3)
        if measure.endswith("(%)"):
            blocks = [values[k : k + BLOCK_STEPS] for k in range(0, MARKERS, BLOCK_STEPS)]
            low, high = mean_range(blocks)
            row[measure.replace(" (%)", ", 95 %")] = f"{low:.1f} to {high:.1f}"
    return row


def _page(rows: list[Row], scores: Mapping[str, F64], room: Room, nodes: Odometry) -> Page:
    traces = {name: each[FOOTSTEP] for name, each in scores.items()}
    footsteps = len(next(iter(traces.values())))
    returns = np.arange(FOOTSTEP + MARKERS, footsteps, MARKERS)
    walked = walk_traces(nodes.world_from_body[:, :2], "footsteps", SLAM)
    drawn = plan([*floor_traces(floor_plan(room)), *walked])
    panels = [
        Panel("ESS traces", traces_figure(traces, FOOTSTEP, returns), NOTE, wide=True),
        Panel("Every footstep of the first round", rows_table(rows), ROWS_NOTE, wide=True),
        Panel("The walk", drawn, "Its footsteps in all rounds, seen from above.", wide=True),
    ]
    rounds = footsteps // MARKERS
    subtitle = f"{rounds} rounds over the same {MARKERS} markers in the simulated lab"
    return Page("Does a footstep find itself again?", subtitle, panels)
