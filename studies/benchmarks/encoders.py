"""What each network costs: weights, file size, milliseconds per echo heard and per echo learned.

Usage, from the root of the project:

    python -m studies.benchmarks.encoders [--echoes N]

Processor milliseconds on one thread, best of five after a warm-up, so that a busy machine does not
count. Hearing is onnxruntime on the exported file; learning is one step forward and back in torch.
"""

from __future__ import annotations

import argparse
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
from elfslam.learn.network import CompactEncoder, Components
from elfslam.learn.onnx_files import export_encoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.resnet import ResNetEncoder

NETWORKS: Mapping[str, Callable[[], nn.Module]] = {
    "compact": lambda: as_shipped(CompactEncoder(PretrainParameters().width)),
    "ResNet-18, 7x7 stem": ResNetEncoder,
    "ResNet-18, 3x3 stem": lambda: ResNetEncoder("small"),
}


def as_shipped(network: CompactEncoder) -> CompactEncoder:
    """With components, as pre-training ends; they cost the same whatever they are."""
    network.components = Components()
    return network


def best_processor_ms(work: Callable[[], object], times: int = 5) -> float:
    """Processor milliseconds of the fastest of `times` calls, after one that is not counted."""
    work()
    seconds = []
    for _ in range(times):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return 1000 * min(seconds)


def session_of(content: bytes) -> onnxruntime.InferenceSession:
    """The file on one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def learning(network: nn.Module, echoes: F32) -> Callable[[], object]:
    """One step forward and back, without the optimizer."""
    samples = torch.from_numpy(echoes)
    network.train()

    def step() -> None:
        network.zero_grad()
        network(samples).square().sum().backward()

    return step


def print_network(name: str, network: nn.Module, echoes: F32) -> None:
    """One line of the table."""
    with TemporaryDirectory() as folder:
        export_encoder(network, Path(folder) / "encoder.onnx")
        content = (Path(folder) / "encoder.onnx").read_bytes()
    session, count = session_of(content), len(echoes)
    one = best_processor_ms(lambda: session.run(["elf"], {"samples": echoes[:1]}), 30)
    many = best_processor_ms(lambda: session.run(["elf"], {"samples": echoes}))
    step = best_processor_ms(learning(network, echoes))
    weights = sum(part.numel() for part in network.parameters())
    print(
        f"{name:20}  {weights / 1e6:6.2f} M weights  {len(content) / 1e6:6.2f} MB  "
        f"{one:6.2f} ms for one echo  {many:7.1f} ms for {count} at once  "
        f"{step / count:6.2f} ms per echo learned"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--echoes", type=int, default=64)
    count = parser.parse_args().echoes
    torch.set_num_threads(1)
    torch.manual_seed(0)
    noise = np.random.default_rng(0).standard_normal((count, ECHO_SAMPLES))
    for name, build in NETWORKS.items():
        print_network(name, build(), (0.01 * noise).astype(np.float32))


if __name__ == "__main__":
    main()
