"""Principal components of an ELF beside the root spectrogram that it was made of.

Real rooms are known by their first millimetres, which a network that was taught to forget 20 cm
does not keep; a hand-made feature keeps them, and forgets the next step. Side by side they keep
both, and their principal components (Pearson 1901) have the size of the ELF alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ELF_SIZE, EchoPairs
from elfslam.learn.network import CompactEncoder, Components


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over echoes: of vectors (d), and of squares (d, d) less the mean of their visit."""

    count: int
    vectors: F64
    squares: F64

    def __add__(self, other: Moments) -> Moments:
        return Moments(
            self.count + other.count, self.vectors + other.vectors, self.squares + other.squares
        )


def with_components(network: CompactEncoder, batches: Iterable[EchoPairs]) -> CompactEncoder:
    """The network with components fitted on echoes of many visits; each batch is heard once.

    Raises InputError where there is no batch.
    """
    network.components = None
    sums: Moments | None = None
    for batch in batches:
        for samples in (batch.first, batch.second):
            made = moments(_beside(network, samples), batch.room)
            sums = made if sums is None else sums + made
    if sums is None:
        raise InputError("components: wanted pairs of echoes, got none; pass a batch")
    weight, bias = components(sums)
    network.components = Components()
    with torch.no_grad():
        network.components.weight.copy_(torch.tensor(weight))
        network.components.bias.copy_(torch.tensor(bias))
    return network


def moments(vectors: F64, visit: I64) -> Moments:
    """The sums of vectors (n, d) that were heard on these visits (n).

    The mean of a visit is the phone's, and features lose it (`line.feature.mean_normalised`).
    """
    visits, which = np.unique(visit, return_inverse=True)
    mean = np.zeros((len(visits), vectors.shape[1]))
    np.add.at(mean, which, vectors)
    own = vectors - (mean / np.bincount(which)[:, None])[which]
    return Moments(len(vectors), vectors.sum(axis=0), own.T @ own)


def components(sums: Moments, size: int = ELF_SIZE) -> tuple[F64, F64]:
    """Weights (size, d) and bias (size) of the directions in which echoes of a visit vary most.

    What all echoes share becomes zero.
    """
    _, directions = np.linalg.eigh(sums.squares)
    weight = np.ascontiguousarray(directions[:, ::-1][:, :size].T)
    return weight, -weight @ (sums.vectors / sums.count)


def _beside(network: CompactEncoder, samples: F32) -> F64:
    with torch.no_grad():
        rows = network.beside(*network.inner(torch.from_numpy(np.array(samples))))
    return np.asarray(rows.numpy(), dtype=np.float64)
