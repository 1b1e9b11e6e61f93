"""How distinct echoes are from spot to spot: 128 spots of the lab, by chirp and by single tone."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.stages.feature import spectrogram
from elfslam.world.world_file import load_world
from studies.results import Record, mean_of
from studies.still_phone import Listener, hear_at, held_still, listener_in
from studies.study import Study, StudyContext

ECHOES = 40
"""At each spot, half of them to learn from and half to be recognised."""
SPOTS_SHOWN = 5
CHIRP, TONE = "chirp", "single tone"
SIGNALS = {CHIRP: "chirp", TONE: "tone"}
"""By name, as the simulated phone knows them."""
RECOGNISED, MEAN_M = "recognised", "mean error (m)"
TSNE_1, TSNE_2 = "t-SNE, first axis", "t-SNE, second axis"


@dataclass(frozen=True)
class Spectrograms:
    """Log spectrograms (n, 576) of one signal and the spot (n) of each."""

    features: F64
    spot: I64


def measure_distinctness(context: StudyContext, *, spots: int | None = None) -> list[Record]:
    """How often a spot is recognised among all, and where t-SNE puts the echoes of five in a row.

    After the paper, section 4.1. `spots` takes the first few alone.
    """
    spots_m, records = load_world("lab").spots_m[:spots], list[Record]()
    chosen = row_of_spots(spots_m)
    for k, (signal, known_as) in enumerate(SIGNALS.items()):
        context.announce(f"{signal} at {len(spots_m)} spots", k / len(SIGNALS))
        echoes = _spectrograms(listener_in(load_world("lab").room, signal=known_as), spots_m)
        records += [*_recognised(spots_m, signal, echoes), *_embedded(signal, echoes, chosen)]
    return records


def _spectrograms(listener: Listener, spots_m: F64) -> Spectrograms:
    """Echoes of a phone that is held still at every spot and heads the same way."""
    generator = np.random.default_rng(128)
    features = [
        log_spectrograms(hear_at(listener, held_still(spot_m, ECHOES, generator), generator))
        for spot_m in spots_m
    ]
    return Spectrograms(np.concatenate(features), np.repeat(np.arange(len(spots_m)), ECHOES))


def log_spectrograms(samples: F32) -> F64:
    """Spectrograms (n, 576) of echoes (n, 2352), in logarithms."""
    image = np.log(spectrogram(samples) + 1e-7)
    return np.asarray(image, dtype=np.float64).reshape(len(samples), -1)


def _recognised(spots_m: F64, signal: str, echoes: Spectrograms) -> list[Record]:
    """The nearest of the learnt spots' means, for every echo that was not learnt from."""
    spots = len(spots_m)
    features = echoes.features.reshape(spots, ECHOES, -1)
    means = features[:, : ECHOES // 2].mean(axis=1)
    queries = features[:, ECHOES // 2 :].reshape(spots * (ECHOES // 2), -1)
    square = (queries**2).sum(axis=1)[:, None] - 2 * queries @ means.T + (means**2).sum(axis=1)
    answer, truth = square.argmin(axis=1), np.repeat(np.arange(spots), ECHOES // 2)
    error_m = np.linalg.norm(spots_m[answer] - spots_m[truth], axis=1)
    of = partial(Record, method=signal, value=0.0, world="lab", condition=f"{spots} spots")
    return [
        mean_of(of(metric=metric), values.reshape(spots, -1).mean(axis=1))
        for metric, values in ((RECOGNISED, 1.0 * (answer == truth)), (MEAN_M, error_m))
    ]


def row_of_spots(spots_m: F64) -> I64:
    """Five spots in a line, about a metre from each to the next."""
    best, found = np.inf, np.arange(SPOTS_SHOWN)
    for k in range(len(spots_m)):
        for axis in range(2):
            wanted = spots_m[k] + np.eye(2)[axis] * np.arange(SPOTS_SHOWN)[:, None]
            distance = np.linalg.norm(spots_m[None] - wanted[:, None], axis=2)
            worst = float(distance.min(axis=1).max())
            if worst < best - 1e-9 and len(set(distance.argmin(axis=1))) == SPOTS_SHOWN:
                best, found = worst, distance.argmin(axis=1)
    return found


def _embedded(signal: str, echoes: Spectrograms, chosen: Sequence[int] | I64) -> list[Record]:
    """The echoes of some spots in two dimensions, by t-SNE (van der Maaten and Hinton 2008)."""
    from sklearn.manifold import TSNE
    from threadpoolctl import threadpool_limits

    rows = np.flatnonzero(np.isin(echoes.spot, chosen))
    with threadpool_limits(1):  # rounding depends on how many threads there are
        plane = TSNE(2, perplexity=20, init="pca", random_state=0).fit_transform(
            echoes.features[rows]
        )
    place = {int(spot): k + 1 for k, spot in enumerate(chosen)}
    return [
        Record(signal, metric, round(float(at), 2),
               condition=f"spot {place[int(echoes.spot[row])]}, echo {row % ECHOES + 1}")
        for row, point in zip(rows, plane, strict=True)
        for metric, at in zip((TSNE_1, TSNE_2), point, strict=True)
    ]  # fmt: skip


STUDY = Study(
    "How well is a spot recognised by its echo, and is a chirp better than a tone?",
    measure_distinctness, minutes=3, needs=("sklearn",), fast={"spots": 10},
)  # fmt: skip
