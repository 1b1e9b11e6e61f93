"""How distinct echoes are from spot to spot: 128 spots of the lab, by chirp and by single tone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.line.feature import spectrogram
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.world_file import load_world
from studies.figures.clouds import clouds_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_range
from studies.still_phone import Listener, hear_at, held_still, listener_in

ECHOES = 40
"""At each spot, half of them to learn from and half to be recognised."""
SPOTS_SHOWN = 5
SIGNALS = {"chirp": "Chirp, 15 to 20 kHz", "tone": "Single tone"}
NOTE = "t-SNE of log spectrograms, 12 x 48; axes have no unit. Each dot is an echo."


@dataclass(frozen=True)
class Heard:
    """Log spectrograms (n, 576) of one signal and the spot (n) of each."""

    features: F64
    spot: I64


def measure_distinctness(given: Given, *, spots: int | None = None) -> Finding:
    """How often a spot is recognised among all, and the t-SNE picture of five in a row.

    After the paper, section 3. `spots` takes the first few alone.
    """
    world, rows, panels = load_world("lab"), [], []
    spots_m = world.spots_m[:spots]
    chosen = _row_of_spots(spots_m)
    for k, (signal, title) in enumerate(SIGNALS.items()):
        given.announce(f"{signal} at {len(spots_m)} spots", k / len(SIGNALS))
        heard = _hear(listener_in(world.room, signal=signal), spots_m)
        rows.append(_recognised(spots_m, signal, heard))
        panels.append(Panel(title, clouds_figure(_embedded(heard, chosen)), NOTE, wide=True))
    panels.append(Panel("All spots", rows_table(rows), wide=True))
    subtitle = f"{ECHOES} echoes at each spot of the simulated lab, phone held still"
    return Finding(rows, Page("Echoes of five spots, one metre apart", subtitle, panels))


def _hear(listener: Listener, spots_m: F64) -> Heard:
    """Echoes of a phone that is held still at every spot and heads the same way."""
    generator = np.random.default_rng(128)
    features = [
        _log_spectrogram(hear_at(listener, held_still(spot_m, ECHOES, generator), generator))
        for spot_m in spots_m
    ]
    return Heard(np.concatenate(features), np.repeat(np.arange(len(spots_m)), ECHOES))


def _log_spectrogram(samples: F32) -> F64:
    image = np.log(spectrogram(samples) + 1e-7)
    return np.asarray(image, dtype=np.float64).reshape(len(samples), -1)


def _recognised(spots_m: F64, signal: str, heard: Heard) -> Row:
    """The nearest of the learnt spots' means, for every echo that was not learnt from."""
    spots = len(spots_m)
    features = heard.features.reshape(spots, ECHOES, -1)
    means = features[:, : ECHOES // 2].mean(axis=1)
    asked = features[:, ECHOES // 2 :].reshape(spots * (ECHOES // 2), -1)
    square = (asked**2).sum(axis=1)[:, None] - 2 * asked @ means.T + (means**2).sum(axis=1)
    answer, truth = square.argmin(axis=1), np.repeat(np.arange(spots), ECHOES // 2)
    error_m = np.linalg.norm(spots_m[answer] - spots_m[truth], axis=1)
    right = (answer == truth).reshape(spots, -1).astype(np.float64)
    low, high = mean_range(right)
    return {
        "signal": signal,
        "spots": spots,
        "recognised": round(float(right.mean()), 3),
        "from": round(low, 3),
        "to": round(high, 3),
        "mean error (m)": round(float(error_m.mean()), 2),
    }


def _row_of_spots(spots_m: F64) -> I64:
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


def _embedded(heard: Heard, chosen: I64) -> dict[str, F64]:
    """The echoes of some spots in two dimensions, by t-SNE (van der Maaten and Hinton 2008)."""
    from sklearn.manifold import TSNE

    rows = np.isin(heard.spot, chosen)
    plane = TSNE(2, perplexity=20, init="pca", random_state=0).fit_transform(heard.features[rows])
    return {
        f"spot {k + 1}": np.asarray(plane[heard.spot[rows] == spot], dtype=np.float64)
        for k, spot in enumerate(chosen)
    }
