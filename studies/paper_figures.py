"""The paper's pictures of one echo, one matrix and one walk each, drawn in simulated worlds.

What stands for many walks is measured by the studies of its own: this one shows what they are made
of. The excitation and the spectrograms are of the lab, the matrix is of the mall.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elfslam.app.settings import sense_of
from elfslam.base.arrays import F32, F64
from elfslam.base.enums import Modality
from elfslam.base.values import ECHO_RATE_HZ, NO_CLOSURES, AnySimilarity, Closures
from elfslam.baselines.generic import generic_encoders
from elfslam.scoring.errors import Alignment, match, place, placement
from elfslam.slam.front_end import apply_acoustic_scale, dead_reckoning_nodes
from elfslam.slam.pipeline import closures_by
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.closure import echo_sequence_similarity
from elfslam.stages.echo.sound import matched_envelope
from elfslam.stages.feature import spectrogram
from elfslam.stages.graph import build_graph, optimise
from elfslam.world.kinds import SURVEYOR
from elfslam.world.phone import render_frames, room_responses
from elfslam.world.sensors import Sensor
from elfslam.world.world_file import load_world
from studies.cached import (
    SCENARIOS,
    SimulatedWalk,
    at_its_start,
    extract_echoes,
    extract_features,
    shipped,
    simulated,
)
from studies.curation import CurationParameters, curated_closures
from studies.distinctness import row_of_spots
from studies.mapping import CALIBRATED, walkers
from studies.plain_features import ELF
from studies.results import Record
from studies.still_phone import hear_at, held_still, listener_in
from studies.study import Study, StudyContext
from studies.trace import PSD, SHOWN, walk_over_markers

WORLDS = ("living_room", "office", "mall")
ROUNDS = 3
MATRIX_WORLD = "mall"
POINTS, MOST_CANDIDATES = 60, 900
"""Of a trajectory and of a matrix, as they are drawn."""
LEVEL_DB, POWER_DB, AMPLITUDE = "level (dB)", "power (dB)", "amplitude"
CORRELATION, LATER = "correlation", "later footstep"
X_M, Y_M = "x (m)", "y (m)"
CANDIDATES, CURATED = "candidates", "curated"
TRUE, RECKONED = "truth", "dead reckoning"
WITHOUT = "without curation"
SPOTS = ("spot A", "10 cm from A", "2 m from A")
MS = 1000.0


def measure_paper_figures(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    matrix_world: str = MATRIX_WORLD,
    rounds: int = ROUNDS,
) -> list[Record]:
    """The data of each picture: its method says what is shown, its condition where it stands."""
    records = [*excitation(), *spectrograms(), *footsteps_compared()]
    for k, world in enumerate(worlds):
        context.announce(world, (k + 1) / (len(worlds) + 2))
        walk = SimulatedWalk(world, 0, rounds, SURVEYOR.name)
        records += trajectories(walk)
    context.announce("matrix", None)
    return records + list(matrix(SimulatedWalk(matrix_world, 0, rounds, SURVEYOR.name)))


def excitation() -> Iterator[Record]:
    """The chirp's spectrogram, and what a phone in the lab receives of it, filtered or not."""
    chirp = make_chirp(ChirpParameters(), ECHO_RATE_HZ)
    padded = np.pad(chirp.samples, 96)[None]
    yield from _tiles("chirp", spectrogram_db(padded, whole=True), ECHO_RATE_HZ)
    world = load_world("lab")
    listener, generator = listener_in(world.room), np.random.default_rng(2)
    poses = held_still(world.spots_m[0], 1, generator)
    responses = room_responses(listener.scene, listener.device, poses, listener.air)
    received = render_frames(responses, listener.chirp, listener.device)[0]
    filtered = matched_envelope(received, listener.chirp)
    for metric, values in ((AMPLITUDE, received), (CORRELATION, filtered)):
        loudest = _loudest(values / np.abs(values).max())
        for at_ms, value in loudest:
            yield Record("received", metric, round(value, 3), condition=f"{at_ms:.2f} ms")


def _loudest(values: F32, each: int = 22, until: int = 2650) -> Iterator[tuple[float, float]]:
    """The value farthest from zero in every half millisecond of the first 60."""
    for start in range(0, min(until, len(values) - each), each):
        part = values[start : start + each]
        yield MS * start / ECHO_RATE_HZ, float(part[np.abs(part).argmax()])


def spectrograms() -> Iterator[Record]:
    """Echoes of three spots: two of them 10 cm apart, the third 2 m away."""
    world = load_world("lab")
    first = world.spots_m[row_of_spots(world.spots_m)[0]]
    last = world.spots_m[row_of_spots(world.spots_m)[2]]
    ahead = (last - first) / np.linalg.norm(last - first)
    listener, generator = listener_in(world.room), np.random.default_rng(3)
    for name, away_m in zip(SPOTS, (0.0, 0.1, 2.0), strict=True):
        poses = held_still(first + away_m * ahead, 1, generator)
        heard = hear_at(listener, poses, generator)
        yield from _tiles(name, spectrogram_db(heard), ECHO_RATE_HZ, pooled=2)


def spectrogram_db(samples: F32, *, whole: bool = False) -> F64:
    """Levels (bins, frames) of one trace (1, n) in dB below the loudest; the band's, or all."""
    if not whole:
        image = spectrogram(samples)[0]
    else:
        frames = np.lib.stride_tricks.sliding_window_view(samples[0], 96)[::48]
        image = np.abs(np.fft.rfft(frames * np.hanning(97)[:-1], axis=1)).T
    image_db = 20 * np.log10(np.maximum(image, 1e-9))
    return np.asarray(np.maximum(image_db - image_db.max(), -50.0))


def _tiles(name: str, image_db: F64, rate_hz: int, pooled: int = 1) -> Iterator[Record]:
    """A record for each bin and frame (mean of `pooled` frames), by time and frequency."""
    first = 0 if len(image_db) == 49 else 33
    frames = image_db[:, : image_db.shape[1] // pooled * pooled]
    means = frames.reshape(len(image_db), -1, pooled).mean(axis=2)
    for (row, column), level_db in np.ndenumerate(means):
        at_ms, khz = MS * column * pooled * 48 / rate_hz, (first + row) * rate_hz / 96 / 1000
        where = f"{at_ms:.1f} ms, {khz:.1f} kHz"
        yield Record(name, LEVEL_DB, round(float(level_db), 1), condition=where)


def footsteps_compared() -> Iterator[Record]:
    """Mean PSDs and ELFs of three footsteps over markers; the last is on the first's marker."""
    nodes, echoes = walk_over_markers(load_world("lab"), 2, np.random.default_rng(58))
    for name, encoder in ((PSD, generic_encoders()[PSD]), (ELF, shipped())):
        features = extract_features(echoes, encoder)
        for footstep in SHOWN:
            start_s, end_s = nodes.t_s[footstep : footstep + 2]
            mean = features.vectors[(features.t_s >= start_s) & (features.t_s < end_s)].mean(axis=0)
            for number, value in enumerate(mean):
                yield Record(
                    f"footstep {footstep}", name, round(float(value), 3), condition=str(number + 1)
                )


def trajectories(walk: SimulatedWalk) -> Iterator[Record]:
    """A walk by truth, dead reckoning, echoes, Wi-Fi and field, each fitted onto the truth."""
    recording, truth = simulated(walk, sensors=(Sensor.WIFI, Sensor.MAGNETIC))
    recording = at_its_start(recording, truth)
    settings = walkers(walk.seed, SURVEYOR)[CALIBRATED]
    echoes, nodes = extract_echoes(recording, settings), dead_reckoning_nodes(recording, settings)
    known = apply_acoustic_scale(nodes, echoes, settings)
    similarity = echo_sequence_similarity(extract_features(echoes, shipped()), known)
    closures = {ELF: (known, closures_by(known, [(similarity, settings.closure)], settings))}
    for item in (Modality.WIFI, Modality.MAGNETIC):
        sense = sense_of(item, settings)
        sensed = sense.similarity_of(recording, nodes), sense.closure
        closures[item.value] = nodes, closures_by(nodes, [sensed], settings)
    of = partial(_path, world=walk.world, scenario=SCENARIOS[walk.kind])
    yield from of(TRUE, truth.world_from_body[:, :2])
    for name, (walked, found) in {RECKONED: (nodes, NO_CLOSURES), **closures}.items():
        trajectory = optimise(build_graph(walked, found), walked.t_s, settings.graph)
        matched = match(trajectory.t_s, trajectory.world_from_body, truth)
        fitted = place(trajectory.world_from_body, placement(matched, Alignment.ALIGNED))
        yield from of(name, fitted[:, :2])


def matrix(walk: SimulatedWalk) -> Iterator[Record]:
    """Candidates and curated closures of a walk, and the trajectory that each leads to.

    All candidates are believed, without rejection of outliers, as the paper shows it.
    """
    recording, truth = simulated(walk, sensors=(Sensor.WIFI, Sensor.MAGNETIC))
    recording = at_its_start(recording, truth)
    settings = walkers(walk.seed, SURVEYOR)[CALIBRATED]
    nodes = dead_reckoning_nodes(recording, settings)
    features = extract_features(extract_echoes(recording, settings), shipped())
    similarity = echo_sequence_similarity(features, nodes)
    parameters = replace(CurationParameters(), threshold=settings.closure.threshold)
    every, curated = (
        all_candidates(similarity, parameters),
        curated_closures(similarity, nodes, parameters),
    )
    of = partial(_path, world=walk.world, scenario=SCENARIOS[walk.kind])
    graph = replace(settings.graph, robust=False)
    for name, closures in ((CANDIDATES, every), (CURATED, curated)):
        drawn = np.sort(np.random.default_rng(0).permutation(len(closures.i))[:MOST_CANDIDATES])
        for k in drawn:
            yield Record(
                name, LATER, float(closures.j[k]), world=walk.world,
                scenario=SCENARIOS[walk.kind], condition=f"{closures.i[k]}, pair {k}",
            )  # fmt: skip
        trajectory = optimise(build_graph(nodes, closures), nodes.t_s, graph)
        matched = match(trajectory.t_s, trajectory.world_from_body, truth)
        fitted = place(trajectory.world_from_body, placement(matched, Alignment.ALIGNED))
        yield from of(WITHOUT if name == CANDIDATES else CURATED, fitted[:, :2])


def all_candidates(similarity: AnySimilarity, parameters: CurationParameters) -> Closures:
    """Every pair of footsteps from the threshold on, as if they were at one place."""
    scores = similarity.scores
    i, j = np.nonzero(np.triu(scores >= parameters.threshold, parameters.near_footsteps))
    sigma = (parameters.along_sigma_m, parameters.across_sigma_m, parameters.heading_sigma_rad)
    covariance = np.tile(np.diag(np.square(sigma)), (len(i), 1, 1))
    return Closures(i, j, scores[i, j].astype(float), np.zeros((len(i), 3)), covariance)


def _path(name: str, xy_m: F64, *, world: str, scenario: str) -> Iterator[Record]:
    """Some points (n, 2) of a path, in its order."""
    rows = np.linspace(0, len(xy_m) - 1, min(POINTS, len(xy_m))).astype(int)
    for k, row in enumerate(rows):
        for metric, value in zip((X_M, Y_M), xy_m[row], strict=True):
            yield Record(name, metric, round(float(value), 2), world=world, scenario=scenario,
                         condition=str(k))  # fmt: skip


STUDY = Study(
    "What do excitation, echoes, similarity matrix and trajectories of the paper look like here?",
    measure_paper_figures, minutes=6, needs=("sklearn",),
    fast={"worlds": ("studio",), "matrix_world": "studio", "rounds": 2},
)  # fmt: skip
