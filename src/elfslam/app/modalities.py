"""What can close loops: the echoes, and the modalities they are compared and joined with."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from elfslam.app.settings import Settings
from elfslam.base.enums import Modality
from elfslam.base.errors import InputError
from elfslam.base.values import AnySimilarity, Odometry, Recording
from elfslam.baselines.emr import emr_similarity
from elfslam.baselines.magnetic import (
    level_by_gravity,
    magnetic_similarity,
)
from elfslam.baselines.wifi import wifi_similarity
from elfslam.slam.pipeline import Sense, no_similarity


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


def _motion(settings: Settings) -> Sense:
    return Sense(no_similarity, settings.closure)


SENSES: Mapping[Modality, Callable[[Settings], Sense]] = {
    Modality.WIFI: _wifi,
    Modality.MAGNETIC: _magnetic,
    Modality.EMR: _emr,
    Modality.MOTION: _motion,
}
