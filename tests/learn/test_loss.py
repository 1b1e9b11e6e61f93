"""NT-Xent against a double loop, and what the mask takes out of it."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn import functional

from elfslam.learn.loss import margin_loss, nt_xent


def unit_rows(count: int, size: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    rows = torch.randn(count, size, generator=generator, dtype=torch.float64)
    return functional.normalize(rows, dim=1)


def no_mask(count: int) -> Tensor:
    return torch.zeros(count, count, dtype=torch.bool)


def random_mask(count: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    upper = torch.rand(count, count, generator=generator) < 0.4
    return upper | upper.T


def naive_nt_xent(first: Tensor, second: Tensor, ignored: Tensor, temperature: float) -> float:
    """Equation 1 of SimCLR, term by term."""
    count = len(first)
    rows = [*first, *second]
    total = 0.0
    for i in range(2 * count):
        positive = (i + count) % (2 * count)
        numerator = math.exp(float(rows[i] @ rows[positive]) / temperature)
        denominator = 0.0
        for k in range(2 * count):
            too_near = bool(ignored[i % count, k % count]) and i % count != k % count
            if k != i and not too_near:
                denominator += math.exp(float(rows[i] @ rows[k]) / temperature)
        total -= math.log(numerator / denominator)
    return total / (2 * count)


@given(
    count=st.integers(2, 7),
    size=st.integers(2, 9),
    seed=st.integers(0, 1000),
    temperature=st.floats(0.05, 2.0),
)
def test_it_is_the_double_loop(count: int, size: int, seed: int, temperature: float) -> None:
    first, second = unit_rows(count, size, seed), unit_rows(count, size, seed + 1)
    for ignored in (no_mask(count), random_mask(count, seed)):
        expected = naive_nt_xent(first, second, ignored, temperature)
        computed = nt_xent(first, second, ignored, temperature)
        assert float(computed) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_diagonal_of_the_mask_is_not_read() -> None:
    first, second = unit_rows(5, 8, 0), unit_rows(5, 8, 1)
    plain = nt_xent(first, second, no_mask(5), 0.1)
    diagonal = nt_xent(first, second, torch.eye(5, dtype=torch.bool), 0.1)
    assert float(plain) == float(diagonal)


def test_masked_places_do_not_push() -> None:
    """Places 0 and 1 ignore each other: how similar they are changes nothing."""
    first, second = unit_rows(4, 8, 0), unit_rows(4, 8, 1)
    ignored = no_mask(4)
    ignored[0, 1] = ignored[1, 0] = True
    gradient = first.clone().requires_grad_()
    nt_xent(gradient, second, ignored, 0.1).backward()  # type: ignore[no-untyped-call]
    assert gradient.grad is not None
    spanned = torch.stack([second[0], first[2], first[3], second[2], second[3]])
    rest = gradient.grad[0] - _projected(gradient.grad[0], spanned)
    assert float(rest.abs().max()) < 1e-12
    assert float(nt_xent(first, second, ignored, 0.1)) < float(
        nt_xent(first, second, no_mask(4), 0.1)
    )


def _projected(vector: Tensor, basis: Tensor) -> Tensor:
    return basis.T @ torch.linalg.lstsq(basis.T, vector[:, None]).solution[:, 0]


def test_without_negatives_nothing_is_left_to_lose() -> None:
    first, second = unit_rows(3, 8, 0), unit_rows(3, 8, 1)
    everything = torch.ones(3, 3, dtype=torch.bool)
    assert float(nt_xent(first, second, everything, 0.1)) == pytest.approx(0.0, abs=1e-12)


def test_perfect_pairs_lose_less_than_random_ones() -> None:
    first, other = torch.eye(8, dtype=torch.float64), unit_rows(8, 8, 1)
    perfect = float(nt_xent(first, first, no_mask(8), 0.1))
    # Seven places at right angles, two rows each, against one positive at cosine 1.
    assert perfect == pytest.approx(math.log(1 + 14 * math.exp(-10.0)))
    assert perfect < float(nt_xent(first, other, no_mask(8), 0.1))


def test_it_does_not_matter_which_is_first() -> None:
    first, second = unit_rows(6, 8, 0), unit_rows(6, 8, 1)
    ignored = random_mask(6, 2)
    one, other = nt_xent(first, second, ignored, 0.2), nt_xent(second, first, ignored, 0.2)
    assert float(one) == pytest.approx(float(other), rel=1e-12)


@given(count=st.integers(2, 6), seed=st.integers(0, 1000), times=st.integers(1, 4))
def test_a_weight_is_as_good_as_that_many_negatives(count: int, seed: int, times: int) -> None:
    first, second = unit_rows(count, 5, seed), unit_rows(count, 5, seed + 1)
    itself = torch.eye(count, dtype=torch.bool)
    log_weight = torch.full((count, count), math.log(times), dtype=torch.float64).masked_fill(
        itself, 0.0
    )
    rows = torch.cat([first, second])
    expected = 0.0
    for i in range(2 * count):
        partner = (i + count) % (2 * count)
        terms = torch.exp(rows @ rows[i] / 0.2)
        others = float(terms.sum() - terms[i] - terms[partner])
        expected -= math.log(float(terms[partner]) / (float(terms[partner]) + times * others))
    computed = float(nt_xent(first, second, no_mask(count), 0.2, log_weight))
    assert computed == pytest.approx(expected / (2 * count), rel=1e-9)


def naive_margin(first: Tensor, second: Tensor, ignored: Tensor, hardest: int) -> float:
    count = len(first)
    rows = [*first, *second]
    pairs, negatives = 0.0, 0.0
    for i in range(2 * count):
        partner = (i + count) % (2 * count)
        pairs += max(0.55 - float(rows[i] @ rows[partner]), 0.0) ** 2
        over = [
            max(float(rows[i] @ rows[k]) - 0.25, 0.0) ** 2
            for k in range(2 * count)
            if k not in (i, partner) and not ignored[i % count, k % count]
        ]
        worst = sorted([*over, *[0.0] * hardest], reverse=True)[: min(hardest, 2 * count)]
        negatives += sum(worst) / len(worst)
    return (pairs + negatives) / (2 * count)


@given(count=st.integers(2, 7), seed=st.integers(0, 1000), hardest=st.integers(1, 20))
def test_the_margins_are_the_double_loop(count: int, seed: int, hardest: int) -> None:
    first, second = unit_rows(count, 3, seed), unit_rows(count, 3, seed + 1)
    ignored = random_mask(count, seed) & ~torch.eye(count, dtype=torch.bool)
    ignored = ignored | torch.eye(count, dtype=torch.bool)
    computed = margin_loss(first, second, ignored, low=0.25, high=0.55, hardest=hardest)
    expected = naive_margin(first, second, ignored, hardest)
    assert float(computed) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_what_keeps_the_margins_costs_nothing() -> None:
    rows = torch.eye(8, dtype=torch.float64)
    cost = margin_loss(rows, rows, no_mask(8), low=0.25, high=0.55, hardest=4)
    assert float(cost) == 0.0
