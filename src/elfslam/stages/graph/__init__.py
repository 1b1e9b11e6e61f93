"""Pose graph of dead reckoning and closures: which closures to accept, and its optimisation."""

from elfslam.stages.graph.building import GraphParameters, build_graph
from elfslam.stages.graph.solving import agreeing, expected, optimise
from elfslam.stages.graph.uncertainty import judge

__all__ = ["GraphParameters", "agreeing", "build_graph", "expected", "judge", "optimise"]
