"""Principal components behind the network: planted visits, their laws, the file they end in."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
import torch

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, EchoPairs
from elfslam.learn.components import components, moments, with_components
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.stages.feature import OnnxEncoder, load_encoder

PLACES = 3


def planted(echoes: int, visits: int, seed: int = 0) -> tuple[F64, I64]:
    """Places in the first three of ten numbers; a visit adds ten times as much to all."""
    generator = np.random.default_rng(seed)
    visit = np.repeat(np.arange(visits), echoes // visits)
    heard = 0.1 * generator.normal(size=(echoes, 10))
    heard[:, :PLACES] += generator.normal(size=(echoes, PLACES))
    return heard + 10 * generator.normal(size=(visits, 10))[visit], visit


def test_the_directions_are_those_of_places_and_not_of_visits() -> None:
    weight, _ = components(moments(*planted(4000, 40)), size=PLACES)
    assert np.square(weight[:, :PLACES]).sum() / np.square(weight).sum() > 0.99
    npt.assert_allclose(weight @ weight.T, np.eye(PLACES), atol=1e-9)


def test_they_are_the_singular_vectors_of_what_varies_within_visits() -> None:
    heard, visit = planted(400, 8)
    own = heard - np.array([heard[visit == v].mean(axis=0) for v in range(8)])[visit]
    axes = np.linalg.svd(own, full_matrices=False)[2][:5]
    weight, _ = components(moments(heard, visit), size=5)
    npt.assert_allclose(np.abs(np.sum(weight * axes, axis=1)), 1.0, atol=1e-6)


def test_batches_add_up_and_what_all_echoes_share_is_zero() -> None:
    heard, visit = planted(400, 8)
    whole = moments(heard, visit)
    added = moments(heard[:200], visit[:200]) + moments(heard[200:], visit[200:])
    npt.assert_allclose(added.squares, whole.squares, rtol=1e-9, atol=1e-9)
    weight, bias = components(added, size=5)
    npt.assert_allclose(weight @ heard.mean(axis=0) + bias, 0.0, atol=1e-9)


def echoes(pairs: int, seed: int) -> EchoPairs:
    generator = np.random.default_rng(seed)
    first = generator.standard_normal((pairs, ECHO_SAMPLES)).astype(np.float32)
    second = first + 0.3 * generator.standard_normal(first.shape).astype(np.float32)
    return EchoPairs(first, second, np.repeat(np.arange(4), pairs // 4), np.zeros((pairs, 2)))


def test_cosines_are_nearly_those_of_both_features_side_by_side() -> None:
    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    network, batch = network_of(shipped.content).eval(), echoes(64, 1)
    rows = torch.from_numpy(batch.first.copy())
    with torch.no_grad():
        beside = network.beside(*network.inner(rows)).double()
        made = with_components(network, [batch])(rows).double()
    npt.assert_allclose(torch.linalg.norm(beside, dim=1).numpy(), 2**0.5, rtol=1e-4)
    beside = torch.nn.functional.normalize(beside - beside.mean(dim=0), dim=1)
    npt.assert_allclose((made @ made.T).numpy(), (beside @ beside.T).numpy(), atol=0.1)


def test_a_network_with_components_goes_through_its_file() -> None:
    torch.manual_seed(0)
    network, batch = CompactEncoder(8), echoes(64, 1)
    assert network.components is None
    rows = torch.from_numpy(batch.first.copy())
    network.train()(rows)
    network.eval()
    made = with_components(network, [echoes(64, 2), echoes(64, 3)])
    wanted = made(rows).detach().numpy()
    assert wanted.shape == (64, ELF_SIZE)
    content = encoder_content(made)
    npt.assert_allclose(OnnxEncoder(content, "made").embed(batch.first), wanted, atol=1e-4)
    back = network_of(content)
    assert back.components is not None
    npt.assert_allclose(back(rows).detach().numpy(), wanted, atol=1e-4)


def test_without_echoes_nothing_is_fitted() -> None:
    with pytest.raises(InputError, match="wanted pairs of echoes, got none; pass a batch"):
        with_components(CompactEncoder(8).eval(), [])
