"""Published pose graphs: how low the cost comes, and what false closures do to the answer.

The graphs and their best known costs are the field's own. False closures are put between poses
drawn at random, all pairs alike, and say that both are one place; their number is given as a share
of the true closures. The settings are the pipeline's defaults, and the same for every graph.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import gtsam
import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import PoseGraph, Truth
from elfslam.data.map_exports import read_g2o
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.stages.graph import GraphParameters, optimise
from elfslam.stages.graph.solving import as_gtsam, as_poses, as_values
from elfslam.stages.graph.uncertainty import half_square
from studies.results import Record, averaged
from studies.study import Study, StudyContext, finished

BEST_KNOWN = {
    "intel": 22.502, "manhattan": 1774.52, "ring": 5.5816, "ringCity": 131.409, "MIT": 20.603,
    "city10000": 255.994,
}  # fmt: skip
WITH_TRUTH = ("ring", "ringCity")
SHARES = (0.1, 0.3, 0.5)
SEEDS = tuple(range(5))
PLAIN = GraphParameters(robust=False, noise_rounds=0)
ROBUST = GraphParameters(noise_rounds=0)
"""Published information is taken at its word."""
OURS, PLAIN_LM, GNC = "ours", "Levenberg-Marquardt", "graduated non-convexity"
CHOOSING = "ours, choosing closures"
RMSE, WORST = "RMSE, aligned (m)", "worst RMSE, aligned (m)"
COST, EXCESS, SECONDS = "cost", "excess cost (%)", "time (s)"
CLEAN = "0 % false closures"

Solver = Callable[[PoseGraph], F64]


@dataclass(frozen=True)
class Attack:
    """False closures in one graph: their share of the true ones, and the seed that draws them."""

    name: str
    share: float
    seed: int


def measure_pose_graphs(
    context: StudyContext,
    *,
    names: Sequence[str] = tuple(BEST_KNOWN),
    attacked: Sequence[str] = WITH_TRUTH,
    seeds: Sequence[int] = SEEDS,
    methods: Sequence[str] = (OURS, PLAIN_LM, GNC),
) -> list[Record]:
    """Costs of clean graphs (half the sum of e' W e); then errors of attacked ones, by method."""
    assert context.data is not None
    folder = context.data / "pose_graphs"
    ours(read_g2o(folder / "ring.g2o"))  # compiles what is timed
    clean = [record for name in names for record in _clean(folder, name)]
    tasks = [Attack(name, share, seed) for name in attacked for share in SHARES for seed in seeds]
    walks = finished(partial(_attacked, folder, methods), tasks, context)
    return [*clean, *averaged(walks, seeds), *_worst(walks)]


def injected(graph: PoseGraph, share: float, seed: int) -> PoseGraph:
    """The graph with false closures more, `share` of its true ones, between random poses.

    Both ends are drawn from all poses; each false closure says that its two poses are one, as
    surely as the last true closure says what it says.
    """
    generator = np.random.default_rng(seed)
    wanted, wrong = round(share * graph.is_closure.sum()), np.zeros((0, 2), dtype=np.int64)
    while len(wrong) < wanted:
        pair = generator.integers(0, len(graph.initial), 2)
        if abs(pair[0] - pair[1]) > 1:
            wrong = np.vstack([wrong, pair])
    information = graph.information[graph.is_closure][-1]
    return PoseGraph(
        graph.initial,
        np.vstack([graph.edges, wrong]),
        np.vstack([graph.measurements, np.zeros((wanted, 3))]),
        np.concatenate([graph.information, np.tile(information, (wanted, 1, 1))]),
        np.concatenate([graph.is_closure, np.ones(wanted, dtype=np.bool_)]),
    )


def _solved(graph: PoseGraph, parameters: GraphParameters) -> F64:
    t_s = np.arange(len(graph.initial), dtype=np.float64)
    return optimise(graph, t_s, parameters).world_from_body


def ours(graph: PoseGraph) -> F64:
    """The pipeline's back end as it comes."""
    return _solved(graph, ROBUST)


def plain(graph: PoseGraph) -> F64:
    """Levenberg-Marquardt from the odometry, every closure accepted."""
    problem, start = as_gtsam(graph, PLAIN.anchor_sigma), as_values(graph.initial)
    solved = gtsam.LevenbergMarquardtOptimizer(problem, start).optimize()
    return as_poses(solved, len(graph.initial))


def graduated(graph: PoseGraph) -> F64:
    """GTSAM's graduated non-convexity with the odometry as known inliers (Yang et al. 2020)."""
    problem, start = as_gtsam(graph, PLAIN.anchor_sigma), as_values(graph.initial)
    settings = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
    settings.setLossType(gtsam.GncLossType.TLS)
    trusted = [*np.flatnonzero(~graph.is_closure), len(graph.edges)]
    settings.setKnownInliers([int(k) for k in trusted])
    optimizer = gtsam.GncLMOptimizer(problem, start, settings)
    optimizer.setInlierCostThresholdsAtProbability(ROBUST.inlier_probability)
    return as_poses(optimizer.optimize(), len(graph.initial))


SOLVERS: Mapping[str, Solver] = {OURS: ours, PLAIN_LM: plain, GNC: graduated}


def _timed(solver: Solver, graph: PoseGraph) -> tuple[F64, float]:
    start = time.perf_counter()
    poses = solver(graph)
    return poses, time.perf_counter() - start


def _clean(folder: Path, name: str) -> list[Record]:
    """Cost and time from the odometry guess, closures all accepted or chosen; the graph's size."""
    graph = _read(folder / f"{name}.g2o")
    sizes = {"poses": len(graph.initial), "closures": int(graph.is_closure.sum())}
    found = [Record("graph", metric, float(size), world=name) for metric, size in sizes.items()]
    accepting = partial(_solved, parameters=PLAIN)
    solvers: dict[str, Solver] = {OURS: accepting, PLAIN_LM: plain, CHOOSING: ours}
    for method, solver in solvers.items():
        poses, seconds = _timed(solver, graph)
        cost = half_square(graph, poses)
        found += [
            Record(method, COST, cost, paper=BEST_KNOWN[name], world=name),
            Record(method, EXCESS, 100 * (cost / BEST_KNOWN[name] - 1), world=name),
            Record(method, SECONDS, seconds, world=name),
        ]
    return found


def _attacked(folder: Path, methods: Sequence[str], attack: Attack) -> list[Record]:
    """The error without false closures, then by method its error and seconds with them."""
    clean = _read(folder / f"{attack.name}.g2o")
    of = Record(PLAIN_LM, RMSE, _error_m(folder, attack.name, plain(clean)), world=attack.name,
                condition=CLEAN)  # fmt: skip
    found, condition = [of], f"{attack.share:.0%} false closures".replace("%", " %")
    for method in methods:
        poses, seconds = _timed(SOLVERS[method], injected(clean, attack.share, attack.seed))
        of = replace(of, method=method, condition=condition)
        error_m = _error_m(folder, attack.name, poses)
        found += [replace(of, value=error_m), replace(of, metric=SECONDS, value=seconds)]
    return found


def _worst(walks: Sequence[Sequence[Record]]) -> list[Record]:
    """The greatest error over the seeds, where closures are false."""
    worst: dict[Record, float] = {}
    for record in (record for walk in walks for record in walk):
        if record.metric == RMSE and record.condition != CLEAN:
            of = replace(record, metric=WORST, value=0.0)
            worst[of] = max(worst.get(of, 0.0), record.value)
    return [replace(of, value=value) for of, value in worst.items()]


def _error_m(folder: Path, name: str, poses: F64) -> float:
    true = read_g2o(folder / f"{name}.truth.g2o").initial
    t_s = np.arange(len(true), dtype=np.float64)
    errors_m = position_errors(t_s, poses, Truth(t_s, true), Alignment.ALIGNED)
    return float(np.sqrt(np.mean(errors_m**2)))


@cache
def _read(file: Path) -> PoseGraph:
    return read_g2o(file)


STUDY = Study(
    "How low does the cost of published pose graphs come, and what do false closures do?",
    measure_pose_graphs, minutes=40, long=True, data=("pose_graphs",),
    fast={"names": ("ring", "MIT"), "attacked": ("ring",), "seeds": (100,),
          "methods": (OURS, PLAIN_LM)},
)  # fmt: skip
