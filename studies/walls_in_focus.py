"""Pictures of how sound measures steps: walls come into focus, and ranges change with the walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, Chirp, Echoes, Odometry
from elfslam.line.acoustic_odometry import (
    SAMPLES_PER_BIN,
    AcousticOdometryParameters,
    ScaleEvidence,
    loudness,
    scale_evidence,
    windows,
)
from elfslam.scoring.page import Panel
from studies.figures.scale_figures import Picture, bundles_figure, pictures_figure
from studies.heard_walk import Heard, hear_walk, true_scale
from studies.simulated_walk import SimulatedWalk

DIRECTIONS = 120
FIRST_S = DISCARDED_SAMPLES / ECHO_RATE_HZ
APART = 3
"""Chirps from one to the other of two frames that are compared."""
RATIOS = np.linspace(-1.6, 1.6, 161)
LEAST_MOVE_M = 0.2
SHOWN_ROUNDS = 3
SHOWN_SEEDS = 4
"""Walks shown of each world."""
STEPS = {"steps 15 % too short": 0.85, "true steps": 1.0, "steps 15 % too long": 1.15}

FOCUS_NOTE = (
    "Six seconds of one walk. The frames are added up along the delays that a wall at each "
    "direction and distance would give. Walls are spots, bright where the steps have the true "
    "length and smeared where they do not."
)
SHARPNESS_NOTE = (
    "Each line is a walk, its best is 1. They are sharpest about where the scale is true."
)
CHANGES_NOTE = (
    "How alike frames 0.3 s apart are when one is put back. No path changes by more than the move, "
    "there and back, so likeness falls off at the dotted lines, blurred by the 7 cm that the band "
    "resolves. Where it falls depends on the room, so that this alone does not measure steps."
)


def focus_panel(walk: SimulatedWalk) -> Panel:
    """Walls in the sharpest window of a walk, with steps too short, true and too long."""
    heard = hear_walk(walk)
    true = true_scale(heard.nodes, heard.truth)
    sharpness = _evidence(heard).sharpness
    best = int(np.argmax(sharpness.max(axis=1) - np.median(sharpness, axis=1)))
    pictures = {
        name: picture(heard.echoes, heard.nodes, heard.chirp, factor * true, best)
        for name, factor in STEPS.items()
    }
    return Panel("Walls in and out of focus", pictures_figure(pictures), FOCUS_NOTE, wide=True)


def walks_panels(walks: Sequence[SimulatedWalk]) -> tuple[Panel, Panel]:
    """Sharpness against scale, and what pairs of frames tell: a line for each of a few walks."""
    sharpness: dict[str, list[tuple[F64, F64]]] = {}
    changes: dict[str, list[tuple[F64, F64]]] = {}
    for walk in _first_of_each(walks):
        heard = hear_walk(walk)
        true = true_scale(heard.nodes, heard.truth)
        sharpness.setdefault(walk.world, []).append(_sharpness(heard, true))
        alike = range_changes(heard.echoes, heard.nodes, heard.chirp, true)
        changes.setdefault(walk.world, []).append((RATIOS, alike))
    scales = bundles_figure(sharpness, "trial scale over the true one", "sharpness", [1.0])
    pairs = bundles_figure(changes, "change of range over the true move", "likeness", [-1, 1])
    return (
        Panel("Sharpness of the walls at every scale", scales, SHARPNESS_NOTE),
        Panel("What two frames alone tell", pairs, CHANGES_NOTE, wide=True),
    )


def _first_of_each(walks: Sequence[SimulatedWalk]) -> list[SimulatedWalk]:
    by_world: dict[str, list[SimulatedWalk]] = {}
    for walk in walks:
        by_world.setdefault(walk.world, []).append(replace(walk, rounds=SHOWN_ROUNDS))
    return [walk for some in by_world.values() for walk in some[:SHOWN_SEEDS]]


def _sharpness(heard: Heard, true: float) -> tuple[F64, F64]:
    found = _evidence(heard)
    overall = found.sharpness.mean(axis=0)
    return found.scales / true, np.exp(overall - overall.max())


def _evidence(heard: Heard) -> ScaleEvidence:
    parameters = AcousticOdometryParameters()
    return scale_evidence(heard.echoes, heard.nodes, heard.chirp, parameters)


def picture(echoes: Echoes, odometry: Odometry, chirp: Chirp, scale: float, which: int) -> Picture:
    """Walls by direction and distance as the frames of one window pile up at this scale."""
    parameters = AcousticOdometryParameters()
    bin_m = parameters.sound_mps / ECHO_RATE_HZ * SAMPLES_PER_BIN / 2
    rows, moves_m = list(windows(echoes.t_s + parameters.ahead_s, odometry, parameters))[which]
    loud = loudness(echoes.samples[rows], chirp)
    angle = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    nearer = scale * moves_m @ np.stack([np.cos(angle), np.sin(angle)]) / bin_m
    strength = [_piled(loud, bins) for bins in np.rint(nearer.T).astype(np.int64)]
    first_m = FIRST_S * parameters.sound_mps / 2
    distance_m = np.asarray(first_m + bin_m * np.arange(loud.shape[1]), np.float64)
    return Picture(angle, distance_m, np.array(strength, np.float32))


def _piled(loud: F32, nearer: I64) -> F64:
    """Mean of the frames (n, bins), each put back by as many bins as the wall came nearer."""
    count, bins = loud.shape
    piled, held = np.zeros(bins), np.full(bins, 1e-9)
    for row, by in zip(loud, nearer, strict=True):
        to, of = slice(max(by, 0), bins + min(by, 0)), slice(max(-by, 0), bins - max(by, 0))
        piled[to] += row[of]
        held[to] += 1
    return np.where(held > count / 3, piled / held, 0.0)


def range_changes(echoes: Echoes, odometry: Odometry, chirp: Chirp, scale: float) -> F64:
    """How alike two frames are (161) when one is put back by RATIOS times their true move.

    A wall straight ahead comes nearer by the whole move, at -1; one behind goes away, at 1.
    """
    parameters = AcousticOdometryParameters()
    bin_m = parameters.sound_mps / ECHO_RATE_HZ * SAMPLES_PER_BIN / 2
    alike = np.zeros(len(RATIOS))
    for rows, moves_m in windows(echoes.t_s + parameters.ahead_s, odometry, parameters):
        spectra = np.fft.rfft(loudness(echoes.samples[rows], chirp), 2048, axis=1)
        lagged = np.fft.irfft(np.conj(spectra[:-APART]) * spectra[APART:], axis=1)
        moved_m = scale * np.linalg.norm(moves_m[APART:] - moves_m[:-APART], axis=1)
        lags = np.arange(-256, 256)
        for row, far_m in zip(lagged[:, lags], moved_m, strict=True):
            if far_m > LEAST_MOVE_M:
                alike += np.interp(RATIOS * far_m / bin_m, lags, row)
    return alike / max(float(alike.max()), 1e-9)
