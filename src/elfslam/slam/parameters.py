"""The parameters of the line, all of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from elfslam.line.acoustic_odometry import AcousticOdometryParameters
from elfslam.line.checkpoints import CheckpointParameters
from elfslam.line.chirp import ChirpParameters
from elfslam.line.closure import ClosureParameters
from elfslam.line.echo import EchoParameters
from elfslam.line.floormap import FloorMapParameters
from elfslam.line.graph import GraphParameters
from elfslam.line.locate import LocateParameters
from elfslam.line.medium_access import MediumAccessParameters
from elfslam.line.motion import MotionParameters
from elfslam.line.segments import SegmentParameters
from elfslam.line.spoofing import SpoofingParameters
from elfslam.line.track import TrackParameters


@dataclass(frozen=True)
class Parameters:
    """Every parameter of the line, one group per stage."""

    chirp: ChirpParameters = field(default_factory=ChirpParameters)
    echo: EchoParameters = field(default_factory=EchoParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    acoustic_odometry: AcousticOdometryParameters = field(
        default_factory=AcousticOdometryParameters
    )
    closure: ClosureParameters = field(default_factory=ClosureParameters)
    checkpoint: CheckpointParameters = field(default_factory=CheckpointParameters)
    graph: GraphParameters = field(default_factory=GraphParameters)
    floormap: FloorMapParameters = field(default_factory=FloorMapParameters)
    locate: LocateParameters = field(default_factory=LocateParameters)
    segments: SegmentParameters = field(default_factory=SegmentParameters)
    track: TrackParameters = field(default_factory=TrackParameters)
    spoofing: SpoofingParameters = field(default_factory=SpoofingParameters)
    medium_access: MediumAccessParameters = field(default_factory=MediumAccessParameters)
