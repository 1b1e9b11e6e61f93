"""What can close loops: the echoes, and the senses they are compared and joined with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from elfslam.base.choices import Modality
from elfslam.base.errors import InputError
from elfslam.base.values import AnySimilarity, Odometry, Recording
from elfslam.baselines.emr import EMR_CLOSURES, EmrParameters, emr_similarity
from elfslam.baselines.magnetic import (
    MAGNETIC_CLOSURES,
    MagneticParameters,
    level_by_gravity,
    magnetic_similarity,
)
from elfslam.baselines.wifi import WIFI_CLOSURES, WifiParameters, wifi_similarity
from elfslam.learn.settings import FinetuneParameters, FloorLevelParameters, PretrainParameters
from elfslam.line.alignment import AlignmentParameters
from elfslam.line.anchoring import AnchoringParameters
from elfslam.line.closure import ClosureParameters
from elfslam.line.passages import PassageParameters
from elfslam.line.phone import PhoneParameters
from elfslam.line.quality import QualityParameters
from elfslam.merging.parameters import MergingParameters
from elfslam.parameters import Parameters
from elfslam.slam import Sense, no_similarity


@dataclass(frozen=True)
class Settings(Parameters):
    """Every parameter there is: the line's, the rivals', the merging's and the training's."""

    wifi: WifiParameters = field(default_factory=WifiParameters)
    wifi_closure: ClosureParameters = field(default=WIFI_CLOSURES)
    magnetic: MagneticParameters = field(default_factory=MagneticParameters)
    magnetic_closure: ClosureParameters = field(default=MAGNETIC_CLOSURES)
    emr: EmrParameters = field(default_factory=EmrParameters)
    emr_closure: ClosureParameters = field(default=EMR_CLOSURES)
    alignment: AlignmentParameters = field(default_factory=AlignmentParameters)
    merging: MergingParameters = field(default_factory=MergingParameters)
    quality: QualityParameters = field(default_factory=QualityParameters)
    anchoring: AnchoringParameters = field(default_factory=AnchoringParameters)
    passages: PassageParameters = field(default_factory=PassageParameters)
    pretrain: PretrainParameters = field(default_factory=PretrainParameters)
    finetune: FinetuneParameters = field(default_factory=FinetuneParameters)
    floor_level: FloorLevelParameters = field(default_factory=FloorLevelParameters)
    phone: PhoneParameters = field(default_factory=PhoneParameters)


def sense_of(modality: Modality, known: Settings) -> Sense:
    """What a modality other than the echoes makes of a walk."""
    return SENSES[modality](known)


def _wifi(known: Settings) -> Sense:
    def similarity(recording: Recording, nodes: Odometry) -> AnySimilarity:
        if recording.wifi is None:
            raise InputError(f"{recording.name}: no Wi-Fi scans; map it by something else")
        return wifi_similarity(recording.wifi, nodes, known.wifi)

    return Sense(similarity, known.wifi_closure)


def _magnetic(known: Settings) -> Sense:
    def similarity(recording: Recording, nodes: Odometry) -> AnySimilarity:
        if recording.magnetometer is None:
            raise InputError(f"{recording.name}: no magnetometer; map it by something else")
        level = recording.orientation
        if level is None and recording.imu is not None:
            level = level_by_gravity(recording.imu)
        return magnetic_similarity(recording.magnetometer, level, nodes, known.magnetic)

    return Sense(similarity, known.magnetic_closure)


def _emr(known: Settings) -> Sense:
    def similarity(recording: Recording, nodes: Odometry) -> AnySimilarity:
        if recording.emr is None:
            raise InputError(f"{recording.name}: no mains hum; map it by something else")
        return emr_similarity(recording.emr, nodes, known.emr)

    return Sense(similarity, known.emr_closure)


def _motion(known: Settings) -> Sense:
    return Sense(no_similarity, known.closure)


SENSES: Mapping[Modality, Callable[[Settings], Sense]] = {
    Modality.WIFI: _wifi,
    Modality.MAGNETIC: _magnetic,
    Modality.EMR: _emr,
    Modality.MOTION: _motion,
}
