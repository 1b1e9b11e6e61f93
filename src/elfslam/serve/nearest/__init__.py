"""Nearest spots among the ELFs of many maps: an index on disk, and the vote for a map."""

from __future__ import annotations

from elfslam.serve.nearest.build import build_index
from elfslam.serve.nearest.changes import absorb, add_map, remove_map
from elfslam.serve.nearest.exact import exact_search
from elfslam.serve.nearest.folder import newest_revision, read_meta, verify
from elfslam.serve.nearest.parameters import NearestParameters
from elfslam.serve.nearest.search import Index, open_index
from elfslam.serve.nearest.vote import MapCandidate, Naming, VoteParameters, which_map

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
    "verify",
    "which_map",
]
