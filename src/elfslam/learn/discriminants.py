"""Linear discriminants behind the network: what tells places apart, whatever a visit changes.

Fisher's discriminants (1936; Rao 1948) of an ELF beside its log plane, as speakers are told apart
whatever their channel (within-class covariance normalisation, Hatch et al. 2006). Both lose the
mean of their visit first, as a walk's features lose theirs (`line.feature.centred`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg import eigh

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ELF_SIZE, EchoPairs
from elfslam.learn.network import CompactEncoder, Discriminants, beside
from elfslam.line.feature import BINS

RIDGE = 0.01
"""Of the mean variance within pairs, added to that of every direction."""
LEAST_TOLD = 1e-3


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over pairs: of vectors (d), of squares within pairs and over all places (d, d)."""

    count: int
    vectors: F64
    within: F64
    over_all: F64

    def __add__(self, other: Moments) -> Moments:
        return Moments(
            self.count + other.count,
            self.vectors + other.vectors,
            self.within + other.within,
            self.over_all + other.over_all,
        )


def with_discriminants(network: CompactEncoder, batches: Iterable[EchoPairs]) -> CompactEncoder:
    """The network with discriminants fitted on pairs of two visits; each batch is heard once.

    Raises InputError where there is no batch.
    """
    network.discriminants = None
    sums: Moments | None = None
    for batch in batches:
        first, second = (_beside(network, samples) for samples in (batch.first, batch.second))
        made = moments(first, second, batch.room)
        sums = made if sums is None else sums + made
    if sums is None:
        raise InputError("discriminants: wanted pairs of echoes, got none; pass a batch")
    weight, bias = discriminants(sums)
    network.discriminants = Discriminants()
    with torch.no_grad():
        network.discriminants.weight.copy_(torch.tensor(weight))
        network.discriminants.bias.copy_(torch.tensor(bias))
    return network


def moments(first: F64, second: F64, room: I64) -> Moments:
    """The sums of pairs (n, d) of which those of one room (n) are of the same two visits."""
    own, theirs = _less_their_mean(first, room), _less_their_mean(second, room)
    apart = own - theirs
    return Moments(
        len(room),
        (first + second).sum(axis=0) / 2,
        apart.T @ apart / 2,
        (own.T @ own + theirs.T @ theirs) / 2,
    )


def discriminants(sums: Moments, size: int = ELF_SIZE) -> tuple[F64, F64]:
    """Weights (size, d) and bias (size) of the directions in which places differ most.

    Directions count by how sure they tell: the fourth root of the share of their variance that is
    not within pairs.
    """
    within = sums.within / sums.count
    ridged = within + RIDGE * np.trace(within) / len(within) * np.eye(len(within))
    ratio, directions = eigh(sums.over_all / sums.count, ridged)
    best = np.argsort(-ratio)[:size]
    told = np.maximum(1 - 1 / np.maximum(ratio[best], 1e-12), LEAST_TOLD) ** 0.25
    weight = (directions[:, best] * told).T
    return weight, -weight @ (sums.vectors / sums.count)


def _beside(network: CompactEncoder, samples: np.ndarray) -> F64:
    rows = torch.from_numpy(np.array(samples))
    with torch.no_grad():
        features, plane = network.inner(rows, torch.zeros(BINS))
        elf = network.outer(features, plane)
    return np.asarray(beside(elf, plane).numpy(), dtype=np.float64)


def _less_their_mean(vectors: F64, room: I64) -> F64:
    """Vectors (n, d) less the mean of their room (n)."""
    rooms, which = np.unique(room, return_inverse=True)
    mean = np.zeros((len(rooms), vectors.shape[1]))
    np.add.at(mean, which, vectors)
    return np.asarray(vectors - (mean / np.bincount(which)[:, None])[which])
