"""How long closures and graph take for a walk of hours, and how much memory.

Usage, from the root of the project:

    python -m studies.benchmarks.long_walk [--hours 2]

Features are planted: each of 400 places of a round trip has a random vector, heard with noise. The
matrix of all footsteps with all others would be `dense`; it is never made.
"""

import argparse
import resource
import time

import numpy as np

from elfslam.base.geometry import between, chain
from elfslam.base.values import MeanSimilarity, Odometry
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import closures_by
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.graph import GraphParameters, build_graph, optimise

LAP, STEP_S, DIMENSIONS = 400, 0.5, 128
SIGMA = np.array([0.05, 0.03, 0.004])


def main() -> None:
    """Print seconds and peak memory of each stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=2.0)
    count = round(parser.parse_args().hours * 3600 / STEP_S)
    generator = np.random.default_rng(0)
    truth = chain(np.zeros(3), np.tile([0.7, 0.0, 2 * np.pi / LAP], (count, 1)))
    moves = between(truth[:-1], truth[1:]) + generator.normal(size=(count, 3)) * SIGMA
    sigma = np.tile(SIGMA, (count, 1))
    nodes = Odometry(STEP_S * np.arange(count + 1), chain(truth[0], moves), sigma)
    places = generator.normal(size=(LAP, DIMENSIONS))
    heard = places[np.arange(count) % LAP] + 0.7 * generator.normal(size=(count, DIMENSIONS))
    heard /= np.linalg.norm(heard, axis=1)[:, None]
    similarity = MeanSimilarity(heard.astype(np.float32), kind="planted")
    print(
        f"{count} footsteps; dense: {count**2 * 4 / 2**30:.2f} GiB; before: {_peak_gib():.2f} GiB"
    )
    start = time.perf_counter()
    closures = closures_by(nodes, [(similarity, ClosureParameters())], Parameters())
    print(
        f"closures: {len(closures.i)}, {time.perf_counter() - start:.1f} s, {_peak_gib():.2f} GiB"
    )
    start = time.perf_counter()
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, GraphParameters())
    error_m = np.linalg.norm((trajectory.world_from_body - truth)[:, :2], axis=1)
    print(f"graph: {time.perf_counter() - start:.1f} s, {_peak_gib():.2f} GiB")
    print(f"median error {np.median(error_m):.2f} m, dead reckoning {_drift_m(nodes, truth):.2f} m")


def _peak_gib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _drift_m(nodes: Odometry, truth: np.ndarray) -> float:
    return float(np.median(np.linalg.norm((nodes.world_from_body - truth)[:, :2], axis=1)))


if __name__ == "__main__":
    main()
