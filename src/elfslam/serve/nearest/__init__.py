"""Nearest spots among the ELFs of many maps: an index on disk, and the vote for a map."""

from __future__ import annotations

from elfslam.serve.nearest.build import absorb, add_map, build_index, remove_map
from elfslam.serve.nearest.folder import NearestParameters, newest_revision, read_meta
from elfslam.serve.nearest.search import (
    Index,
    MapCandidate,
    Naming,
    VoteParameters,
    exact_search,
    open_index,
    which_map,
)

__all__ = [
    "Index",
    "MapCandidate",
    "Naming",
    "NearestParameters",
    "VoteParameters",
    "absorb",
    "add_map",
    "build_index",
    "exact_search",
    "newest_revision",
    "open_index",
    "read_meta",
    "remove_map",
    "which_map",
]
