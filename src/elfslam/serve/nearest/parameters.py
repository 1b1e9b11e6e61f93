"""How an index is built and searched."""

from __future__ import annotations

from dataclasses import dataclass

from elfslam.base.errors import ParameterError
from elfslam.base.parameters import parameter

KINDS = ("flat", "ivf-flat", "ivf-pq", "hnsw")


@dataclass(frozen=True)
class NearestParameters:
    """How an index is built and searched; `effort` is what a search can be asked to change.

    The kinds: flat looks at every spot (no extra needed); ivf-flat looks at the cells next to the
    query (Sivic and Zisserman, ICCV 2003), ivf-pq at codes in them (Jegou et al., TPAMI 33, 2011);
    hnsw walks along a graph of neighbours (Malkov and Yashunin, TPAMI 42, 2020).
    """

    kind: str = parameter("ivf-flat", "", f"{', '.join(KINDS[:-1])} or {KINDS[-1]}")
    cells: int = parameter(
        0, "", "cells of an ivf index; 0: the power of two above the root of the spots", low=0
    )
    effort: int = parameter(
        32, "", "cells (ivf) or open ends (hnsw) that a search looks at", low=1, high=65536
    )
    code_bytes: int = parameter(32, "bytes", "of a spot's code in ivf-pq", low=1, high=128)
    refine: int = parameter(
        0, "", "candidates for each answer of ivf-pq that are compared in full; 0: none", low=0
    )
    links: int = parameter(16, "", "neighbours of a spot in hnsw", low=4, high=128)
    breadth: int = parameter(80, "", "open ends while an hnsw index is built", low=8, high=2000)
    examples: int = parameter(40, "", "spots per cell that the cells are learnt from", low=1)
    seed: int = parameter(0, "", "of the choice of these", low=0)


def checked(parameters: NearestParameters, size: int) -> NearestParameters:
    """The same parameters. Raises ParameterError where they do not go with vectors of `size`."""
    if parameters.kind not in KINDS:
        raise ParameterError(
            f"nearest.kind: wanted {', '.join(KINDS)}, got {parameters.kind!r}; name one of them"
        )
    if parameters.kind == "ivf-pq" and size % parameters.code_bytes:
        raise ParameterError(
            f"nearest.code_bytes: wanted a divisor of {size}, got {parameters.code_bytes}; "
            "for example 32"
        )
    return parameters
