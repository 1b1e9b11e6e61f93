"""Pose graph optimisation: dead reckoning and closures together, and which closures to believe."""

from elfslam.stages.graph.building import GraphParameters, build_graph
from elfslam.stages.graph.solving import agreeing, optimise
from elfslam.stages.graph.uncertainty import judge

__all__ = ["GraphParameters", "agreeing", "build_graph", "judge", "optimise"]
