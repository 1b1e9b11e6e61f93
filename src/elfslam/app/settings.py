"""One schema of parameters: what every command, job and call takes."""

from __future__ import annotations

from dataclasses import dataclass, field

from elfslam.baselines.emr import EMR_CLOSURES, EmrParameters
from elfslam.baselines.magnetic import (
    MAGNETIC_CLOSURES,
    MagneticParameters,
)
from elfslam.baselines.neighbours import NeighbourParameters
from elfslam.baselines.wifi import WIFI_CLOSURES, WifiFingerprintParameters
from elfslam.baselines.wifi_places import PlaceParameters
from elfslam.learn.parameters import FinetuneParameters, FloorLevelParameters, PretrainParameters
from elfslam.slam.merging.parameters import MergeParameters
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.device_adaptation import PhoneParameters
from elfslam.stages.floor_plan_alignment import AnchoringParameters
from elfslam.stages.map_matching import MapMatchingParameters


@dataclass(frozen=True)
class Settings(MergeParameters):
    """Every parameter there is: the pipeline's, the baselines', merging's and the training's."""

    wifi: WifiFingerprintParameters = field(default_factory=WifiFingerprintParameters)
    wifi_closure: ClosureParameters = field(default=WIFI_CLOSURES)
    magnetic: MagneticParameters = field(default_factory=MagneticParameters)
    magnetic_closure: ClosureParameters = field(default=MAGNETIC_CLOSURES)
    neighbours: NeighbourParameters = field(default_factory=NeighbourParameters)
    places: PlaceParameters = field(default_factory=PlaceParameters)
    emr: EmrParameters = field(default_factory=EmrParameters)
    emr_closure: ClosureParameters = field(default=EMR_CLOSURES)
    anchoring: AnchoringParameters = field(default_factory=AnchoringParameters)
    map_matching: MapMatchingParameters = field(default_factory=MapMatchingParameters)
    pretrain: PretrainParameters = field(default_factory=PretrainParameters)
    finetune: FinetuneParameters = field(default_factory=FinetuneParameters)
    floor_level: FloorLevelParameters = field(default_factory=FloorLevelParameters)
    phone: PhoneParameters = field(default_factory=PhoneParameters)
