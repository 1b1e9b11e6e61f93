"""Two ranks with half of the batch each take the step that one process takes with the whole."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from planted_training import Found, one_step, stepped, toy_network, toy_pairs
from torch import nn

from elfslam.app.workers.together import Work, together
from elfslam.base.errors import ParameterError
from elfslam.learn.parameters import PretrainParameters
from elfslam.learn.pretrain import embedded, pair_loss
from elfslam.learn.ranks import ALONE, NormOfAll, Ranks, rows_of_all, shared
from elfslam.learn.trainers import part_of

BATCH = toy_pairs(0)


def by(count: int, kind: str, precision: str) -> Found:
    heard: list[Found] = []
    do = partial(one_step, kind=kind, precision=precision)
    together(Work(do, lambda step: (BATCH for _ in range(1)), part_of), count, hear=heard.append)
    (found,) = heard
    return found


@pytest.mark.parametrize(
    ("count", "kind", "precision", "atol"),
    [
        (2, "compact", "double", 1e-12),
        pytest.param(2, "compact", "single", 1e-5, marks=pytest.mark.slow),
        pytest.param(4, "compact", "double", 1e-12, marks=pytest.mark.slow),
        pytest.param(2, "resnet18", "double", 1e-12, marks=pytest.mark.slow),
    ],
)
def test_ranks_find_the_loss_and_gradient_of_one_process(
    count: int, kind: str, precision: str, atol: float
) -> None:
    """To `atol` of the largest gradient; the loss of single precision to the last digits."""
    loss, found = by(count, kind, precision)
    wanted_loss, wanted = stepped(BATCH, kind, precision)
    assert loss == pytest.approx(wanted_loss, rel=min(atol, 1e-6))
    assert found.keys() == wanted.keys()
    size = max(abs(value).max() for value in wanted.values())
    for name, value in wanted.items():
        np.testing.assert_allclose(found[name], value, rtol=0, atol=atol * size, err_msg=name)


def test_each_rank_by_itself_would_find_another() -> None:
    """What the ranks tell each other matters: half a batch has fewer negatives, other norms."""
    half = stepped(part_of(BATCH, 0, 2), "compact", "double")
    whole = stepped(BATCH, "compact", "double")
    assert abs(half[0] - whole[0]) > 0.01


def test_alone_nothing_is_changed_and_nothing_gathered() -> None:
    network = toy_network("compact")
    assert shared(network, ALONE) is network
    assert not any(isinstance(module, NormOfAll) for module in network.modules())
    rows = torch.ones(3, 2)
    assert torch.equal(rows_of_all(rows, ALONE), rows[None])


def test_once_trained_the_norm_is_the_plain_one() -> None:
    torch.manual_seed(0)
    norm = nn.BatchNorm2d(3)
    norm(torch.randn(8, 3, 4, 4))
    x = torch.randn(2, 3, 4, 4)
    other = NormOfAll(norm, Ranks(0, 2)).eval()
    assert torch.equal(other(x), norm.eval()(x))
    assert other.state_dict().keys() == norm.state_dict().keys()


def test_a_batch_is_cut_evenly_and_whole() -> None:
    parts = [part_of(BATCH, number, 4) for number in range(4)]
    assert np.array_equal(np.concatenate([one.first for one in parts]), BATCH.first)
    assert np.array_equal(np.concatenate([one.room for one in parts]), BATCH.room)
    with pytest.raises(ParameterError, match="got 3 for batches of 8"):
        part_of(BATCH, 0, 3)


def plain_loss(network: nn.Module) -> torch.Tensor:
    """The loss of one process written out again: rows as they come, nothing gathered."""
    from elfslam.learn.loss import margin_loss, nt_xent

    parameters, rows = PretrainParameters(), embedded(network, BATCH)
    first, second = rows[: len(BATCH.first)], rows[len(BATCH.first) :]
    distance_m = np.linalg.norm(BATCH.xy_m[:, None] - BATCH.xy_m[None], axis=2)
    same = BATCH.room[:, None] == BATCH.room[None]
    near = torch.from_numpy(same & (distance_m < parameters.too_near_m))
    harder = torch.from_numpy(same & ~np.eye(len(same), dtype=bool))
    weight = float(np.log(parameters.room_weight)) * harder
    margin = margin_loss(
        first, second, near, low=parameters.margin_low, high=parameters.margin_high,
        hardest=parameters.hardest,
    )  # fmt: skip
    contrast = nt_xent(first, second, near, parameters.temperature, weight)
    return contrast + parameters.margin_weight * margin


def test_alone_loss_and_gradient_are_the_plain_ones_bit_for_bit() -> None:
    parameters = PretrainParameters()
    found = []
    for plain in (False, True):
        network = toy_network("compact")
        loss = plain_loss(network) if plain else pair_loss(network, BATCH, parameters)
        loss.backward()
        found.append([loss, *[value.grad for value in network.parameters()]])
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))
