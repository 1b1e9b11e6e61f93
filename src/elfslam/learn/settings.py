"""Parameters of learning; apart from the networks, so that listing them needs no torch."""

from __future__ import annotations

from dataclasses import dataclass

from elfslam.base.parameters import parameter


@dataclass(frozen=True)
class PretrainParameters:
    """How the encoder is trained before it hears a real room."""

    steps: int = parameter(6000, "", "batches to train on", low=1)
    pairs: int = parameter(256, "", "positive pairs in a batch (paper: 256)", low=2)
    rooms: int = parameter(
        8, "", "rooms in a batch; pairs of one room are its hard negatives", low=1
    )
    width: int = parameter(24, "", "channels of the first layer", low=4, high=64)
    temperature: float = parameter(0.1, "", "temperature of NT-Xent", low=0.01)
    learning_rate: float = parameter(2e-3, "", "peak learning rate (AdamW, cosine decay)", low=1e-6)
    warmup_steps: int = parameter(100, "", "steps until the peak", low=1)
    weight_decay: float = parameter(1e-4, "", "weight decay of AdamW", low=0.0)
    too_near_m: float = parameter(
        0.5, "m", "places of one room this close are no negatives", low=0.0
    )
    checkpoint_steps: int = parameter(250, "", "steps between checkpoints", low=1)
    threads: int = parameter(2, "", "threads of the network; rounding depends on them", low=1)
