"""The parameters of the pipeline, all of them."""

from dataclasses import dataclass, field

from elfslam.stages.acoustic_odometry import AcousticOdometryParameters
from elfslam.stages.checkpoints import CheckpointParameters
from elfslam.stages.chirp import ChirpParameters
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.echo import EchoParameters
from elfslam.stages.floormap import FloorMapParameters
from elfslam.stages.graph import GraphParameters
from elfslam.stages.levels import LevelParameters
from elfslam.stages.locate import LocateParameters
from elfslam.stages.medium_access import MediumAccessParameters
from elfslam.stages.motion import MotionParameters
from elfslam.stages.segments import SegmentParameters
from elfslam.stages.spoofing import SpoofingParameters
from elfslam.stages.track import TrackParameters


@dataclass(frozen=True)
class Parameters:
    """Every parameter of the pipeline, one group per stage."""

    chirp: ChirpParameters = field(default_factory=ChirpParameters)
    echo: EchoParameters = field(default_factory=EchoParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    acoustic_odometry: AcousticOdometryParameters = field(
        default_factory=AcousticOdometryParameters
    )
    levels: LevelParameters = field(default_factory=LevelParameters)
    closure: ClosureParameters = field(default_factory=ClosureParameters)
    checkpoint: CheckpointParameters = field(default_factory=CheckpointParameters)
    graph: GraphParameters = field(default_factory=GraphParameters)
    floormap: FloorMapParameters = field(default_factory=FloorMapParameters)
    locate: LocateParameters = field(default_factory=LocateParameters)
    segments: SegmentParameters = field(default_factory=SegmentParameters)
    track: TrackParameters = field(default_factory=TrackParameters)
    spoofing: SpoofingParameters = field(default_factory=SpoofingParameters)
    medium_access: MediumAccessParameters = field(default_factory=MediumAccessParameters)
