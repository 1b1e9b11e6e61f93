"""ResNet-18 (He et al. 2016) for the 12x48 spectrogram, with the paper's projection head."""

from __future__ import annotations

from typing import Literal

from torch import Tensor, nn
from torch.nn import functional

from elfslam.base.values import ELF_SIZE
from elfslam.learn.network import Spectrogram, normalised_log

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
