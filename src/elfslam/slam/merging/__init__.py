"""Walks become one map: how they lie to each other, one pose graph, and what ages in it."""

from elfslam.slam.merging.grow import Joined, Merged, add_walk, lay_walk, merge
from elfslam.slam.merging.members import MappedWalk, MergeParameters, walk_of

__all__ = [
    "Joined",
    "MappedWalk",
    "MergeParameters",
    "Merged",
    "add_walk",
    "lay_walk",
    "merge",
    "walk_of",
]
