"""What each network costs: weights, file size, milliseconds per echo embedded and learned.

    python -m studies.benchmarks.encoders

Processor milliseconds on one thread, best of five after a warm-up, so that a busy machine does not
count. Embedding is onnxruntime on the exported file; learning is a step forward and back in torch.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnxruntime
import torch
from torch import nn

from elfslam.base.arrays import F32
from elfslam.base.values import ECHO_SAMPLES
from elfslam.learn.network import CompactEncoder, Components, ResNetEncoder
from elfslam.learn.onnx_files import export_encoder
from elfslam.learn.parameters import PretrainParameters

ECHOES = 64


def compact() -> CompactEncoder:
    """With components, as pre-training ends; they cost the same whatever they are."""
    network = CompactEncoder(PretrainParameters().width)
    network.components = Components()
    return network


NETWORKS: Mapping[str, Callable[[], nn.Module]] = {
    "compact": compact,
    "ResNet-18, 7x7 stem": ResNetEncoder,
    "ResNet-18, 3x3 stem": lambda: ResNetEncoder("small"),
}


def best_ms(work: Callable[[], object], times: int = 5) -> float:
    """Processor milliseconds of the fastest of `times` calls, after one that is not counted."""
    work()
    seconds = []
    for _ in range(times):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return 1000 * min(seconds)


def print_network(name: str, network: nn.Module, echoes: F32) -> None:
    """One line of the table."""
    with TemporaryDirectory() as folder:
        export_encoder(network, Path(folder) / "encoder.onnx")
        content = (Path(folder) / "encoder.onnx").read_bytes()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    samples = torch.from_numpy(echoes)

    def learn() -> None:
        network.zero_grad()
        network(samples).square().sum().backward()

    one = best_ms(lambda: session.run(["elf"], {"samples": echoes[:1]}), 30)
    many = best_ms(lambda: session.run(["elf"], {"samples": echoes}))
    network.train()
    step = best_ms(learn)
    weights = sum(part.numel() for part in network.parameters())
    print(
        f"{name:20}  {weights / 1e6:6.2f} M weights  {len(content) / 1e6:6.2f} MB  "
        f"{one:6.2f} ms for one echo  {many:7.1f} ms for {ECHOES} at once  "
        f"{step / ECHOES:6.2f} ms per echo learned"
    )


def main() -> None:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    noise = np.random.default_rng(0).standard_normal((ECHOES, ECHO_SAMPLES))
    for name, build in NETWORKS.items():
        print_network(name, build(), (0.01 * noise).astype(np.float32))


if __name__ == "__main__":
    main()
