"""NT-Xent against a double loop, and what the mask takes out of it."""

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


@given(count=st.integers(2, 6), seed=st.integers(0, 1000), times=st.integers(1, 4))
def test_a_weight_is_as_good_as_that_many_negatives(count: int, seed: int, times: int) -> None:
    first, second = unit_rows(count, 5, seed), unit_rows(count, 5, seed + 1)
    itself = torch.eye(count, dtype=torch.bool)
    log_weight = torch.full((count, count), math.log(times), dtype=torch.float64)
    log_weight = log_weight.masked_fill(itself, 0.0)
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
