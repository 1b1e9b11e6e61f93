"""The line put together: read it aloud and you know the method."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.parameters import digest
from elfslam.base.values import (
    Closures,
    Echoes,
    Features,
    Fixes,
    FloorMap,
    Odometry,
    Recording,
    Similarity,
    Trajectory,
)
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.closure import ClosureParameters, find_closures
from elfslam.line.echo import EchoParameters, cut_echoes
from elfslam.line.feature import Encoder, encoder_for, extract_features, with_phone
from elfslam.line.floormap import FloorMapParameters, trajectory_map
from elfslam.line.graph import GraphParameters, build_graph, optimise
from elfslam.line.locate import LocateParameters, locate_one_shot
from elfslam.line.motion import MotionParameters, dead_reckon, nodes_by_distance
from elfslam.line.similarity import echo_sequence_similarity


@dataclass(frozen=True)
class Parameters:
    """Every parameter of the line, one group per stage."""

    chirp: ChirpParameters = field(default_factory=ChirpParameters)
    echo: EchoParameters = field(default_factory=EchoParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    closure: ClosureParameters = field(default_factory=ClosureParameters)
    graph: GraphParameters = field(default_factory=GraphParameters)
    floormap: FloorMapParameters = field(default_factory=FloorMapParameters)
    locate: LocateParameters = field(default_factory=LocateParameters)


@dataclass(frozen=True, eq=False)
class Run:
    """What mapping one recording gives, with its evidence."""

    name: str
    odometry: Odometry
    similarity: Similarity
    closures: Closures
    trajectory: Trajectory
    floor_map: FloorMap | None
    echoes: Echoes | None
    features: Features | None
    seconds: dict[str, float] = field(default_factory=dict)


Announce = Callable[[str], None]
Stage = Callable[[str], AbstractContextManager[None]]
Adapt = Callable[[Encoder, Echoes], Encoder]
SimilarityMaker = Callable[[Recording, Odometry], Similarity]


def silent(stage: str) -> None:
    """Announce nothing."""


def as_shipped(encoder: Encoder, echoes: Echoes) -> Encoder:
    """No fine-tuning."""
    return encoder


def map_by_echoes(
    recording: Recording,
    encoder: Encoder,
    parameters: Parameters,
    *,
    adapt: Adapt = as_shipped,
    announce: Announce = silent,
) -> Run:
    """A walk with sound becomes a straightened trajectory and a map of ELFs."""
    seconds: dict[str, float] = {}
    stage = partial(_stage, seconds, announce)
    with stage("motion"):
        nodes = walk_nodes(recording, parameters)
    with stage("echoes"):
        echoes = hear(recording, parameters)
    with stage("features"):
        used = adapt(encoder, echoes)
        features = extract_features(echoes, used)
    with stage("similarity"):
        similarity = echo_sequence_similarity(features, nodes)
    closures, trajectory = _close_loops(nodes, similarity, parameters, stage)
    with stage("map"):
        floor_map = trajectory_map(
            trajectory,
            features,
            parameters.floormap,
            parameters_digest=digest(parameters),
            source=recording.name,
        )
        floor_map = with_phone(floor_map, used)
    evidence = similarity, closures, trajectory, floor_map, echoes, features
    return Run(recording.name, nodes, *evidence, seconds)


def map_by(
    recording: Recording,
    similarity_of: SimilarityMaker,
    parameters: Parameters,
    *,
    announce: Announce = silent,
) -> Run:
    """The same with another sense: whatever makes a similarity between nodes closes the loops."""
    seconds: dict[str, float] = {}
    stage = partial(_stage, seconds, announce)
    with stage("motion"):
        nodes = walk_nodes(recording, parameters)
    with stage("similarity"):
        similarity = similarity_of(recording, nodes)
    closures, trajectory = _close_loops(nodes, similarity, parameters, stage)
    return Run(recording.name, nodes, similarity, closures, trajectory, None, None, None, seconds)


def _close_loops(
    nodes: Odometry, similarity: Similarity, parameters: Parameters, stage: Stage
) -> tuple[Closures, Trajectory]:
    """What resembles closes loops, and the loops straighten the walk."""
    with stage("closures"):
        closures = find_closures(similarity, nodes, parameters.closure)
    with stage("graph"):
        trajectory = optimise(build_graph(nodes, closures), nodes.t_s, parameters.graph)
    return closures, trajectory


def no_similarity(recording: Recording, nodes: Odometry) -> Similarity:
    """Nothing resembles anything: mapping by this is dead reckoning alone."""
    count = len(nodes.t_s) - 1
    return Similarity(np.zeros((count, count), dtype=np.float32), kind="motion")


def locate(
    recording: Recording, floor_map: FloorMap, encoder: Encoder, parameters: Parameters
) -> Fixes:
    """Where the phone was at every moment of a recording, as far as the map can tell.

    Where the map says what its own phone made of the chirp, this one is heard as if it were that.
    """
    echoes = hear(recording, parameters)
    features = extract_features(echoes, encoder_for(floor_map, encoder, echoes))
    return locate_one_shot(features, floor_map, parameters.locate)


def walk_nodes(recording: Recording, parameters: Parameters) -> Odometry:
    """Footsteps where there is an IMU, else places along the device's own odometry."""
    if recording.imu is not None:
        return dead_reckon(recording.imu, parameters.motion, recording.start_pose)
    if recording.odometry is not None:
        return nodes_by_distance(recording.odometry, parameters.motion.node_spacing_m)
    raise InputError(
        f"{recording.name}: it has neither motion sensors nor odometry; "
        "record accelerometer and gyroscope"
    )


def hear(recording: Recording, parameters: Parameters) -> Echoes:
    """The echoes of a recording's sound."""
    if recording.audio is None:
        raise InputError(
            f"{recording.name}: it has no sound; "
            "map it with --by magnetic, or record while chirping"
        )
    chirp = make_chirp(parameters.chirp, recording.audio.rate_hz)
    motion = recording.imu or recording.odometry
    duration_s = None if motion is None else float(motion.t_s[-1])
    return cut_echoes(recording.audio, chirp, parameters.echo, duration_s)


@contextmanager
def _stage(seconds: dict[str, float], announce: Announce, name: str) -> Iterator[None]:
    """Announce a stage and note in `seconds` how long it took."""
    announce(name)
    start = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - start
