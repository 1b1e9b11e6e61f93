"""How good the map is that a phone draws while a walk is recorded, beside the map made of it.

Walks in rooms and a hall for development, their motion and echoes through the page's own modules in
node; the pipeline's map of the whole walk stands beside it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from statistics import median

import numpy as np

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.values import Recording, Truth
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.slam.pipeline import map_by_echoes
from elfslam.stages.feature import Encoder, SpectralEncoder, load_encoder
from elfslam.world.simulate import load_world
from studies.cached import SCENARIOS, extract_echoes, extract_features, simulate
from studies.live_footsteps import in_node, readings
from studies.results import Record, seeds_text
from studies.study import Study, StudyContext

WORLDS = {"studio": 3, "lounge": 3, "concourse": 2}
"""By world the rounds of a walk."""
FIRST_SEED, WALKS = 100, 5
PLAIN_THRESHOLD = 0.5
"""Of a plain spectrogram, as chosen on these worlds (`python -m studies thresholds`)."""
METRIC = "median error, aligned (m)"
KNOWN = Settings()


def measure_growing_map(
    context: StudyContext, *, worlds: Mapping[str, int] = WORLDS, walks: int = WALKS
) -> Iterator[Record]:
    """The median over walks of the median error of footsteps, by way of mapping."""
    seeds = range(FIRST_SEED, FIRST_SEED + walks)
    for name, rounds in worlds.items():
        world = load_world(name)
        found = [errors(*simulate(world, seed, rounds=rounds)) for seed in seeds]
        for method in found[0]:
            yield Record(
                method, METRIC, median(each[method] for each in found), world=name,
                scenario=SCENARIOS["quiet"], seeds=seeds_text(seeds),
            )  # fmt: skip


def errors(recording: Recording, truth: Truth) -> dict[str, float]:
    """Of one walk, by each way of mapping it."""
    encoder = load_encoder("compact")
    run = map_by_echoes(recording, encoder, KNOWN)
    closure = asdict(KNOWN.closure)
    plain = closure | {"threshold": PLAIN_THRESHOLD}
    return {
        "dead reckoning": error_m(run.odometry.t_s, run.odometry.world_from_body, truth),
        "growing map, ELF": error_m(*grown(recording, encoder, closure), truth),
        "growing map, spectrogram": error_m(*grown(recording, SpectralEncoder(), plain), truth),
        "map of the whole walk, ELF": error_m(
            run.trajectory.t_s, run.trajectory.world_from_body, truth
        ),
    }


def grown(recording: Recording, encoder: Encoder, closure: dict[str, object]) -> tuple[F64, F64]:
    """Times and poses of the page's map as the walk ends."""
    assert recording.imu is not None
    features = extract_features(extract_echoes(recording, KNOWN), encoder)
    told = in_node(
        "sketch",
        {
            "imu": readings(recording.imu),
            "motion": asdict(KNOWN.motion),
            "closure": closure,
            "fewest": KNOWN.locate.fewest_echoes,
            "heard": {"tS": features.t_s.tolist(), "vectors": features.vectors.tolist()},
        },
    )
    return np.array(told["tS"]), np.array(told["poses"]).reshape(-1, 3)


def error_m(t_s: F64, poses: F64, truth: Truth) -> float:
    """The median distance of footsteps from where they were, after the best rigid fit."""
    return float(np.median(position_errors(t_s, poses, truth, Alignment.ALIGNED)))


STUDY = Study(
    "How good is the map that grows on the phone, beside dead reckoning and the map made of it?",
    measure_growing_map, minutes=10, fast={"worlds": {"studio": 2}, "walks": 1},
)  # fmt: skip
