"""A toy training."""

import numpy as np
import torch
from torch import Tensor

from elfslam.base.values import ECHO_SAMPLES, EchoPairs
from elfslam.learn.parameters import PretrainParameters

TINY = PretrainParameters(
    steps=6, pairs=8, width=4, warmup_steps=2, learning_rate=3e-3, checkpoint_steps=2
)


def toy_pairs(step: int, *, count: int = 8, noise: float = 0.3) -> EchoPairs:
    """Every place has a decaying noise of its own, and both echoes are that plus a little more."""
    generator = np.random.default_rng([9, step])
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 600)
    place, one, other = generator.standard_normal((3, count, ECHO_SAMPLES)) * decay
    room, xy_m = np.arange(count) % 2, generator.uniform(0, 20, (count, 2))
    return EchoPairs(place + noise * one, place + noise * other, room, xy_m)


def traces(count: int, seed: int = 0) -> Tensor:
    """Decaying noise, about as loud as echoes are."""
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 500)
    noise = np.random.default_rng(seed).standard_normal((count, ECHO_SAMPLES))
    return torch.from_numpy((0.01 * noise * decay).astype(np.float32))
