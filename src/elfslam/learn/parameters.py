"""Parameters of learning; apart from the networks, so that listing them needs no torch."""

from dataclasses import dataclass

from elfslam.base.parameters import parameter


@dataclass(frozen=True)
class PretrainParameters:
    """How the encoder is trained before it hears a real room."""

    steps: int = parameter(6000, "", "batches to train on", 1)
    pairs: int = parameter(256, "", "positive pairs in a batch (paper: 256)", 2)
    rooms: int = parameter(8, "", "rooms in a batch; pairs of one room are its hard negatives", 1)
    network: str = parameter("compact", "", "compact, or resnet18 as in the paper")
    width: int = parameter(24, "", "channels of the compact one's first layer", 4, 64)
    temperature: float = parameter(0.07, "", "temperature of NT-Xent", 0.01)
    room_weight: float = parameter(
        8.0, "", "how many times a negative of the same room counts", 0.01
    )
    margin_weight: float = parameter(3.0, "", "weight of the margins beside NT-Xent", 0.0)
    margin_low: float = parameter(
        0.25, "", "similarity that negatives should not exceed", -1.0, 1.0
    )
    margin_high: float = parameter(0.55, "", "similarity that pairs should reach", -1, 1)
    hardest: int = parameter(12, "", "negatives of an echo that are held to the margin", 1)
    learning_rate: float = parameter(2e-3, "", "peak learning rate (AdamW, cosine decay)", 1e-6)
    warmup_steps: int = parameter(100, "", "steps until the peak", 1)
    weight_decay: float = parameter(1e-4, "", "weight decay of AdamW", 0.0)
    too_near_m: float = parameter(0.5, "m", "places of one room this close are no negatives", 0.0)
    checkpoint_steps: int = parameter(250, "", "steps between checkpoints", 1)
    component_batches: int = parameter(
        32, "", "more batches, of diffuse rooms, for the components of the compact one", 0
    )
    threads: int = parameter(
        1, "", "threads of the network beside the simulator's; rounding depends on them", 1
    )


@dataclass(frozen=True)
class FinetuneParameters:
    """How the encoder learns one walk, without any label."""

    steps: int = parameter(100, "", "batches to train on", 1)
    pairs: int = parameter(96, "", "pairs of consecutive echoes in a batch", 2)
    temperature: float = parameter(0.1, "", "temperature of NT-Xent", 0.01)
    learning_rate: float = parameter(2e-4, "", "peak learning rate (AdamW, cosine decay)", 1e-6)
    warmup_steps: int = parameter(20, "", "steps until the peak", 1)
    near_s: float = parameter(5.0, "s", "echoes this close in time are no negatives", 0.2)
    gap_s: float = parameter(0.15, "s", "consecutive echoes are no farther apart", 0.05)
    window: int = parameter(6, "echoes", "averaged before they are compared, a footstep", 1)
    line_windows: int = parameter(7, "windows", "length over which a revisit must sound alike", 1)
    line_similarity: float = parameter(
        0.42, "", "mean similarity along it from which it may be a revisit", -1.0, 1.0
    )
    beside_windows: int = parameter(2, "windows", "what lies beside a revisit may be one too", 0)
    keep: float = parameter(
        20.0, "", "weight of: what is no negative keeps the similarity that it had", 0.0
    )
    jitter_samples: int = parameter(2, "samples", "shift of the cut, either way", 0, 40)
    noise: float = parameter(0.1, "", "most noise added, as a share of an echo's level", 0.0)
    check_steps: int = parameter(25, "", "steps between looks at the quality", 1)
    block_s: float = parameter(5.0, "s", "one block of five is not learnt from", 1.0)
    shortest_s: float = parameter(60.0, "s", "walk from which there is enough to learn", 1.0)
    threads: int = parameter(2, "", "threads of the network; rounding depends on them", 1)


@dataclass(frozen=True)
class ScratchParameters:
    """How an encoder learns one walk from random weights, for comparison."""

    steps: int = parameter(200, "", "batches to train on", 1)
    pairs: int = parameter(128, "", "pairs of consecutive echoes in a batch", 2)
    temperature: float = parameter(0.1, "", "temperature of NT-Xent", 0.01)
    learning_rate: float = parameter(2e-3, "", "peak learning rate (AdamW, cosine decay)", 1e-6)
    near_s: float = parameter(2.0, "s", "echoes this close in time are no negatives", 0.2)
    gap_s: float = parameter(0.15, "s", "consecutive echoes are no farther apart", 0.05)
    threads: int = parameter(2, "", "threads of the network; rounding depends on them", 1)


@dataclass(frozen=True)
class FloorLevelParameters:
    """How one encoder learns a whole floor, so that a spot sounds alike in any orientation."""

    steps: int = parameter(300, "", "batches to train on", 1)
    batch: int = parameter(256, "", "echoes in a batch, as many of each walk", 2)
    spacing_m: float = parameter(0.1, "m", "side of the square that is one spot", 0.02)
    part: str = parameter("whole", "", "what of the network is trained: whole, or head")
    near_m: float = parameter(
        0.1, "m", "how fast echoes cease to be of one spot, one standard deviation", 0.01
    )
    temperature: float = parameter(0.05, "", "temperature of the contrast", 0.01)
    learning_rate: float = parameter(2e-3, "", "peak learning rate (AdamW, cosine decay)", 1e-6)
    spot_rate: float = parameter(1e-2, "", "the same for the ELFs of the spots", 1e-6)
    opening_batches: int = parameter(
        60, "", "heard before, for the first guess of the spots' ELFs", 0
    )
    warmup_steps: int = parameter(30, "", "steps until the peak", 1)
    checkpoint_steps: int = parameter(100, "", "steps between checkpoints", 1)
    threads: int = parameter(
        1, "", "threads of the network beside those of the stream; rounding depends on them", 1
    )
