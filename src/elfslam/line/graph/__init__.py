"""The pose graph: dead reckoning and closures together, and which closures to believe."""

from elfslam.line.graph.build import build_graph
from elfslam.line.graph.choose import agreeing
from elfslam.line.graph.optimise import optimise
from elfslam.line.graph.parameters import GraphParameters
from elfslam.line.graph.verdict import Verdict, judge

__all__ = ["GraphParameters", "Verdict", "agreeing", "build_graph", "judge", "optimise"]
