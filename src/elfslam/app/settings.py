"""One schema of parameters: what every command, job and call takes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from elfslam.base.enums import Modality
from elfslam.base.errors import InputError
from elfslam.base.values import AnySimilarity, Odometry, Recording
from elfslam.baselines.emr import EMR_CLOSURES, EmrParameters, emr_similarity
from elfslam.baselines.magnetic import (
    MAGNETIC_CLOSURES,
    MagneticParameters,
    level_by_gravity,
    magnetic_similarity,
)
from elfslam.baselines.neighbours import NeighbourParameters
from elfslam.baselines.wifi import (
    WIFI_CLOSURES,
    PlaceParameters,
    WifiFingerprintParameters,
    wifi_similarity,
)
from elfslam.learn.parameters import FinetuneParameters, FloorLevelParameters, PretrainParameters
from elfslam.slam.merging.members import MergeParameters
from elfslam.slam.pipeline import Sense, no_similarity
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


def sense_of(modality: Modality, settings: Settings) -> Sense:
    """What a modality other than the echoes makes of a walk."""
    return SENSES[modality](settings)


def _wifi(settings: Settings) -> Sense:
    def similarity(recording: Recording, nodes: Odometry) -> AnySimilarity:
        if recording.wifi is None:
            raise InputError(f"{recording.name}: no Wi-Fi scans; map it by something else")
        return wifi_similarity(recording.wifi, nodes, settings.wifi)

    return Sense(similarity, settings.wifi_closure)


def _magnetic(settings: Settings) -> Sense:
    def similarity(recording: Recording, nodes: Odometry) -> AnySimilarity:
        if recording.magnetometer is None:
            raise InputError(f"{recording.name}: no magnetometer; map it by something else")
        level = recording.orientation
        if level is None and recording.imu is not None:
            level = level_by_gravity(recording.imu)
        return magnetic_similarity(recording.magnetometer, level, nodes, settings.magnetic)

    return Sense(similarity, settings.magnetic_closure)


def _emr(settings: Settings) -> Sense:
    def similarity(recording: Recording, nodes: Odometry) -> AnySimilarity:
        if recording.emr is None:
            raise InputError(f"{recording.name}: no mains hum; map it by something else")
        return emr_similarity(recording.emr, nodes, settings.emr)

    return Sense(similarity, settings.emr_closure)


SENSES: Mapping[Modality, Callable[[Settings], Sense]] = {
    Modality.WIFI: _wifi,
    Modality.MAGNETIC: _magnetic,
    Modality.EMR: _emr,
    Modality.MOTION: lambda settings: Sense(no_similarity, settings.closure),
}
