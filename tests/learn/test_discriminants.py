"""Linear discriminants: planted places and visits, their laws, and the file they end in."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
import torch

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, EchoPairs
from elfslam.learn.discriminants import discriminants, moments, with_discriminants
from elfslam.learn.network import CompactEncoder
from elfslam.learn.onnx_files import encoder_content, network_of
from elfslam.line.feature import BINS, OnnxEncoder, load_encoder

PLACES, LOUD = 3, 10.0


def planted(pairs: int, rooms: int, seed: int = 0) -> tuple[F64, F64, I64]:
    """Places in the first three of ten numbers; two are loud; a visit adds to all."""
    generator = np.random.default_rng(seed)
    room = np.repeat(np.arange(rooms), pairs // rooms)
    place = generator.normal(size=(pairs, PLACES))

    def heard() -> F64:
        rest = generator.normal(size=(pairs, 7)) * [LOUD, LOUD, 1, 1, 1, 1, 1]
        visit = 30 * generator.normal(size=(rooms, 10))[room]
        return np.hstack([place + 0.1 * generator.normal(size=place.shape), rest]) + visit

    return heard(), heard(), room


def test_the_directions_in_which_places_differ_are_found() -> None:
    weight, _ = discriminants(moments(*planted(4000, 40)), size=PLACES)
    share = np.square(weight[:, :PLACES]).sum() / np.square(weight).sum()
    assert share > 0.99
    first, second, room = planted(400, 4, seed=1)
    same = first[:, :PLACES] - second[:, :PLACES]
    assert np.abs(same).mean() > 5, "visits are louder than places"
    own, theirs = (
        (each - np.array([each[room == r].mean(axis=0) for r in range(4)])[room]) @ weight.T
        for each in (first, second)
    )
    nearest = np.argmin(np.linalg.norm(own[:, None] - theirs[None], axis=2), axis=1)
    assert np.mean(nearest == np.arange(400)) > 0.6


def test_batches_add_up_and_the_mean_goes_to_zero() -> None:
    first, second, room = planted(400, 8)
    half = slice(0, 200), slice(200, 400)
    parts = [moments(first[k], second[k], room[k]) for k in half]
    whole, added = moments(first, second, room), parts[0] + parts[1]
    for name in ("vectors", "within", "over_all"):
        npt.assert_allclose(getattr(added, name), getattr(whole, name), rtol=1e-9)
    weight, bias = discriminants(whole, size=5)
    npt.assert_allclose(weight @ (first + second).mean(axis=0) / 2 + bias, 0.0, atol=1e-9)


def test_within_pairs_directions_vary_alike() -> None:
    """Before they are weighed by how much they tell: unit variance, and none with another."""
    first, second, room = planted(6000, 20)
    sums = moments(first, second, room)
    weight, _ = discriminants(sums, size=6)
    spread = weight @ (sums.within / sums.count) @ weight.T
    npt.assert_allclose(spread - np.diag(np.diag(spread)), 0.0, atol=0.05)
    assert np.diag(spread)[0] <= 1.0


def echoes(pairs: int, seed: int) -> EchoPairs:
    generator = np.random.default_rng(seed)
    first = generator.standard_normal((pairs, ECHO_SAMPLES)).astype(np.float32)
    second = first + 0.3 * generator.standard_normal(first.shape).astype(np.float32)
    xy_m = np.zeros((pairs, 2))
    return EchoPairs(first, second, np.repeat(np.arange(4), pairs // 4), xy_m)


def test_a_network_with_discriminants_goes_through_its_file() -> None:
    shipped = load_encoder("compact")
    assert isinstance(shipped, OnnxEncoder)
    network = network_of(shipped.content)
    batch = echoes(64, 1)
    rows = torch.from_numpy(batch.first.copy())
    without = network(rows, torch.zeros(BINS)).detach().numpy()
    made = with_discriminants(network, [echoes(64, 2), echoes(64, 3)])
    wanted = made(rows, torch.zeros(BINS)).detach().numpy()
    assert wanted.shape == (64, ELF_SIZE)
    assert np.abs(wanted - without).max() > 0.1
    content = encoder_content(made)
    npt.assert_allclose(OnnxEncoder(content, "made").embed(batch.first), wanted, atol=1e-4)
    back = network_of(content)
    assert back.discriminants is not None
    npt.assert_allclose(back(rows, torch.zeros(BINS)).detach().numpy(), wanted, atol=1e-4)


def test_without_pairs_nothing_is_fitted() -> None:
    with pytest.raises(InputError, match="wanted pairs of echoes, got none; pass a batch"):
        with_discriminants(CompactEncoder(8).eval(), [])
