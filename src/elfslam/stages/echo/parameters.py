"""How the direct arrival is recognised, and what is refused."""

from __future__ import annotations

from dataclasses import dataclass

from elfslam.base.parameters import parameter


@dataclass(frozen=True)
class EchoParameters:
    """How the direct arrival is recognised, and what is refused."""

    minimum_duration_s: float = parameter(
        2.0, "s", "shorter audio is refused", low=0.2, high=3600.0
    )
    contrast: float = parameter(
        8.0, "", "direct arrival over the frame's median envelope", low=1.0, high=1000.0
    )
    level_share: float = parameter(
        0.35, "", "direct arrival over its typical level", low=0.01, high=1.0
    )
    jump_share: float = parameter(
        0.2, "", "more jumps than this per chirp mean another rate or period", low=0.0, high=1.0
    )
    early_share: float = parameter(
        0.5, "", "an earlier peak this strong is the direct one", low=0.01, high=1.0
    )
    early_s: float = parameter(
        0.0015, "s", "how far before the strongest peak to look", low=0.0, high=0.02
    )
    slack_s: float = parameter(
        0.002, "s", "jitter of the direct arrival between frames", low=0.0, high=0.02
    )
    latest_s: float = parameter(
        1.0, "s", "longest time from playing to hearing a chirp of a schedule", low=0.1, high=5.0
    )
    found_share: float = parameter(0.5, "", "frames that must hold a chirp", low=0.0, high=1.0)
    clipped_share: float = parameter(
        0.001, "", "more samples at full scale are refused", low=0.0, high=1.0
    )
    seam_contrast: float = parameter(
        9.0, "", "click over the usual that may be a break of the stream", low=1.0, high=1e6
    )
    shortfall_s: float = parameter(
        0.15, "s", "sound may be this much shorter than motion, jumps put back", low=0.0, high=60.0
    )
