"""The pipeline: read it aloud and you know the method."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.building import FloorsVisited
from elfslam.base.enums import Mode
from elfslam.base.parameters import digest
from elfslam.base.values import (
    NO_CLOSURES,
    Announce,
    AnySimilarity,
    Checkpoints,
    Closures,
    Echoes,
    Features,
    Fixes,
    FloorMap,
    MeanSimilarity,
    Odometry,
    Recording,
    Run,
    Trajectory,
    silent,
)
from elfslam.slam.front_end import (
    apply_acoustic_scale,
    dead_reckoned,
    dead_reckoning_nodes,
    extract_echoes,
    extract_query_echoes,
    floors_visited,
)
from elfslam.slam.parameters import Parameters
from elfslam.stages.checkpoints import OnPlan, closures_at, lies_on_plan, on_plan, places_visited
from elfslam.stages.closure import (
    ClosureParameters,
    echo_sequence_similarity,
    find_closures,
    guided_closures,
    joined,
    sharing_errors,
)
from elfslam.stages.device_adaptation import to_map_domain
from elfslam.stages.feature import Encoder, extract_features
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.graph import agreeing, build_graph, expected, optimise
from elfslam.stages.levels import reckoned_on_passages, without_level_taps
from elfslam.stages.locate import (
    LocateParameters,
    elf_payload,
    spot_similarity,
    trusted_one_shot,
    without_suspects,
)
from elfslam.stages.motion import Compass
from elfslam.stages.segments import locate_by_segments
from elfslam.stages.track import Tracker

AS_MAPPED = np.zeros(3)
"""A map's own frame is that of the world."""
Stage = Callable[[str], AbstractContextManager[None]]
Adapt = Callable[[Encoder, Echoes], Encoder]
SimilarityMaker = Callable[[Recording, Odometry], AnySimilarity]


@dataclass(frozen=True)
class Sense:
    """What knows a place again: how similar nodes are, and what then counts as a closure."""

    similarity_of: SimilarityMaker
    closure: ClosureParameters


def as_shipped(encoder: Encoder, echoes: Echoes) -> Encoder:
    """No fine-tuning."""
    return encoder


def map_by_echoes(
    recording: Recording,
    encoder: Encoder,
    parameters: Parameters,
    *,
    adapt: Adapt = as_shipped,
    beside: Sequence[Sense] = (),
    announce: Announce = silent,
) -> Run:
    """A walk with sound becomes a corrected trajectory and a map of ELFs.

    Other modalities may close loops `beside` the echoes.
    """
    seconds: dict[str, float] = {}
    stage = partial(_stage, seconds, announce)
    with stage("motion"):
        nodes, compass = dead_reckoned(recording, parameters)
        visited = floors_visited(recording, nodes, parameters)
    with stage("echoes"):
        echoes = extract_echoes(recording, parameters)
    with stage("step length"):
        nodes = apply_acoustic_scale(nodes, echoes, parameters)
        nodes = _through_passages(recording, nodes, visited, parameters)
    with stage("features"):
        used = adapt(encoder, echoes)
        features = extract_features(echoes, used)
    with stage("similarity"):
        similarity = echo_sequence_similarity(features, nodes)
        similarities = [(similarity, parameters.closure), *_sensed(recording, nodes, beside)]
    run = _close_loops(recording, nodes, compass, visited, similarities, parameters, stage)
    with stage("map"):
        run = replace(run, echoes=echoes, features=features)
        if visited is None:
            run = replace(run, floor_map=map_of(run, parameters))
    return replace(run, seconds=seconds)


def map_of(run: Run, parameters: Parameters) -> FloorMap | None:
    """The map of a walk on one floor; None without sound."""
    if run.features is None:
        return None
    return trajectory_map(
        run.trajectory,
        run.features,
        parameters.floormap,
        parameters_digest=digest(parameters),
        source=run.name,
    )


def _through_passages(
    recording: Recording, nodes: Odometry, visited: FloorsVisited | None, parameters: Parameters
) -> Odometry:
    """Dead reckoning by footsteps knows stairs and lifts; a device's own odometry sees them."""
    if visited is None or recording.imu is None:
        return nodes
    return reckoned_on_passages(nodes, visited, parameters.levels)


def map_by(
    recording: Recording,
    senses: Sequence[Sense],
    parameters: Parameters,
    *,
    announce: Announce = silent,
) -> Run:
    """The same with other modalities: whatever makes a similarity between nodes closes the loops.

    The run keeps the similarity of the first.
    """
    seconds: dict[str, float] = {}
    stage = partial(_stage, seconds, announce)
    with stage("motion"):
        nodes, compass = dead_reckoned(recording, parameters)
        visited = floors_visited(recording, nodes, parameters)
        nodes = _through_passages(recording, nodes, visited, parameters)
    with stage("similarity"):
        similarities = _sensed(recording, nodes, senses)
    run = _close_loops(recording, nodes, compass, visited, similarities, parameters, stage)
    return replace(run, seconds=seconds)


def _sensed(
    recording: Recording, nodes: Odometry, senses: Sequence[Sense]
) -> list[tuple[AnySimilarity, ClosureParameters]]:
    return [(sense.similarity_of(recording, nodes), sense.closure) for sense in senses]


def _close_loops(
    recording: Recording,
    nodes: Odometry,
    compass: Compass | None,
    visited: FloorsVisited | None,
    similarities: Sequence[tuple[AnySimilarity, ClosureParameters]],
    parameters: Parameters,
    stage: Stage,
) -> Run:
    """What is similar, or was marked by hand, closes loops, and the loops correct the walk."""
    named, level = recording.checkpoints, None
    if visited is not None:
        named, level = without_level_taps(named), visited.levels.at(nodes.t_s)
    with stage("closures"):
        measured = closures_by(nodes, similarities, parameters, level)
        marked = closures_at(named, nodes, parameters.checkpoint)
        if level is not None:
            marked = marked.chosen(level[marked.i] == level[marked.j])
        closures = joined([measured, marked])
    with stage("graph"):
        by_hand = np.arange(len(closures.i)) >= len(measured.i)
        nodes, trajectory = optimise_walk(nodes, closures, by_hand, named, parameters)
    return Run(
        name=recording.name,
        odometry=nodes,
        similarity=similarities[0][0],
        closures=closures,
        trajectory=trajectory,
        floor_map=None,
        echoes=None,
        features=None,
        points_of_interest=places_visited(named, trajectory, parameters.checkpoint),
        checkpoints=named,
        compass_sigma_rad=None if compass is None else compass.sigma_rad,
        visited=visited,
    )


def closures_by(
    nodes: Odometry,
    similarities: Sequence[tuple[AnySimilarity, ClosureParameters]],
    parameters: Parameters,
    level: F64 | None = None,
) -> Closures:
    """The closures of one modality after the other, between footsteps on one `level` (n).

    What a later one says must fit the walk as the earlier ones correct it. The walk so corrected
    then leads to closures that by themselves would be too little alike.
    """
    closures = NO_CLOSURES
    for similarity, known in similarities:
        found = find_closures(similarity, nodes, known, level)
        found = found.chosen(agreeing(build_graph(nodes, closures), found, parameters.graph))
        first = joined([closures, sharing_errors(found, known.shared_footsteps)])
        prior = partial(expected, build_graph(nodes, first), parameters=parameters.graph)
        further = guided_closures(similarity, nodes, found, prior, known, level)
        weighed = sharing_errors(joined([found, further]), known.shared_footsteps)
        closures = joined([closures, weighed])
    return closures


def optimise_walk(
    nodes: Odometry,
    closures: Closures,
    by_hand: Bool,
    checkpoints: Checkpoints | None,
    parameters: Parameters,
) -> tuple[Odometry, Trajectory]:
    """Pose graph optimisation of a walk: its dead reckoning, and the trajectory that came of it.

    Both in the frame of the floor plan where its walker tapped two places or more on one, and the
    walk agrees with them; else in that of its start. Closures made `by_hand` (k) are believed at
    first.
    """
    plan = on_plan(checkpoints, nodes, parameters.checkpoint)
    if plan is not None:
        laid = _on_plan(plan, closures, by_hand, parameters)
        if lies_on_plan(checkpoints, laid, parameters.checkpoint):
            return replace(nodes, world_from_body=plan.nodes.world_from_body[1:]), laid
    graph = build_graph(nodes, closures)
    return nodes, optimise(graph, nodes.t_s, parameters.graph, by_hand=by_hand)


def _on_plan(plan: OnPlan, closures: Closures, by_hand: Bool, parameters: Parameters) -> Trajectory:
    """The footsteps of a pose graph that begins amid the taps on the plan and bends to them."""
    own = replace(closures, i=closures.i + 1, j=closures.j + 1)
    graph = build_graph(plan.nodes, joined([own, plan.closures]))
    taps_too = np.concatenate([by_hand, plan.believed])
    solved = optimise(graph, plan.nodes.t_s, parameters.graph, by_hand=taps_too)
    weights = solved.closure_weights[: len(closures.i)]
    return replace(solved.chosen(slice(1, None)), closure_weights=weights)


def no_similarity(recording: Recording, nodes: Odometry) -> MeanSimilarity:
    """Nothing is similar: mapping by this is dead reckoning alone."""
    return MeanSimilarity(np.zeros((len(nodes.t_s) - 1, 1), dtype=np.float32), kind="motion")


def locate(
    recording: Recording,
    floor_map: FloorMap,
    encoder: Encoder,
    parameters: Parameters,
    *,
    mode: Mode = Mode.ONE_SHOT,
    seed: int = 0,
    translation: F32 | None = None,
) -> Fixes:
    """Where the phone was at every moment of a recording, as far as the map can tell.

    The `seed` is the tracker's. A `translation` is what `learn_phone` found out about this phone.
    """
    echoes, suspect = extract_query_echoes(recording, parameters)
    features = extract_features(echoes, encoder)
    if translation is not None:
        features = to_map_domain(features, translation)
    if mode is Mode.ONE_SHOT:
        return trusted_one_shot(features, floor_map, parameters.locate, suspect)
    nodes = dead_reckoning_nodes(recording, parameters)
    scores = footstep_similarity(features, nodes, floor_map, parameters.locate)
    doubt = suspect(nodes.t_s)
    return locate_walk(nodes, scores, floor_map, parameters, mode=mode, seed=seed, suspect=doubt)


def footstep_similarity(
    features: Features, nodes: Odometry, floor_map: FloorMap, parameters: LocateParameters
) -> F32:
    """How similar each spot (m) is to each stretch between footsteps (n-1); NaN where silent."""
    payload = elf_payload(floor_map, features.encoder, features.vectors.shape[1])
    return spot_similarity(features.means_between(nodes.t_s, parameters.fewest_echoes), payload)


def locate_walk(
    nodes: Odometry,
    scores: F32,
    floor_map: FloorMap,
    parameters: Parameters,
    *,
    mode: Mode,
    seed: int = 0,
    suspect: Bool | None = None,
) -> Fixes:
    """Fixes from footsteps and from scores (n-1, m) of any kind, by trajectory or by tracking.

    What is `suspect` (n-1) places nobody.
    """
    if mode is Mode.TRAJECTORY:
        doubt = np.zeros(len(scores), dtype=np.bool_) if suspect is None else suspect
        trusted = np.where(doubt[:, None], np.float32(np.nan), scores)
        fixes = locate_by_segments(nodes, trusted, floor_map, parameters.segments)
        return without_suspects(fixes, doubt[len(doubt) - len(fixes.t_s) :])
    generator = np.random.default_rng(seed)
    return Tracker(floor_map, parameters.track, generator).follow(nodes, scores, suspect)


@contextmanager
def _stage(seconds: dict[str, float], announce: Announce, name: str) -> Iterator[None]:
    """Announce a stage and note in `seconds` how long it took."""
    announce(name, None)
    start = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - start
