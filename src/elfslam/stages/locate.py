"""One-shot localization (place recognition): a few echoes against a map, with a status.

A place is known again by the direction of the mean of its features, not by its length: the ESS,
which has the length in it, prefers spots whose own echoes agree with each other.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.fixes import NOWHERE, Fix, scored_fix
from elfslam.base.parameters import parameter
from elfslam.base.values import Features, Fixes, FixStatus, FloorMap, Payload

SHORTEST_PERIOD_S = 0.08
"""Echoes never come faster."""


@dataclass(frozen=True)
class LocateParameters:
    """How much sound makes a fix, and when none is given."""

    window_s: float = parameter(0.6, "s", "sound used for one fix", 0.1, 60.0)
    fewest_echoes: int = parameter(3, "", "fewer echoes in a window give NO_ECHO", 1, 600)
    unknown_below: float = parameter(
        0.6, "", "no spot more similar than this is UNKNOWN_PLACE", -1.0, 1.0
    )
    temperature: float = parameter(
        0.05, "", "softmax temperature: a spot's weight is exp(similarity / this)", 1e-4, 10.0
    )
    near_m: float = parameter(
        1.0, "m", "spots this close to the best count as the same place", 0.05, 100.0
    )
    ambiguous_below: float = parameter(
        0.8, "", "less belief near the best spot is AMBIGUOUS", 0.0, 1.0
    )
    sigma_floor_m: float = parameter(0.10, "m", "least error of a fix per axis", 0.0, 100.0)


def locate_one_shot(features: Features, floor_map: FloorMap, parameters: LocateParameters) -> Fixes:
    """A fix for every window of sound (consecutive, not overlapping).

    Raises InputError where the map was made with another encoder, ParameterError where no window
    can hold enough echoes.
    """
    if (parameters.fewest_echoes - 1) * SHORTEST_PERIOD_S > parameters.window_s:
        raise ParameterError(
            f"locate.fewest_echoes: wanted no more than {parameters.window_s:g} s (window_s) hold, "
            f"got {parameters.fewest_echoes}; set both"
        )
    payload = elf_payload(floor_map, features.encoder, features.vectors.shape[1])
    start_s, end_s = features.t_s[[0, -1]]
    count = int((end_s - start_s) / parameters.window_s) + 1
    edges = start_s + parameters.window_s * np.arange(count + 1)
    means = features.means_between(edges, parameters.fewest_echoes)
    middle_s = (edges[:-1] + edges[1:]) / 2
    return fixes_of(middle_s, spot_similarity(means, payload), floor_map, parameters)


def trusted_one_shot(
    features: Features,
    floor_map: FloorMap,
    parameters: LocateParameters,
    suspect: Callable[[F64], Bool],
) -> Fixes:
    """The same, SUSPECT where `suspect` says so of stretches (n-1) between times (n)."""
    fixes = locate_one_shot(features, floor_map, parameters)
    half_s = parameters.window_s / 2
    edges_s = np.append(fixes.t_s[:1] - half_s, fixes.t_s + half_s)
    return without_suspects(fixes, suspect(edges_s))


def fixes_of(t_s: F64, scores: F32, floor_map: FloorMap, parameters: LocateParameters) -> Fixes:
    """Fixes at times (n) by how similar each spot is then: scores (n, m), rows of NaN for silence.

    Belief over the spots falls exponentially with their similarity; the fix is its mean near the
    best spot and the covariance its spread there, plus the spot's own. Scores of any kind serve.
    """
    rows = [_fix(row, floor_map, parameters) for row in scores]
    xy, heading, covariance, score, status = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    return Fixes(t_s, xy, heading, covariance, score, status)


def without_suspects(fixes: Fixes, suspect: Bool) -> Fixes:
    """The fixes, SUSPECT and without a position where what they come from is `suspect` (n)."""
    kept = np.where(suspect, np.nan, 1.0)
    return Fixes(
        fixes.t_s, fixes.xy_m * kept[:, None], fixes.heading_rad * kept,
        fixes.covariance_m2 * kept[:, None, None], fixes.score,
        np.where(suspect, int(FixStatus.SUSPECT), fixes.status),
    )  # fmt: skip


def spot_similarity(means: F32, payload: Payload) -> F32:
    """Cosines (n, m) of mean features (n, d) with those of a map's spots; rows of NaN stay so."""
    return np.asarray(_directions(means) @ _directions(payload.vectors).T)


def _directions(vectors: F32) -> F32:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-9), np.float32)


def elf_payload(floor_map: FloorMap, encoder: str, size: int) -> Payload:
    """The ELFs of a map, if they were made by the same encoder and have as many numbers.

    Raises InputError.
    """
    payload = next((item for item in floor_map.payloads if item.kind == "elf"), None)
    if payload is None:
        raise InputError("map: it holds no echoes; map the place by elf first", argument="by")
    if payload.encoder != encoder:
        raise InputError(
            f"map: made with encoder {payload.encoder}, got echoes encoded by {encoder}; "
            "use the encoder.onnx that lies beside the map"
        )
    if len(payload.vectors) == 0 or payload.vectors.shape[1] != size:
        raise InputError(
            f"map: its ELFs have shape {payload.vectors.shape}, wanted some of "
            f"{size} numbers each; make the map again"
        )
    return payload


def _fix(scores: F32, floor_map: FloorMap, parameters: LocateParameters) -> Fix:
    if np.isnan(scores[int(np.argmax(scores))]):
        return *NOWHERE, np.nan, int(FixStatus.NO_ECHO)
    known = floor_map.xy_m, floor_map.heading_rad, floor_map.covariance_m2
    return scored_fix(scores, *known, parameters)
