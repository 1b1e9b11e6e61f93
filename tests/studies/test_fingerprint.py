"""The supervised fingerprint: it learns planted spots, repeats itself and scores by hand."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from elfslam.base.arrays import F32, I64
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES
from studies import fingerprint
from studies.fingerprint import FingerprintParameters, SpotClassifier, train_fingerprint

QUICK = FingerprintParameters(epochs=8, batch=16, learning_rate=2e-3, threads=1)
SPOTS = 4


def labelled(per_spot: int, seed: int) -> tuple[F32, I64]:
    """Every spot has a decaying noise of its own; each echo is that plus a little more."""
    generator = np.random.default_rng(seed)
    decay = 0.01 * np.exp(-np.arange(ECHO_SAMPLES) / 600)
    own = np.random.default_rng(99).standard_normal((SPOTS, ECHO_SAMPLES))
    spot = np.repeat(np.arange(SPOTS), per_spot)
    noise = generator.standard_normal((len(spot), ECHO_SAMPLES))
    return np.asarray((own[spot] + 0.3 * noise) * decay, dtype=np.float32), spot


@pytest.fixture(scope="module")
def network() -> SpotClassifier:
    return train_fingerprint(*labelled(16, 0), QUICK, seed=0)


def test_planted_spots_are_named_in_echoes_not_heard_before(network: SpotClassifier) -> None:
    samples, spot = labelled(10, 1)
    assert np.mean(fingerprint.named_spots(network, samples) == spot) > 0.9


def test_the_same_seed_gives_the_same_classifier() -> None:
    quick = FingerprintParameters(epochs=1, batch=16)
    shares: list[float] = []
    one, same, other = (
        train_fingerprint(*labelled(8, 0), quick, seed=seed, report=shares.append).state_dict()
        for seed in (0, 0, 1)
    )
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert not torch.equal(one["head.weight"], other["head.weight"])
    assert shares == [0.5, 1.0] * 3


def test_one_that_was_interrupted_goes_on_as_if_it_had_not_been(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples, spot = labelled(8, 0)
    quick = FingerprintParameters(threads=1)
    monkeypatch.setattr(fingerprint, "CHECKPOINT_STEPS", 2)
    asked: list[int] = []

    def learnt(checkpoint: Path, end: int) -> dict[str, torch.Tensor]:
        def batch_of(step: int) -> tuple[F32, I64]:
            if step == end:
                raise KeyboardInterrupt
            asked.append(step)
            return samples[step::3], spot[step::3]

        given = partial(fingerprint.train_on_batches, batch_of, SPOTS, 5, quick, seed=0)
        return dict(given(checkpoint=checkpoint).state_dict())

    whole = learnt(tmp_path / "whole", 9)
    with pytest.raises(KeyboardInterrupt):
        learnt(tmp_path / "part", 3)
    asked.clear()
    continued = learnt(tmp_path / "part", 9)
    assert asked == [2, 3, 4], "from the last checkpoint"
    assert all(torch.equal(whole[name], continued[name]) for name in whole)


def test_two_that_learn_at_once_do_not_mix_their_first_weights() -> None:
    quick = FingerprintParameters(epochs=1, batch=16, threads=1)

    def learnt(seed: int) -> torch.Tensor:
        return train_fingerprint(*labelled(8, 0), quick, seed=seed).state_dict()["head.weight"]

    with ThreadPoolExecutor(2) as pool:
        at_once = list(pool.map(learnt, (0, 1)))
    assert all(torch.equal(learnt(seed), weights) for seed, weights in enumerate(at_once))


def test_the_score_is_counted_by_hand() -> None:
    spots_m = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 1.0]])
    named, spot = np.array([0, 1, 1, 2]), np.array([0, 1, 0, 0])
    score = fingerprint.score_fingerprint(named, spot, spots_m)
    assert score == fingerprint.FingerprintScore(0.5, 1.5)


@pytest.mark.parametrize(
    ("rows", "labels", "match"),
    [(16, 15, "and 15 spots"), (15, 15, "at least one batch of 16 echoes, got 15")],
)
def test_too_few_echoes_or_labels_are_refused(rows: int, labels: int, match: str) -> None:
    samples, spot = labelled(4, 0)
    with pytest.raises(InputError, match=match):
        train_fingerprint(samples[:rows], spot[:labels], QUICK, seed=0)
