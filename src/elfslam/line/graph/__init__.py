"""Pose graph optimisation: dead reckoning and closures together, and which closures to believe."""

from elfslam.line.graph.building import GraphParameters, build_graph
from elfslam.line.graph.choosing import agreeing
from elfslam.line.graph.solving import optimise
from elfslam.line.graph.uncertainty import judge

__all__ = ["GraphParameters", "agreeing", "build_graph", "judge", "optimise"]
