"""What can be set when walks are merged."""

from __future__ import annotations

from dataclasses import dataclass, field

from elfslam.base.parameters import parameter
from elfslam.slam.parameters import Parameters
from elfslam.stages.map_alignment import AlignmentParameters
from elfslam.stages.quality import QualityParameters


@dataclass(frozen=True)
class MergingParameters:
    """How walks are joined once it is known how they lie, and how a map is kept alive."""

    gate_m: float = parameter(
        1.0, "m", "links that miss by more are left out of the graph", low=0.05, high=100.0
    )
    gate_rad: float = parameter(0.7, "rad", "the same for the heading", low=0.05, high=3.2)
    rounds: int = parameter(
        4, "", "how often links are chosen and the graph is solved", low=1, high=50
    )
    start_sigma_m: float = parameter(
        0.3, "m", "how exactly a declared start is known", low=0.01, high=100.0
    )
    start_sigma_rad: float = parameter(0.2, "rad", "and its heading", low=0.01, high=3.2)
    spacing_m: float = parameter(
        0.7, "m", "a map is walked again in steps of this", low=0.1, high=5.0
    )
    fade: float = parameter(
        0.9, "", "weight that a spot keeps when a newer walk passes it", low=0.0, high=1.0
    )
    fade_changed: float = parameter(
        0.5, "", "the same where its surroundings have changed", low=0.0, high=1.0
    )
    forget_below: float = parameter(
        0.1, "", "spots with less weight leave the map", low=0.0, high=1.0
    )
    passes: int = parameter(
        2, "", "times that a newer walk must find a place changed", low=1, high=100
    )
    changed_below: float = parameter(
        0.65, "", "similarity to the map, against other places, that is a change", low=0.0, high=2.0
    )


@dataclass(frozen=True)
class MergeParameters(Parameters):
    """Those of the pipeline, and those of merging."""

    alignment: AlignmentParameters = field(default_factory=AlignmentParameters)
    merging: MergingParameters = field(default_factory=MergingParameters)
    quality: QualityParameters = field(default_factory=QualityParameters)
