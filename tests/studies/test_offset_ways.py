"""Ways to tell an offset, on planted pairs: what each learns, and whether its sigma is honest."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.values import ELF_SIZE
from elfslam.world.air import SPEED_OF_SOUND_MPS
from studies.offset_pairs import FINE_S, Pairs
from studies.offset_ways import (
    as_the_line_claims,
    by_head,
    by_likeness,
    by_matched_filter,
    lags_of,
)

COUNT, SAMPLES = 1200, 500


def planted(seed: int) -> Pairs:
    """Pairs whose likeness falls with the offset, whose echo is later the farther along one is."""
    generator = np.random.default_rng(seed)
    offset = generator.normal(0, [0.2, 0.3, 0.1], (COUNT, 3))
    alike = np.exp(-np.abs(offset[:, 1]) / 0.4)
    first = generator.standard_normal((COUNT, ELF_SIZE))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    other = generator.standard_normal((COUNT, ELF_SIZE))
    other -= np.einsum("nd,nd->n", first, other)[:, None] * first
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    second = alike[:, None] * first + np.sqrt(1 - alike[:, None] ** 2) * other
    heard = np.abs(np.cumsum(generator.standard_normal((COUNT, SAMPLES)), axis=1))
    later = np.round(offset[:, 0] / SPEED_OF_SOUND_MPS / FINE_S).astype(int)
    again = np.stack([np.roll(row, shift) for row, shift in zip(heard, later, strict=True)])
    single = (each.astype(np.float32) for each in (first, second, heard, again))
    return Pairs(offset, *single)


@pytest.fixture(scope="module")
def known() -> Pairs:
    return planted(1)


@pytest.fixture(scope="module")
def asked() -> Pairs:
    return planted(2)


def rms(rows: F64) -> F64:
    return np.asarray(np.sqrt(np.mean(rows**2, axis=0)))


def test_a_closure_claims_no_offset(asked: Pairs) -> None:
    told = as_the_line_claims(asked)
    assert not told.mean.any()
    assert told.sigma[0].tolist() == [0.20, 0.28, 0.28]


def test_likeness_tells_how_far_and_no_more(known: Pairs, asked: Pairs) -> None:
    told = by_likeness(known)(asked)
    assert not told.mean.any()
    near = asked.likeness > 0.8
    assert told.sigma[near, 1].mean() < 0.5 * told.sigma[~near, 1].mean()
    assert rms(asked.offset / told.sigma) == pytest.approx([1, 1, 1], abs=0.25)
    assert told.sigma[:, 0] == pytest.approx(0.2, rel=0.2)


def test_an_echo_that_comes_later_is_found_later(asked: Pairs) -> None:
    longer, alike = lags_of(asked)
    inner = slice(1, -1)
    assert np.median(np.abs(longer[:, inner] - asked.offset[:, :1])) < 0.03
    assert alike[:, inner].mean() > 0.95


def test_matched_filters_tell_what_moves_the_echo(known: Pairs, asked: Pairs) -> None:
    told = by_matched_filter(known)(asked)
    missed = rms(asked.offset - told.mean)
    assert missed[0] < 0.05
    assert missed[1] == pytest.approx(0.3, rel=0.1)
    assert missed / told.sigma[0] == pytest.approx([1, 1, 1], abs=0.25)


def test_the_head_learns_both(known: Pairs, asked: Pairs) -> None:
    told = by_head(known)(asked)
    assert rms(asked.offset - told.mean)[0] < 0.15
    near = asked.likeness > 0.8
    assert told.sigma[near, 1].mean() < 0.8 * told.sigma[~near, 1].mean()
    again = by_head(known)(asked)
    assert (again.mean == told.mean).all()
