"""Straightening a walk by its closures, in the frame of its start or of a plan that was tapped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import Bool
from elfslam.base.values import Checkpoints, Closures, Odometry, Trajectory
from elfslam.slam.parameters import Parameters
from elfslam.stages.checkpoints import OnPlan, lies_on_plan, on_plan
from elfslam.stages.closure import joined
from elfslam.stages.graph import build_graph, optimise


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
    return replace(
        solved,
        t_s=solved.t_s[1:],
        world_from_body=solved.world_from_body[1:],
        covariance=solved.covariance[1:],
        closure_weights=solved.closure_weights[: len(closures.i)],
    )
