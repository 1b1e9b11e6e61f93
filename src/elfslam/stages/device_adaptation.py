"""Cross-device feature adaptation: what an unknown phone hears, as the map's phone would.

Phones differ by more than their response: one whose loudspeaker fires backward hears every room
from another side. The translation is linear on ELFs and learnt without any label from a walk of
the unknown phone: where it may have walked, given how people walk, says what each of its ELFs
should have been, and that says anew where it walked.
"""

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import Features, FloorMap


@dataclass(frozen=True)
class PhoneParameters:
    """How an unknown phone is matched to a map and translated."""

    window_s: float = parameter(0.6, "s", "sound that is matched at once", 0.1, 10.0)
    rounds: int = parameter(4, "", "of matching and translating", 1, 50)
    ridge: float = parameter(
        20.0, "echoes", "how many would have to contradict that phones are alike", 1e-3
    )
    candidates: int = parameter(300, "", "spots that a window may be at", 2)
    temperature: float = parameter(0.05, "", "softmax temperature of the ESS", 1e-3, 10.0)
    speed_mps: float = parameter(1.25, "m/s", "people walk up to this", 0.1, 5.0)
    speed_sigma_mps: float = parameter(0.33, "m/s", "and this much faster, one sigma", 0.01)
    jump: float = parameter(
        20.0, "nats", "most that a step costs, however far: the match may be wrong", 0.0
    )
    fewest_windows: int = parameter(20, "", "fewer tell nothing of a phone", 2)


def learn_phone(features: Features, floor_map: FloorMap, parameters: PhoneParameters) -> F32:
    """The translation (d, d) for a phone, from what it heard on a walk somewhere in the map.

    Needs a map that knows the place in several orientations or is superimposed, else the first
    match of a phone that hears another side may be wrong throughout. Raises InputError where the
    map holds no ELFs of this encoder or the walk is too short.
    """
    spots_m, spots = _known_spots(floor_map, features.encoder)
    window = _windows(features.t_s, parameters.window_s)
    if window[-1] + 1 < parameters.fewest_windows:
        raise InputError(
            f"phone: wanted {parameters.fewest_windows} windows of {parameters.window_s:g} s with "
            f"echoes, got {window[-1] + 1}; walk longer"
        )
    heard = np.asarray(features.vectors, dtype=np.float64)
    at_s = _means(features.t_s[:, None], window)[:, 0]
    size = parameters.ridge * np.eye(heard.shape[1])
    unit = spots / np.linalg.norm(spots, axis=1, keepdims=True)
    translation = np.eye(heard.shape[1])
    for _ in range(parameters.rounds):
        scores = _means(_unit(heard @ translation), window) @ spots.T
        wanted = unit[_walked(scores, spots_m, at_s, parameters)][window]
        translation = np.linalg.solve(heard.T @ heard + size, heard.T @ wanted + size)
    return np.asarray(translation, dtype=np.float32)


def to_map_domain(features: Features, translation: F32) -> Features:
    """The features of a phone as the map's phone would have had them."""
    vectors = _unit(np.asarray(features.vectors @ translation, dtype=np.float64))
    return replace(features, vectors=vectors.astype(np.float32))


def _known_spots(floor_map: FloorMap, encoder: str) -> tuple[F64, F64]:
    """Positions (m, 2) and ELFs (m, d) of the spots that have any."""
    for payload in floor_map.payloads:
        if payload.kind == "elf" and payload.encoder == encoder:
            known = payload.vectors.any(axis=1)
            if known.any():
                return floor_map.xy_m[known], payload.vectors[known].astype(np.float64)
    raise InputError(
        f"phone: the map holds no ELFs of encoder {encoder}; use the encoder of the map"
    )


def _walked(scores: F64, spots_m: F64, at_s: F64, parameters: PhoneParameters) -> I64:
    """The spot (k) of each window on the likeliest way a person walked (Viterbi's algorithm).

    `scores` (k, m) are similarities; each window may be at the spots most similar to it.
    """
    most = min(parameters.candidates, scores.shape[1])
    spot = np.argpartition(-scores, most - 1, axis=1)[:, :most]
    evidence = np.take_along_axis(scores, spot, axis=1) / parameters.temperature
    belief, before = evidence[0], np.zeros_like(spot)
    for k in range(1, len(spot)):
        away_m = np.linalg.norm(spots_m[spot[k - 1]][:, None] - spots_m[spot[k]], axis=2)
        apart_s = at_s[k] - at_s[k - 1]
        faster = np.maximum(away_m / apart_s - parameters.speed_mps, 0) / parameters.speed_sigma_mps
        reached = belief[:, None] - np.minimum(faster**2 / 2, parameters.jump)
        before[k] = reached.argmax(axis=0)
        belief = reached.max(axis=0) + evidence[k]
    way = np.zeros(len(spot), dtype=np.int64)
    way[-1] = belief.argmax()
    for k in range(len(spot) - 1, 0, -1):
        way[k - 1] = before[k, way[k]]
    return np.take_along_axis(spot, way[:, None], axis=1)[:, 0]


def _windows(t_s: F64, window_s: float) -> I64:
    """The window of each echo; those without echoes are not counted."""
    slot = np.floor((t_s - t_s[0]) / window_s + 1e-9).astype(np.int64)
    return np.unique(slot, return_inverse=True)[1].reshape(-1)


def _means(values: F64, window: I64) -> F64:
    sums = np.zeros((int(window[-1]) + 1, values.shape[1]))
    np.add.at(sums, window, values)
    return sums / np.bincount(window)[:, None]


def _unit(rows: F64) -> F64:
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12))
