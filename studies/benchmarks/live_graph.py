"""How long the live graph takes for a footstep and for a closure, up to 6,000 poses.

Usage, from the root of the project:

    python -m studies.benchmarks.live_graph [--poses N]

Processor milliseconds on one thread over the last 500 footsteps, of a walk in rounds of 300
footsteps that meets a known place at every tenth.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from elfslam.base.geometry import between, chain
from elfslam.line.graph import GraphParameters
from elfslam.line.graph.live_graph import Closure, LiveGraph

LAP, CLOSING_EVERY, COUNTED = 300, 10, 500
SIGMA = np.array([0.07, 0.035, 0.02])
COVARIANCE = np.diag([0.18, 0.18, 0.18]) ** 2


def main() -> None:
    """Print median and worst."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=6000)
    count = parser.parse_args().poses
    generator = np.random.default_rng(0)
    truth = chain(np.zeros(3), np.tile([0.7, 0.0, 2 * np.pi / LAP], (count, 1)))
    moves = between(truth[:-1], truth[1:]) + 0.3 * generator.normal(size=(count, 3)) * SIGMA
    live = LiveGraph(truth[0], GraphParameters())
    steps_ms, closures_ms = [], []
    for k, move in enumerate(moves, start=1):
        start = time.process_time()
        live.step(move, SIGMA)
        steps_ms.append(1000 * (time.process_time() - start))
        if k >= LAP and k % CLOSING_EVERY == 0:
            start = time.process_time()
            live.close(Closure(k - LAP, k, between(truth[k - LAP], truth[k]), COVARIANCE))
            closures_ms.append(1000 * (time.process_time() - start))
    counted = {
        "footstep": steps_ms[-COUNTED:],
        "closure": closures_ms[-COUNTED // CLOSING_EVERY :],
    }
    for name, taken in counted.items():
        print(f"{name}: median {np.median(taken):.1f} ms, worst {max(taken):.1f} ms")
    print(f"{len(live)} poses, {len(live.believed)} closures believed")


if __name__ == "__main__":
    main()
