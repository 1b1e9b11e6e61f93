"""How good the map is that a phone draws while a walk is recorded, beside the map made of it.

Usage, from the root of the project:

    python -m studies.benchmarks.growing_map [--walks 5]

Surveyors' walks in rooms and a hall for development, their motion and echoes through the page's own
modules in node. Prints median aligned errors (m) over footsteps and walks of dead reckoning, of the
page's map by the shipped encoder and by a plain spectrogram, and of the line's map of the whole
walk. Needs node.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from statistics import median

import numpy as np

from elfslam.app.console import print_rows
from elfslam.base.arrays import F64
from elfslam.base.values import Recording, Truth
from elfslam.line.feature import Encoder, SpectralEncoder, extract_features, load_encoder
from elfslam.scoring.alignment import Alignment, match, place, placement
from elfslam.slam.front_end import hear
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.simulate import load_world, simulate
from studies.benchmarks.page_motion import in_node, readings

WORLDS = {"studio": 3, "lounge": 3, "concourse": 2}
FIRST_SEED = 100
PLAIN_THRESHOLD = 0.5
"""Of a plain spectrogram, as chosen on these worlds (`python -m studies thresholds`)."""
KNOWN = Parameters()


def main() -> None:
    """A row for each world."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--walks", type=int, default=5)
    walks: int = parser.parse_args().walks
    rows = [row_of(name, rounds, walks) for name, rounds in WORLDS.items()]
    print_rows(rows, title="The map that grows, median aligned error (m)", as_json=False)


def row_of(name: str, rounds: int, walks: int) -> dict[str, object]:
    """The errors of walks in one world, in the middle."""
    world = load_world(name)
    seeds = range(FIRST_SEED, FIRST_SEED + walks)
    found = [errors(*simulate(world, seed, rounds=rounds)) for seed in seeds]
    return {"world": name} | {key: median(each[key] for each in found) for key in found[0]}


def errors(recording: Recording, truth: Truth) -> dict[str, float]:
    """Of one walk, by each way of mapping it."""
    encoder = load_encoder("compact")
    run = map_by_echoes(recording, encoder, KNOWN)
    closure = asdict(KNOWN.closure)
    plain = closure | {"threshold": PLAIN_THRESHOLD}
    return {
        "reckoned": error_m(run.odometry.t_s, run.odometry.world_from_body, truth),
        "growing, ELF": error_m(*grown(recording, encoder, closure), truth),
        "growing, plain": error_m(*grown(recording, SpectralEncoder(), plain), truth),
        "map, ELF": error_m(run.trajectory.t_s, run.trajectory.world_from_body, truth),
    }


def grown(recording: Recording, encoder: Encoder, closure: dict[str, object]) -> tuple[F64, F64]:
    """Times and poses of the page's map as the walk ends."""
    assert recording.imu is not None
    features = extract_features(hear(recording, KNOWN), encoder)
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
    matched = match(t_s, poses, truth)
    placed = place(matched.estimate, placement(matched, Alignment.ALIGNED))
    return float(np.median(np.linalg.norm(placed[:, :2] - matched.truth[:, :2], axis=1)))


if __name__ == "__main__":
    main()
