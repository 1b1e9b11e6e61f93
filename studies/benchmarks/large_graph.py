"""Robust pose graph optimisation of a city: seconds and errors by the share of false closures.

Usage, from the root of the project:

    python -m studies.benchmarks.large_graph [--poses 10000] [--graduated]

A walk through the streets of a grid, as many true closures as poses, and false ones between random
poses besides: the size of the published graph city10000, with truth. Beside it stands GTSAM's
Levenberg-Marquardt that accepts every closure, and, if asked for, its graduated non-convexity.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from elfslam.app.console import print_rows, say
from elfslam.base.arrays import F64, I64
from elfslam.base.geometry import between, chain
from elfslam.base.values import PoseGraph
from elfslam.stages.graph import optimise
from studies.pose_graphs import GNC, PLAIN_LM, ROBUST, SOLVERS

SHARES = (0.0, 0.1, 0.3, 0.5)
SIGMA = np.array([0.05, 0.05, 0.02])
"""Of steps and of closures: along, across (m) and heading (rad); a step is a metre."""
APART = 20
"""Poses fewer steps apart than this close no loop."""


@dataclass(frozen=True)
class City:
    """A pose graph, the true poses (n, 3), and how many of its closures, the first, are true."""

    graph: PoseGraph
    world_from_body: F64
    true_closures: int


def main() -> None:
    """Print a row per share of false closures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--graduated", action="store_true", help="GTSAM's GNC too: minutes")
    asked = parser.parse_args()
    solved(city(400, 400, 0.1, np.random.default_rng(1)))  # compiles what is timed
    rows = []
    for share in SHARES:
        each = city(asked.poses, asked.poses, share, np.random.default_rng(0))
        baselines = (PLAIN_LM, GNC) if asked.graduated else (PLAIN_LM,)
        rows.append({"false (%)": round(100 * share)} | solved(each) | solved_by(each, baselines))
        say(str(rows[-1]))
    print_rows(rows, title=f"A city of {asked.poses} poses", as_json=False)


def city(poses: int, closures: int, false_share: float, generator: np.random.Generator) -> City:
    """A walk of metre steps along streets, with true closures and false ones among them.

    `false_share` is that of all closures; a false one says that its two poses are one.
    """
    true = streets(poses, generator)
    steps = between(true[:-1], true[1:]) + SIGMA * generator.normal(size=(poses - 1, 3))
    met = cKDTree(true[:, :2]).query_pairs(1.1, output_type="ndarray").astype(np.int64)
    met = generator.permutation(met[met[:, 1] - met[:, 0] > APART])[:closures]
    told = between(true[met[:, 0]], true[met[:, 1]])
    told = told + SIGMA * generator.normal(size=told.shape)
    wrong = pairs_apart(poses, round(len(met) * false_share / (1 - false_share)), generator)
    walked = np.column_stack([np.arange(poses - 1), np.arange(1, poses)])
    edges = np.vstack([walked, met, wrong])
    measured = np.vstack([steps, told, np.zeros((len(wrong), 3))])
    information = np.tile(np.diag(1 / SIGMA**2), (len(edges), 1, 1))
    is_closure = np.arange(len(edges)) >= poses - 1
    graph = PoseGraph(chain(true[0], steps), edges, measured, information, is_closure)
    return City(graph, true, len(met))


def streets(poses: int, generator: np.random.Generator) -> F64:
    """Poses (n, 3) a metre apart along the streets of a square town, that turn at crossings."""
    ahead = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    half_m, at, quarter = int(np.sqrt(poses) / 2), np.zeros(2, dtype=np.int64), 0
    walked = [(0.0, 0.0, 0.0)]
    while len(walked) < poses:
        turned = (quarter + generator.choice([0, 0, 0, 0, 0, 0, 1, -1])) % 4
        further = at + ahead[turned]
        if np.abs(further).max() > half_m:
            quarter = (quarter + 1) % 4
            continue
        at, quarter = further, turned
        walked.append((float(at[0]), float(at[1]), quarter * np.pi / 2))
    return np.array(walked)


def pairs_apart(poses: int, count: int, generator: np.random.Generator) -> I64:
    """So many pairs (k, 2) of random poses that could close a loop, the earlier one first."""
    drawn = np.sort(generator.integers(0, poses, (2 * count + 100, 2)), axis=1)
    return drawn[drawn[:, 1] - drawn[:, 0] > APART][:count]


def solved(each: City) -> dict[str, object]:
    """Seconds of our back end, what it kept of true and false closures, and its error."""
    begun_s = time.perf_counter()
    answer = optimise(each.graph, np.arange(len(each.world_from_body), dtype=np.float64), ROBUST)
    seconds = time.perf_counter() - begun_s
    kept = answer.closure_weights > 0.5
    return {
        "seconds": round(seconds, 1),
        "true kept": round(float(kept[: each.true_closures].mean()), 4),
        "false kept": int(kept[each.true_closures :].sum()),
        "error (m)": round(error_m(each, answer.world_from_body), 2),
    }


def solved_by(each: City, baselines: Sequence[str]) -> dict[str, object]:
    """Seconds and error of other solvers."""
    row: dict[str, object] = {}
    for name in baselines:
        begun_s = time.perf_counter()
        poses = SOLVERS[name](each.graph)
        row[f"{name}, seconds"] = round(time.perf_counter() - begun_s, 1)
        row[f"{name} (m)"] = round(error_m(each, poses), 2)
    return row


def error_m(each: City, poses: F64) -> float:
    """Root mean square distance from the truth, both anchored at the first pose."""
    apart = (poses - each.world_from_body)[:, :2]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


if __name__ == "__main__":
    main()
