"""The paper's training: an encoder of simulated rooms is kept, one of a walk knows its places."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, Echoes
from elfslam.learn.parameters import ScratchParameters
from elfslam.stages.feature import OnnxEncoder
from studies.paper_training import learnt_from_walk

FEW = replace(ScratchParameters(), steps=40, pairs=32, near_s=1.0, threads=1)


def passing(stretches: int, each: int) -> Echoes:
    """A walk past `stretches` places of their own sound, with noise on every echo."""
    generator = np.random.default_rng(0)
    sound = generator.standard_normal((stretches, ECHO_SAMPLES)).astype(np.float32)
    samples = np.repeat(sound, each, axis=0)
    samples += 0.5 * generator.standard_normal(samples.shape, dtype=np.float32)
    count = len(samples)
    return Echoes(0.1 * np.arange(count), samples, np.zeros((0, 2)))


@pytest.fixture(scope="module")
def walk() -> Echoes:
    return passing(8, 12)


@pytest.fixture(scope="module")
def learnt(walk: Echoes) -> OnnxEncoder:
    return learnt_from_walk(walk, FEW, seed=1, width=8)


def test_it_tells_the_stretches_apart(walk: Echoes, learnt: OnnxEncoder) -> None:
    rows = learnt.embed(walk.samples)
    place = np.arange(len(rows)) // 12
    cosine, same = rows @ rows.T, place[:, None] == place
    np.fill_diagonal(same, False)
    apart = place[:, None] != place
    assert cosine[same].mean() > cosine[apart].mean() + 0.2


def test_a_seed_gives_one_encoder(walk: Echoes, learnt: OnnxEncoder) -> None:
    assert learnt_from_walk(walk, FEW, seed=1, width=8).content == learnt.content
    assert learnt_from_walk(walk, FEW, seed=2, width=8).content != learnt.content


def test_too_few_echoes_are_refused() -> None:
    with pytest.raises(InputError, match="wanted 32 consecutive echoes, got 19; walk longer"):
        learnt_from_walk(passing(2, 10), FEW, seed=0, width=8)


def test_a_start_is_where_it_begins(walk: Echoes, learnt: OnnxEncoder) -> None:
    """Without steps the start comes out; with them, its first loss is that of what was learnt."""
    none = replace(FEW, steps=0)
    same = learnt_from_walk(walk, none, seed=5, start=learnt)
    np.testing.assert_allclose(same.embed(walk.samples), learnt.embed(walk.samples), atol=1e-5)
    fresh: list[float] = []
    going_on: list[float] = []
    learnt_from_walk(walk, FEW, seed=1, width=8, report=fresh.append)
    learnt_from_walk(walk, FEW, seed=1, start=learnt, report=going_on.append)
    assert len(fresh) == len(going_on) == FEW.steps
    assert going_on[0] < 0.8 * fresh[0]
    assert fresh[-1] < fresh[0]


def test_the_statistics_of_a_start_stay(walk: Echoes, learnt: OnnxEncoder) -> None:
    """Where nothing is learnt nothing changes: its norms do not take on those of the walk."""
    idle = replace(FEW, steps=5, learning_rate=1e-9)
    same = learnt_from_walk(walk, idle, seed=5, start=learnt)
    np.testing.assert_allclose(same.embed(walk.samples), learnt.embed(walk.samples), atol=1e-4)
