"""ResNet-18: the published size, interchangeable with the compact encoder, learns and exports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from planted_training import toy_pairs, traces

from elfslam.learn.onnx_files import export_encoder
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import pretrain
from elfslam.learn.resnet import ResNetEncoder, Stem, resnet18
from elfslam.stages.feature import load_encoder


@pytest.fixture(scope="module")
def network() -> ResNetEncoder:
    torch.manual_seed(0)
    made = ResNetEncoder()
    with torch.no_grad():
        made.train()(traces(16))
    return made.eval()


def test_it_has_as_many_weights_as_published() -> None:
    """11,689,512 for ImageNet; less its classifier (513,000), and one colour instead of three."""
    colours = 2 * 64 * 7 * 7
    counted = sum(weights.numel() for weights in resnet18("imagenet").parameters())
    assert counted == 11_689_512 - 513_000 - colours


@pytest.mark.parametrize(("stem", "cells"), [("imagenet", (3, 12)), ("small", (12, 48))])
def test_the_stems_leave_what_they_say_to_the_first_stage(
    stem: Stem, cells: tuple[int, int]
) -> None:
    entry = 3 if stem == "imagenet" else 2
    assert resnet18(stem)[:entry](torch.zeros(1, 1, 12, 48)).shape == (1, 64, *cells)


def test_its_file_is_read_by_the_line(network: ResNetEncoder, tmp_path: Path) -> None:
    export_encoder(network, tmp_path / "resnet.onnx")
    encoder, samples = load_encoder(str(tmp_path / "resnet.onnx")), traces(5, 1)
    with torch.no_grad():
        expected = network(samples).numpy()
    np.testing.assert_allclose(encoder.embed(samples.numpy()), expected, atol=1e-4)
    one = encoder.embed(samples[:1].numpy())
    np.testing.assert_allclose(one, expected[:1], atol=1e-4)


def test_pretraining_takes_it(tmp_path: Path) -> None:
    losses: list[float] = []
    network = pretrain(
        lambda step: toy_pairs(0),
        PretrainParameters(
            network="resnet18", steps=5, pairs=8, warmup_steps=1, learning_rate=1e-3, threads=1
        ),
        seed=0,
        checkpoint=tmp_path / "training.pt",
        report=lambda progress: losses.append(progress.loss),
    ).network
    assert isinstance(network, ResNetEncoder)
    assert not network.training
    assert losses[-1] < 0.7 * losses[0]
