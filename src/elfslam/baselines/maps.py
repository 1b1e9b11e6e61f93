"""Maps by other modalities: what Wi-Fi and the magnetic field know at each spot, and who is where.

Such a map has a spot for every stretch between footsteps, with a payload of its own kind. The
scores of a new walk against it go through the same localization as those of the echoes.
"""

from collections.abc import Sequence

import numpy as np

from elfslam.base.arrays import F32
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
    on_columns,
    wifi_scores,
)
from elfslam.stages.locate import LocateParameters
from elfslam.stages.segments import SegmentParameters

RSSI, FIELD = "rssi", "field"
WIFI_LOCATE = LocateParameters(
    temperature=0.03, near_m=3.0, unknown_below=-1.0, ambiguous_below=0.0
)
WIFI_SEGMENTS = SegmentParameters(
    temperature=0.03, near_m=3.0, unknown_below=-1.0, ambiguous_below=0.0
)
MAGNETIC_LOCATE = LocateParameters(temperature=0.03, unknown_below=-1.0, ambiguous_below=0.0)
MAGNETIC_SEGMENTS = SegmentParameters(temperature=0.03, unknown_below=-1.0, ambiguous_below=0.0)
"""A baseline answers always, with the best it has."""


def wifi_map(
    wifi: WifiScans, nodes: Odometry, trajectory: Trajectory, parameters: WifiFingerprintParameters
) -> FloorMap:
    """A mapped walk with the strength of each access point at its spots (payload `wifi`)."""
    heard = rssi_payload([fingerprints(wifi, nodes, parameters)], parameters)
    return stretch_map([trajectory], [heard], ())


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
    return stretch_map([trajectory], [Payload("magnetic", name, vectors)], ())


def wifi_spot_scores(
    wifi: WifiScans, nodes: Odometry, floor_map: FloorMap, parameters: WifiFingerprintParameters
) -> F32:
    """How similar the spots (m) of a map are to the stretches (n-1) of a walk.

    Raises InputError where the map has no Wi-Fi of this variant.
    """
    spots = rssi_of(floor_map, parameters)
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
    known = payload_of(floor_map, "magnetic", f"{FIELD}:{parameters.variant}:{shape}")
    spots = known.vectors.astype(np.float64).reshape(-1, *windows.shape[1:])
    return np.asarray(magnetic_scores(windows, spots, parameters), np.float32)


def rssi_payload(heard: Sequence[Fingerprints], parameters: WifiFingerprintParameters) -> Payload:
    """What the walks of a map heard (m, c), one after the other, of all access points."""
    names = sorted({name for each in heard for name in each.bssids})
    wide = np.vstack([on_columns(each, names, parameters.floor_dbm) for each in heard])
    name = ":".join([RSSI, parameters.variant, ",".join(names)])
    return Payload("wifi", name, wide.astype(np.float32))


def rssi_of(floor_map: FloorMap, parameters: WifiFingerprintParameters) -> Fingerprints:
    """What is heard at each spot of a map. Raises InputError where it has no such payload."""
    known = payload_of(floor_map, "wifi", f"{RSSI}:{parameters.variant}:")
    names = tuple(name for name in known.encoder.split(":", 2)[2].split(",") if name)
    return Fingerprints(names, known.vectors.astype(np.float64))


def stretch_map(
    trajectories: Sequence[Trajectory], payloads: Sequence[Payload], sources: tuple[str, ...]
) -> FloorMap:
    """A spot in the middle of each stretch between footsteps, walk after walk."""
    poses = [each.world_from_body for each in trajectories]
    counts = [len(each) - 1 for each in poses]
    return FloorMap(
        xy_m=np.concatenate([(each[1:, :2] + each[:-1, :2]) / 2 for each in poses]),
        heading_rad=np.concatenate([each[:-1, 2] for each in poses]),
        walk=np.repeat(np.arange(len(poses), dtype=np.int64), counts),
        order=np.concatenate([np.arange(count, dtype=np.int64) for count in counts]),
        covariance_m2=np.concatenate([each.covariance[:-1, :2, :2] for each in trajectories]),
        payloads=tuple(payloads),
        parameters_digest="",
        sources=sources,
    )


def payload_of(floor_map: FloorMap, kind: str, encoder: str) -> Payload:
    """The payload of that kind whose encoder begins so. Raises InputError where there is none."""
    for item in floor_map.payloads:
        if item.kind == kind and item.encoder.startswith(encoder):
            return item
    kinds = ", ".join(f"{item.kind} ({item.encoder[:30]})" for item in floor_map.payloads)
    raise InputError(
        f"map: wanted a payload {kind} ({encoder}), got {kinds or 'none'}; "
        "map the walk by it, with the same variant"
    )
