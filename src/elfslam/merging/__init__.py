"""Walks become one map: how they lie to each other, one pose graph, and what ages in it."""

from elfslam.merging.grow import Joined, Merged, add_walk, merge
from elfslam.merging.parameters import MergeParameters
from elfslam.merging.sides import Walk, walk_of

__all__ = ["Joined", "MergeParameters", "Merged", "Walk", "add_walk", "merge", "walk_of"]
