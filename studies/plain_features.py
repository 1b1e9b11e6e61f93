"""The ELF beside hand-made features in the same pipeline, each with thresholds of its own.

The thresholds were chosen in the development worlds: `python -m studies thresholds`.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import F32
from elfslam.base.values import ELF_SIZE, Echoes, Fixes, Recording, Run
from elfslam.baselines.generic import generic_encoders
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.feature import Encoder, load_encoder
from elfslam.stages.locate import LocateParameters, locate_one_shot
from elfslam.stages.track import TrackParameters
from studies.cached import extract_features

ELF, PLAIN, ROOT, LOG = "ELF", "plain spectrogram", "root spectrogram", "log spectrogram"
CLOSURE_THRESHOLDS: Mapping[str, float] = {ELF: 0.22, PLAIN: 0.1, ROOT: 0.1, LOG: 0.07}
ALWAYS = replace(LocateParameters(), unknown_below=-1.0, ambiguous_below=0.0)
"""No threshold: features are compared that need other ones."""


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """A walk mapped by one feature, to be asked by the same."""

    encoder: Encoder
    run: Run

    def asked(self, echoes: Echoes) -> Fixes:
        """Where the most similar spot of each window is, however little similar."""
        assert self.run.floor_map is not None
        features = extract_features(echoes, self.encoder)
        return locate_one_shot(features, self.run.floor_map, ALWAYS)


class ChanceEncoder:
    """Vectors that say nothing of the place: what everybody has to beat."""

    identity = "chance-1"
    still = 1.0
    successive = 0.0

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, 128) in directions drawn by the bytes of each trace."""
        drawn = [
            np.random.default_rng(zlib.crc32(row.tobytes())).standard_normal(ELF_SIZE)
            for row in samples
        ]
        rows = np.reshape(drawn, (len(samples), ELF_SIZE))
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


@cache
def compared_encoders() -> Mapping[str, Encoder]:
    """The shipped encoder and what it has to beat, by name."""
    plain = generic_encoders()
    return {
        ELF: load_encoder("compact"),
        PLAIN: plain["spectrogram without mean"],
        ROOT: plain["root spectrogram"],
        LOG: plain["log spectrogram"],
    }


def closing_by(feature: str, settings: Settings) -> ClosureParameters:
    """What counts as a loop closure by this feature.

    What a unit of its score is worth grows as its scores are small.
    """
    known, share = settings.closure, CLOSURE_THRESHOLDS[feature] / CLOSURE_THRESHOLDS[ELF]
    return replace(
        known, threshold=CLOSURE_THRESHOLDS[feature],
        score_evidence=known.score_evidence / share, sigma_fall=known.sigma_fall / share,
    )  # fmt: skip


def tracking_by(feature: str, settings: Settings) -> TrackParameters:
    """The particle filter by this feature: its scores as wide as its closure threshold is high.

    Every footstep is answered.
    """
    share, track = CLOSURE_THRESHOLDS[feature] / CLOSURE_THRESHOLDS[ELF], settings.track
    return replace(
        track, temperature=share * track.temperature, unexplained=share * track.unexplained,
        unknown_below=-1.0, ambiguous_below=0.0, jump=3.0,
    )  # fmt: skip


def feature_maps(recording: Recording, by_elf: Run, settings: Settings) -> dict[str, FeatureMap]:
    """The walk, which is mapped `by_elf` already, mapped by each of the compared features."""
    encoders = compared_encoders()
    maps = {ELF: FeatureMap(encoders[ELF], by_elf)}
    for name in (PLAIN, ROOT, LOG):
        own = replace(settings, closure=closing_by(name, settings))
        maps[name] = FeatureMap(encoders[name], map_by_echoes(recording, encoders[name], own))
    return maps
