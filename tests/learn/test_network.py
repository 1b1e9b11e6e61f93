"""The encoders' networks: the line's spectrogram inside, unit rows outside."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import torch
from planted_training import traces
from torch import nn

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, EchoPairs
from elfslam.baselines.generic import root_spectrogram, unit_rows
from elfslam.learn import network as networks
from elfslam.learn.onnx_files import encoder_content, export_encoder, network_of
from elfslam.stages.feature import OnnxEncoder, load_encoder, spectrogram

NETWORKS: dict[str, Callable[[], nn.Module]] = {
    "compact": lambda: networks.CompactEncoder(8),
    "ResNet-18": networks.ResNetEncoder,
    "ResNet-18, small stem": lambda: networks.ResNetEncoder("small"),
}


@pytest.fixture(scope="module", params=NETWORKS)
def network(request: pytest.FixtureRequest) -> nn.Module:
    """A network whose batch statistics have seen some echoes."""
    torch.manual_seed(0)
    made = NETWORKS[request.param]().train()
    with torch.no_grad():
        for seed in range(3):
            made(traces(16, seed))
    return made.eval()


def test_the_spectrogram_is_that_of_the_line() -> None:
    samples = traces(7)
    ours = networks.Spectrogram()(samples).numpy()
    theirs = spectrogram(samples.numpy())
    assert ours.shape == (7, 12, 48)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-4 * theirs.max())


def test_rows_are_unit(network: nn.Module) -> None:
    with torch.no_grad():
        elf = network(traces(20, 5))
    assert elf.shape == (20, ELF_SIZE)
    np.testing.assert_allclose(torch.linalg.norm(elf, dim=1).numpy(), 1.0, atol=1e-5)
    assert float(torch.pdist(elf).min()) > 1e-3, "other echoes, other features"


def test_rows_are_row_by_row(network: nn.Module) -> None:
    samples = traces(9, 5)
    with torch.no_grad():
        whole = network(samples)
        alone = torch.cat([network(samples[k : k + 1]) for k in range(9)])
        shuffled = network(samples.flip(0)).flip(0)
    np.testing.assert_allclose(alone.numpy(), whole.numpy(), atol=1e-5)
    np.testing.assert_allclose(shuffled.numpy(), whole.numpy(), atol=1e-5)


@pytest.mark.parametrize("gain", [0.05, 0.5, 20.0])
def test_the_level_drops_out(network: nn.Module, gain: float) -> None:
    """A phone at 20 % volume gives the same feature."""
    samples = traces(6, 5)
    with torch.no_grad():
        soft, loud = network(samples), network(gain * samples)
    np.testing.assert_allclose(soft.numpy(), loud.numpy(), atol=1e-3)


def test_the_sign_of_the_microphone_drops_out(network: nn.Module) -> None:
    samples = traces(6, 5)
    with torch.no_grad():
        plus, minus = network(samples), network(-samples)
    np.testing.assert_allclose(plus.numpy(), minus.numpy(), atol=1e-5)


def test_silence_gives_a_feature_and_no_nan(network: nn.Module) -> None:
    with torch.no_grad():
        elf = network(torch.zeros(2, ECHO_SAMPLES))
    assert torch.isfinite(elf).all()


def test_the_image_has_zero_mean_and_unit_variance() -> None:
    image = networks.normalised_log(networks.Spectrogram()(traces(5)))
    assert float(image.mean(dim=(1, 2)).abs().max()) < 1e-5
    np.testing.assert_allclose(image.var(dim=(1, 2), correction=0).numpy(), 1.0, atol=1e-4)


def test_roots_are_unit_rows_without_mean_whatever_the_level() -> None:
    magnitude = networks.Spectrogram()(traces(5))
    root = networks.normalised_root(magnitude)
    expected = root_spectrogram(traces(5).numpy())
    np.testing.assert_allclose(root.numpy(), unit_rows(expected), atol=1e-5)
    again = networks.normalised_root(9 * magnitude)
    np.testing.assert_allclose(again.numpy(), root.numpy(), atol=1e-6)


@pytest.mark.parametrize("network", ["compact"], indirect=True)
def test_time_is_not_averaged_away(network: nn.Module) -> None:
    """The delay of an echo is its place: the same echo 10 ms later is another feature."""
    early = torch.zeros(1, ECHO_SAMPLES)
    early[0, 400:841] = traces(1)[0, :441]
    late = early.roll(441, dims=1)
    with torch.no_grad():
        one, other = network(early), network(late)
    assert float(one[0] @ other[0]) < 0.999


@pytest.fixture(scope="module")
def resnet() -> networks.ResNetEncoder:
    torch.manual_seed(0)
    made = networks.ResNetEncoder()
    with torch.no_grad():
        made.train()(traces(16))
    return made.eval()


def test_it_has_as_many_weights_as_published() -> None:
    """11,689,512 for ImageNet; less its classifier (513,000), and one colour instead of three."""
    colours = 2 * 64 * 7 * 7
    counted = sum(weights.numel() for weights in networks.resnet18("imagenet").parameters())
    assert counted == 11_689_512 - 513_000 - colours


@pytest.mark.parametrize(("stem", "cells"), [("imagenet", (3, 12)), ("small", (12, 48))])
def test_stems_leave_what_they_say_to_the_first_stage(
    stem: networks.Stem, cells: tuple[int, int]
) -> None:
    entry = 3 if stem == "imagenet" else 2
    assert networks.resnet18(stem)[:entry](torch.zeros(1, 1, 12, 48)).shape == (1, 64, *cells)


def test_its_file_is_read_by_the_line(resnet: networks.ResNetEncoder, tmp_path: Path) -> None:
    export_encoder(resnet, tmp_path / "resnet.onnx")
    encoder, samples = load_encoder(str(tmp_path / "resnet.onnx")), traces(5, 1)
    with torch.no_grad():
        expected = resnet(samples).numpy()
    np.testing.assert_allclose(encoder.embed(samples.numpy()), expected, atol=1e-4)
    one = encoder.embed(samples[:1].numpy())
    np.testing.assert_allclose(one, expected[:1], atol=1e-4)


PLACES = 3


def planted(echoes: int, visits: int, seed: int = 0) -> tuple[F64, I64]:
    """Places in the first three of ten numbers; a visit adds ten times as much to all."""
    generator = np.random.default_rng(seed)
    visit = np.repeat(np.arange(visits), echoes // visits)
    heard = 0.1 * generator.normal(size=(echoes, 10))
    heard[:, :PLACES] += generator.normal(size=(echoes, PLACES))
    return heard + 10 * generator.normal(size=(visits, 10))[visit], visit


def test_they_are_the_singular_vectors_of_what_varies_within_visits() -> None:
    heard, visit = planted(400, 8)
    own = heard - np.array([heard[visit == v].mean(axis=0) for v in range(8)])[visit]
    axes = np.linalg.svd(own, full_matrices=False)[2][:5]
    weight, _ = networks.components(networks.moments(heard, visit), size=5)
    npt.assert_allclose(np.abs(np.sum(weight * axes, axis=1)), 1.0, atol=1e-6)


def test_batches_add_up_and_what_all_echoes_share_is_zero() -> None:
    heard, visit = planted(400, 8)
    whole = networks.moments(heard, visit)
    added = networks.moments(heard[:200], visit[:200]) + networks.moments(heard[200:], visit[200:])
    npt.assert_allclose(added.squares, whole.squares, rtol=1e-9, atol=1e-9)
    weight, bias = networks.components(added, size=5)
    npt.assert_allclose(weight @ heard.mean(axis=0) + bias, 0.0, atol=1e-9)


def echoes(pairs: int, seed: int) -> EchoPairs:
    generator = np.random.default_rng(seed)
    first = generator.standard_normal((pairs, ECHO_SAMPLES)).astype(np.float32)
    second = first + 0.3 * generator.standard_normal(first.shape).astype(np.float32)
    return EchoPairs(first, second, np.repeat(np.arange(4), pairs // 4), np.zeros((pairs, 2)))


def test_cosines_are_nearly_those_of_both_features_side_by_side() -> None:
    shipped = load_encoder("compact")
    network, batch = network_of(shipped.content).eval(), echoes(64, 1)
    rows = torch.from_numpy(batch.first.copy())
    with torch.no_grad():
        beside = network.beside(*network.inner(rows)).double()
        made = networks.with_components(network, [batch])(rows).double()
    npt.assert_allclose(torch.linalg.norm(beside, dim=1).numpy(), 2**0.5, rtol=1e-4)
    beside = torch.nn.functional.normalize(beside - beside.mean(dim=0), dim=1)
    npt.assert_allclose((made @ made.T).numpy(), (beside @ beside.T).numpy(), atol=0.1)


def test_a_network_with_components_goes_through_its_file() -> None:
    torch.manual_seed(0)
    network, batch = networks.CompactEncoder(8), echoes(64, 1)
    assert network.components is None
    rows = torch.from_numpy(batch.first.copy())
    network.train()(rows)
    network.eval()
    made = networks.with_components(network, [echoes(64, 2), echoes(64, 3)])
    wanted = made(rows).detach().numpy()
    assert wanted.shape == (64, ELF_SIZE)
    content = encoder_content(made)
    npt.assert_allclose(OnnxEncoder(content, "made").embed(batch.first), wanted, atol=1e-4)
    back = network_of(content)
    assert back.components is not None
    npt.assert_allclose(back(rows).detach().numpy(), wanted, atol=1e-4)


def test_without_echoes_nothing_is_fitted() -> None:
    with pytest.raises(InputError, match="wanted pairs of echoes, got none; pass a batch"):
        networks.with_components(networks.CompactEncoder(8).eval(), [])
