"""The networks, from raw aligned samples to the ELF in one differentiable graph.

The compact encoder, and ResNet-18 (He et al. 2016) with the paper's projection head. Real rooms are
known by their first millimetres, which a network that was taught to forget 20 cm does not keep; a
hand-made feature keeps them, and forgets the next step. Side by side they keep both, and their
principal components (Pearson 1901) have the size of the ELF alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ELF_SIZE, EchoPairs
from elfslam.stages.feature import BINS, FIRST_BIN, HOP_SAMPLES, WINDOW_SAMPLES

FRAMES = 48
LOG_FLOOR = 0.02
"""Added to the magnitudes before the logarithm, as a share of the echo's mean magnitude."""


class Spectrogram(nn.Module):
    """Samples (n, 2352) to magnitudes (n, 12, 48): the framing and DFT of `stages.feature`."""

    def __init__(self) -> None:
        super().__init__()
        n = np.arange(WINDOW_SAMPLES)
        window = np.hanning(WINDOW_SAMPLES + 1)[:-1]
        bins = np.arange(FIRST_BIN, FIRST_BIN + BINS)[:, None]
        angle = 2 * np.pi * bins * n / WINDOW_SAMPLES
        kernels = np.concatenate([np.cos(angle) * window, np.sin(angle) * window])[:, None, :]
        self.register_buffer("kernels", torch.tensor(kernels, dtype=torch.float32))

    def forward(self, samples: Tensor) -> Tensor:
        parts = functional.conv1d(samples[:, None, :], self.kernels, stride=HOP_SAMPLES)  # type: ignore[arg-type]
        real, imaginary = parts[:, :BINS], parts[:, BINS:]
        return torch.sqrt(real * real + imaginary * imaginary + 1e-20)


class Residual(nn.Module):
    """Two 3x3 convolutions with a shortcut."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.first_norm = nn.BatchNorm2d(channels)
        self.second = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.second_norm = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        inner = functional.relu(self.first_norm(self.first(x)))
        return functional.relu(x + self.second_norm(self.second(inner)))


class Components(nn.Linear):
    """An ELF beside its root spectrogram (n, 704) as unit rows (n, 128) of their components.

    Fitted after the training, by `with_components`.
    """

    def __init__(self) -> None:
        super().__init__(ELF_SIZE + BINS * FRAMES, ELF_SIZE)

    def forward(self, beside: Tensor) -> Tensor:
        return functional.normalize(super().forward(beside), dim=1)


class CompactEncoder(nn.Module):
    """Raw aligned samples (n, 2352) to ELFs (n, 128), unit rows.

    The time axis is pooled late and never averaged away: the delay of an echo is its place.
    `components` come last, where they were fitted.
    """

    components: Components | None

    def __init__(self, width: int = 32) -> None:
        super().__init__()
        self.spectrogram = Spectrogram()
        self.body = nn.Sequential(
            nn.Conv2d(1, width, 3, stride=(2, 1), padding=1, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, stride=(1, 2), padding=1, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            Residual(width),
            nn.Conv2d(width, 2 * width, 3, stride=2, padding=1, bias=False),
            nn.BatchNorm2d(2 * width),
            nn.ReLU(),
            Residual(2 * width),
        )
        flat = 2 * width * 3 * (FRAMES // 4)
        self.head = nn.Sequential(
            nn.Linear(flat, ELF_SIZE),
            nn.BatchNorm1d(ELF_SIZE),
            nn.ReLU(),
            nn.Linear(ELF_SIZE, ELF_SIZE),
        )
        self.register_module("components", None)

    def forward(self, samples: Tensor) -> Tensor:
        return self.outer(*self.inner(samples))

    def inner(self, samples: Tensor) -> tuple[Tensor, Tensor]:
        """What the head is given (n, 6 * width * 12), and root spectrograms, unit rows (n, 576)."""
        magnitude = self.spectrogram(samples)
        features: Tensor = self.body(normalised_log(magnitude)[:, None])
        return features.flatten(1), normalised_root(magnitude)

    def outer(self, features: Tensor, root: Tensor) -> Tensor:
        """Unit rows (n, 128) of what `inner` gives."""
        if self.components is None:
            return functional.normalize(self.head(features), dim=1)
        rows: Tensor = self.components(self.beside(features, root))
        return rows

    def beside(self, features: Tensor, root: Tensor) -> Tensor:
        """What was learnt and the root spectrogram side by side (n, 704), both of length 1."""
        return torch.cat([functional.normalize(self.head(features), dim=1), root], dim=1)


def normalised_log(magnitude: Tensor) -> Tensor:
    """Log magnitudes (n, 12, 48) with zero mean and unit variance per echo: level drops out."""
    floor = LOG_FLOOR * magnitude.mean(dim=(1, 2), keepdim=True)
    level = torch.log(magnitude + floor + 1e-12)
    level = level - level.mean(dim=(1, 2), keepdim=True)
    return level / torch.sqrt((level * level).mean(dim=(1, 2), keepdim=True) + 1e-6)


def normalised_root(magnitude: Tensor) -> Tensor:
    """Square roots of magnitudes (n, 12, 48), flat, less their mean, as unit rows (n, 576)."""
    mean = magnitude.mean(dim=(1, 2), keepdim=True)
    root = torch.sqrt(magnitude / (mean + 1e-12)).flatten(1)
    return functional.normalize(root - root.mean(dim=1, keepdim=True), dim=1)


STAGES = (64, 128, 256, 512)
"""Channels of the four stages of two blocks each."""

Stem = Literal["imagenet", "small"]
"""How the image enters: 7x7 with stride 2 and a pool, as for photographs, or 3x3 with stride 1.

The pooled stem leaves 3x12 of the 12x48 cells to the first stage, the small one all of them, at
six to ten times the cost per echo (docs/explanation/encoder.md).
"""


class ResNetEncoder(nn.Module):
    """Raw aligned samples (n, 2352) to ELFs (n, 128), unit rows.

    The encoder of the paper (its section 5.2): ResNet-18 and a projection head of three layers as
    in SimCLRv2 (Chen et al. 2020). Level and `device_log_spectrum` (12) are taken out as in
    `CompactEncoder`, so that either can stand in the other's place.
    """

    def __init__(self, stem: Stem = "imagenet") -> None:
        super().__init__()
        self.spectrogram = Spectrogram()
        self.body = resnet18(stem)
        self.head = projection_head(STAGES[-1], ELF_SIZE)

    def forward(self, samples: Tensor) -> Tensor:
        image = normalised_log(self.spectrogram(samples))
        return functional.normalize(self.head(self.body(image[:, None])), dim=1)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions with a shortcut, which is projected where the shape changes."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.first = convolution(inputs, outputs, 3, stride)
        self.second = convolution(outputs, outputs, 3, 1)
        same = stride == 1 and inputs == outputs
        self.shortcut = nn.Identity() if same else convolution(inputs, outputs, 1, stride)

    def forward(self, x: Tensor) -> Tensor:
        inner = self.second(functional.relu(self.first(x)))
        return functional.relu(self.shortcut(x) + inner)


def resnet18(stem: Stem) -> nn.Sequential:
    """Images (n, 1, 12, 48) to features (n, 512)."""
    layers: list[nn.Module] = [convolution(1, STAGES[0], 7, 2), nn.ReLU(), nn.MaxPool2d(3, 2, 1)]
    if stem == "small":
        layers = [convolution(1, STAGES[0], 3, 1), nn.ReLU()]
    before = STAGES[0]
    for stage, channels in enumerate(STAGES):
        layers += [
            ResidualBlock(before, channels, 1 if stage == 0 else 2),
            ResidualBlock(channels, channels, 1),
        ]
        before = channels
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten())


def projection_head(inputs: int, outputs: int) -> nn.Sequential:
    """Three layers; the last has no nonlinearity."""
    return nn.Sequential(
        nn.Linear(inputs, inputs, bias=False),
        nn.BatchNorm1d(inputs),
        nn.ReLU(),
        nn.Linear(inputs, inputs, bias=False),
        nn.BatchNorm1d(inputs),
        nn.ReLU(),
        nn.Linear(inputs, outputs),
    )


def convolution(inputs: int, outputs: int, size: int, stride: int) -> nn.Sequential:
    """A convolution and its batch normalisation."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride=stride, padding=size // 2, bias=False),
        nn.BatchNorm2d(outputs),
    )


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

    The mean of a visit is the phone's, and features lose it (`stages.feature.mean_normalised`).
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
