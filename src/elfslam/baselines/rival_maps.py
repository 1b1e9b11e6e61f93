"""Rivals located in maps: what Wi-Fi and the magnetic field know at each spot, and who is where.

A rival's map has a spot for every stretch between footsteps, with a payload of its own kind. The
scores of a new walk against it go through the same localization as those of the echoes.
"""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.base.values import (
    FloorMap,
    Magnetometer,
    Odometry,
    Orientation,
    Payload,
    Trajectory,
    WifiScans,
)
from elfslam.baselines.magnetic import MagneticParameters, field_sequences, magnetic_scores
from elfslam.baselines.wifi import (
    Fingerprints,
    WifiFingerprintParameters,
    fingerprints,
    wifi_scores,
)
from elfslam.line.locate import LocateParameters
from elfslam.line.segments import SegmentParameters

RSSI, FIELD = "rssi", "field"
WIFI_LOCATE = LocateParameters(
    temperature=0.03, near_m=3.0, unknown_below=-1.0, ambiguous_below=0.0
)
WIFI_SEGMENTS = SegmentParameters(
    temperature=0.03, near_m=3.0, unknown_below=-1.0, ambiguous_below=0.0
)
MAGNETIC_LOCATE = LocateParameters(temperature=0.03, unknown_below=-1.0, ambiguous_below=0.0)
MAGNETIC_SEGMENTS = SegmentParameters(temperature=0.03, unknown_below=-1.0, ambiguous_below=0.0)
"""A rival answers always, with its best guess."""


def wifi_map(
    wifi: WifiScans, nodes: Odometry, trajectory: Trajectory, parameters: WifiFingerprintParameters
) -> FloorMap:
    """A mapped walk with the strength of each access point at its spots (payload `wifi`)."""
    heard = fingerprints(wifi, nodes, parameters)
    name = ":".join([RSSI, parameters.variant, ",".join(heard.bssids)])
    return _stretch_map(trajectory, Payload("wifi", name, heard.rssi_dbm.astype(np.float32)))


def magnetic_map(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    trajectory: Trajectory,
    parameters: MagneticParameters,
) -> FloorMap:
    """A mapped walk with the field around each of its spots (payload `magnetic`)."""
    windows = field_sequences(magnetometer, orientation, nodes, parameters)
    name = f"{FIELD}:{parameters.variant}:{windows.shape[1]}x{windows.shape[2]}"
    vectors = windows.reshape(len(windows), -1).astype(np.float32)
    return _stretch_map(trajectory, Payload("magnetic", name, vectors))


def wifi_spot_scores(
    wifi: WifiScans, nodes: Odometry, floor_map: FloorMap, parameters: WifiFingerprintParameters
) -> F32:
    """How alike the spots (m) of a map are to the stretches (n-1) of a walk.

    Raises InputError where the map has no Wi-Fi of this variant.
    """
    known = _payload(floor_map, "wifi", f"{RSSI}:{parameters.variant}:")
    names = tuple(name for name in known.encoder.split(":", 2)[2].split(",") if name)
    spots = Fingerprints(names, known.vectors.astype(np.float64))
    scores = wifi_scores(fingerprints(wifi, nodes, parameters), spots, parameters)
    return np.asarray(scores, np.float32)


def magnetic_spot_scores(
    magnetometer: Magnetometer,
    orientation: Orientation | None,
    nodes: Odometry,
    floor_map: FloorMap,
    parameters: MagneticParameters,
) -> F32:
    """The same by the magnetic field. Raises InputError where the map has none of this variant."""
    windows = field_sequences(magnetometer, orientation, nodes, parameters)
    shape = f"{windows.shape[1]}x{windows.shape[2]}"
    known = _payload(floor_map, "magnetic", f"{FIELD}:{parameters.variant}:{shape}")
    spots = known.vectors.astype(np.float64).reshape(-1, *windows.shape[1:])
    return np.asarray(magnetic_scores(windows, spots, parameters), np.float32)


def _stretch_map(trajectory: Trajectory, payload: Payload) -> FloorMap:
    """A spot in the middle of each stretch between footsteps."""
    poses: F64 = trajectory.world_from_body
    count = len(poses) - 1
    return FloorMap(
        xy_m=(poses[1:, :2] + poses[:-1, :2]) / 2,
        heading_rad=poses[:-1, 2],
        walk=np.zeros(count, dtype=np.int64),
        order=np.arange(count),
        covariance_m2=trajectory.covariance[:-1, :2, :2],
        payloads=(payload,),
        parameters_digest="",
        sources=(),
    )


def _payload(floor_map: FloorMap, kind: str, encoder: str) -> Payload:
    for item in floor_map.payloads:
        if item.kind == kind and item.encoder.startswith(encoder):
            return item
    kinds = ", ".join(f"{item.kind} ({item.encoder[:30]})" for item in floor_map.payloads)
    raise InputError(
        f"map: wanted a payload {kind} ({encoder}), got {kinds or 'none'}; "
        "map the walk by it, with the same variant"
    )
