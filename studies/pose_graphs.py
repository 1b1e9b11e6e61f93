"""Published pose graphs: how low the cost comes, and what false closures do to the answer.

The graphs and their best known costs are the field's own. False closures are put between poses
drawn at random, all pairs alike, and say that both are one place; their number is given as a share
of the true closures. The settings are the line's defaults, and the same for every graph.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import gtsam
import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import PoseGraph, Truth
from elfslam.data.g2o import read_g2o
from elfslam.line.graph import GraphParameters, optimise
from elfslam.line.graph.solving import as_gtsam, as_poses, as_values
from elfslam.line.graph.uncertainty import half_square
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.graph_figures import Drawn, graphs_figure
from studies.finding import Finding, Given, Row
from studies.repeats import Numbers, finished

BEST_KNOWN = {
    "intel": 22.502,
    "manhattan": 1774.52,
    "ring": 5.5816,
    "ringCity": 131.409,
    "MIT": 20.603,
}
WITH_TRUTH = ("ring", "ringCity")
SHARES = (0.1, 0.3, 0.5)
SEEDS = tuple(range(5))
PLAIN = GraphParameters(robust=False, noise_rounds=0)
ROBUST = GraphParameters(noise_rounds=0)
"""Published information is taken at its word."""
PICTURED_SHARE, PICTURED_SEED = 0.5, 0
NOTE_ATTACKED = (
    f"{PICTURED_SHARE:.0%} of false closures (seed {PICTURED_SEED}); each picture to its own scale."
)

Solver = Callable[[PoseGraph], F64]


@dataclass(frozen=True)
class Attack:
    """False closures in one graph: their share of the true ones, and the seed that draws them."""

    name: str
    share: float
    seed: int


def measure_pose_graphs(
    given: Given,
    *,
    names: Sequence[str] = tuple(BEST_KNOWN),
    attacked: Sequence[str] = WITH_TRUTH,
    seeds: Sequence[int] = SEEDS,
    solvers: Mapping[str, Solver] | None = None,
) -> Finding:
    """Costs of clean graphs, then errors of attacked ones, beside plain solving and GTSAM's GNC.

    The keywords take a part of it; `solvers` are measured under attack in place of ours, plain and
    GNC. Raises InputError without the real recordings.
    """
    if given.data is None:
        raise InputError("study pose-graphs: needs the real recordings; set ELFSLAM_DATA")
    folder = given.data / "pose_graphs"
    ours(read_g2o(folder / "ring.g2o"))  # compiles what is timed
    graphs = {name: _read(folder / f"{name}.g2o") for name in {*names, *attacked}}
    clean = [_clean_row(name, graphs[name]) for name in names]
    tasks = [Attack(name, share, seed) for name in attacked for share in SHARES for seed in seeds]
    measure = partial(_measured, folder, solvers or SOLVERS)
    numbers = finished(measure, tasks, given)
    rows = _attack_rows(tasks, numbers)
    pictures = _pictures({name: graphs[name] for name in names})
    attacks = _attacked_pictures(folder, attacked[-1])
    panels = [
        Panel("Before and after", graphs_figure(pictures, len(names)), wide=True),
        Panel(
            f"False closures in {attacked[-1]}",
            graphs_figure(attacks, len(attacks)),
            NOTE_ATTACKED,
            wide=True,
        ),
        Panel("Cost", rows_table(clean), "Half the sum of e' W e, as GTSAM counts it.", wide=True),
        Panel(
            "Error with false closures", rows_table(rows), "Root mean square, metres.", wide=True
        ),
    ]
    subtitle = "From odometry alone; one set of parameters for all"
    return Finding(_padded(clean, rows), Page("Published pose graphs", subtitle, panels))


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
    """The line's back end as it comes."""
    return _solved(graph, ROBUST)


def plain(graph: PoseGraph) -> F64:
    """Levenberg-Marquardt from the odometry, every closure believed."""
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


SOLVERS: Mapping[str, Solver] = {"ours": ours, "plain": plain, "GNC": graduated}


def _timed(solver: Solver, graph: PoseGraph) -> tuple[F64, float]:
    start = time.perf_counter()
    poses = solver(graph)
    return poses, time.perf_counter() - start


def _clean_row(name: str, graph: PoseGraph) -> Row:
    """Cost from the odometry guess, with every closure believed."""

    poses, ours_s = _timed(partial(_solved, parameters=PLAIN), graph)
    rival, plain_s = _timed(plain, graph)
    cost = half_square(graph, poses)
    return {
        "set": name,
        "poses": len(graph.initial),
        "closures": int(graph.is_closure.sum()),
        "cost": round(cost, 4),
        "best known": BEST_KNOWN[name],
        "excess (%)": round(100 * (cost / BEST_KNOWN[name] - 1), 2) + 0.0,
        "plain LM": round(half_square(graph, rival), 4),
        "seconds": round(ours_s, 2),
        "seconds, plain LM": round(plain_s, 2),
    }


def _error_m(folder: Path, name: str, poses: F64) -> float:
    true = read_g2o(folder / f"{name}.truth.g2o").initial
    t_s = np.arange(len(true), dtype=np.float64)
    errors_m = position_errors(t_s, poses, Truth(t_s, true), Alignment.ALIGNED)
    return float(np.sqrt(np.mean(errors_m**2)))


@cache
def _read(file: Path) -> PoseGraph:
    return read_g2o(file)


def _measured(folder: Path, solvers: Mapping[str, Solver], attack: Attack) -> Numbers:
    """The error without false closures, then per solver its error and seconds."""
    clean = _read(folder / f"{attack.name}.g2o")
    found = {"clean": _error_m(folder, attack.name, plain(clean))}
    for name, solver in solvers.items():
        poses, seconds = _timed(solver, injected(clean, attack.share, attack.seed))
        found |= {name: _error_m(folder, attack.name, poses), f"{name}, seconds": seconds}
    return found


def _attack_rows(tasks: Sequence[Attack], numbers: Sequence[Numbers]) -> list[Row]:
    """A row per graph and share: the mean of each number over the seeds, and the worst error."""
    groups: dict[tuple[str, float], list[Numbers]] = {}
    for task, found in zip(tasks, numbers, strict=True):
        groups.setdefault((task.name, task.share), []).append(found)
    rows: list[Row] = []
    for (name, share), each in groups.items():
        row: Row = {"set": name, "false (%)": round(100 * share), "seeds": len(each)}
        for key in each[0]:
            values = [found[key] for found in each]
            row[key] = round(float(np.mean(values)), 3)
            if key != "clean" and "seconds" not in key:
                row[f"{key}, worst"] = round(max(values), 3)
        rows.append(row)
    return rows


def _padded(*tables: list[Row]) -> list[Row]:
    """Tables of different columns as one."""
    names = list(dict.fromkeys(name for rows in tables for row in rows for name in row))
    return [{name: row.get(name) for name in names} for rows in tables for row in rows]


def _pictures(graphs: Mapping[str, PoseGraph]) -> list[Drawn]:
    """Each graph as its odometry has it, and below as it is solved."""
    before, after = [], []
    for name, graph in graphs.items():
        solved = _solved(graph, PLAIN)[:, :2]
        before.append(Drawn(name, {"odometry": graph.initial[:, :2]}, {}, solved))
        after.append(Drawn("", {"solved": solved}, {}, solved))
    return [*before, *after]


def _attacked_pictures(folder: Path, name: str) -> list[Drawn]:
    """A graph with its truth, what is claimed of it, and what becomes of it."""
    graph = read_g2o(folder / f"{name}.g2o")
    attacked = injected(graph, PICTURED_SHARE, PICTURED_SEED)
    true = read_g2o(folder / f"{name}.truth.g2o").initial[:, :2]
    wrong = attacked.edges[len(graph.edges) :]
    poses, rival = ours(attacked)[:, :2], plain(attacked)[:, :2]
    return [
        Drawn("odometry", {"odometry": graph.initial[:, :2]}, {}, true),
        Drawn("truth, false closures", {"truth": true}, {"false closures": wrong}, true),
        Drawn("all believed", {"solved": rival}, {}, rival),
        Drawn("ours", {"truth": true, "solved": poses}, {}, poses),
    ]
