"""Several trainers: the same training, the same bits again after a kill, and refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from planted_training import TINY, die_in_training, toy_pairs
from torch import nn

from elfslam.app.workers.together import Work
from elfslam.base.errors import ParameterError, StoreError, WorkerError
from elfslam.base.values import ECHO_SAMPLES, EchoPairs
from elfslam.learn import trainers
from elfslam.learn.floor_level import SpotEchoes, learn_floor
from elfslam.learn.parameters import FloorLevelParameters
from elfslam.learn.pretrain import Pretrained, Progress, pretrain
from elfslam.learn.trainers import (
    check_trainers,
    learn_floor_by_several,
    pretrain_by_several,
)
from elfslam.line.feature import OnnxEncoder, load_encoder


def by_two(
    checkpoint: Path,
    *,
    seed: int = 0,
    pairs_of: Callable[[int], EchoPairs] = toy_pairs,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Pretrained:
    return pretrain_by_several(
        pairs_of, TINY, trainers=2, seed=seed, checkpoint=checkpoint, report=report
    )


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Pretrained:
    return by_two(tmp_path_factory.mktemp("undisturbed") / "training.checkpoint")


def same_weights(one: nn.Module, other: nn.Module) -> bool:
    pairs = zip(one.state_dict().items(), other.state_dict().items(), strict=True)
    return all(name == known and torch.equal(a, b) for (name, a), (known, b) in pairs)


def test_two_train_as_one_does(undisturbed: Pretrained, tmp_path: Path) -> None:
    alone = pretrain(
        toy_pairs, TINY, seed=0, checkpoint=tmp_path / "alone", report=lambda progress: None
    )
    np.testing.assert_allclose(undisturbed.losses, alone.losses, rtol=3e-5)
    assert undisturbed.arithmetic == "float32, 2 trainers"
    assert not undisturbed.network.training


def planted(monkeypatch: pytest.MonkeyPatch, folder: Path, **death: Any) -> None:
    """One of the trainers dies."""
    real = trainers.together

    def dying(work: Work[Any, Any], count: int, *, hear: Callable[[Any], None]) -> None:
        do = partial(die_in_training, do=work.do, folder=folder, **death)
        real(replace(work, do=do), count, hear=hear)

    monkeypatch.setattr(trainers, "together", dying)


@pytest.mark.parametrize("number", [1, pytest.param(0, marks=pytest.mark.slow)])
def test_a_trainer_that_is_killed_changes_nothing(
    number: int, undisturbed: Pretrained, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted(monkeypatch, tmp_path, number=number, step=4, times=1)
    steps: list[int] = []
    made = by_two(tmp_path / "checkpoint", report=lambda progress: steps.append(progress.step))
    assert len(list(tmp_path.glob("death-*"))) == 1
    assert same_weights(made.network, undisturbed.network)
    assert made.losses.tolist() == undisturbed.losses.tolist()
    assert sorted(set(steps)) == [1, 2, 3, 4, 5, 6]
    assert len(steps) <= 6 + TINY.checkpoint_steps + 3, "from the last checkpoint"


@pytest.mark.slow
def test_a_stream_that_fails_ends_the_training_and_it_goes_on(
    undisturbed: Pretrained, tmp_path: Path
) -> None:
    def failing(step: int) -> EchoPairs:
        if step == 5:
            raise StoreError("planted")
        return toy_pairs(step)

    with pytest.raises(StoreError, match="planted"):
        by_two(tmp_path / "checkpoint", pairs_of=failing)
    assert same_weights(by_two(tmp_path / "checkpoint").network, undisturbed.network)


def test_a_checkpoint_of_another_number_of_trainers_is_refused(tmp_path: Path) -> None:
    """Sums are rounded otherwise, so bits would be neither's."""
    pretrain(toy_pairs, TINY, seed=0, checkpoint=tmp_path / "one", report=lambda progress: None)
    with pytest.raises(StoreError, match="another seed, parameters or arithmetic"):
        by_two(tmp_path / "one")


def test_a_trainer_of_another_version_is_refused_before_it_trains(tmp_path: Path) -> None:
    for do in (
        partial(trainers._pretrain, parameters=TINY, seed=0),
        partial(trainers._learn_floor, start=None, parameters=FLOOR),  # type: ignore[arg-type]
    ):
        with pytest.raises(WorkerError, match=r"got PyTorch .*, wanted 0\.0\.0; install the same"):
            do(None, checkpoint=tmp_path / "none", torch_version="0.0.0")  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [0, -1, 3, 8])
def test_numbers_that_cannot_share_a_batch_are_refused(count: int) -> None:
    with pytest.raises(ParameterError, match=f"trainers: got {count}, wanted a number that"):
        check_trainers(TINY, count)


SPOTS_M = np.column_stack([np.arange(12.0), np.zeros(12)])
FLOOR = FloorLevelParameters(
    steps=4, opening_batches=2, warmup_steps=2, checkpoint_steps=2, near_m=0.3
)


def floor_echoes(step: int) -> SpotEchoes:
    drawn, fixed = np.random.default_rng([3, step]), np.random.default_rng(0)
    sounds = fixed.standard_normal((len(SPOTS_M), ECHO_SAMPLES))
    spot = drawn.integers(0, len(SPOTS_M), 24)
    hiss = 0.3 * drawn.standard_normal((24, ECHO_SAMPLES))
    decay = 0.01 * np.exp(-np.arange(ECHO_SAMPLES) / 700)
    return SpotEchoes(decay * (sounds[spot] + hiss), SPOTS_M[spot], np.zeros(24))


def shipped() -> OnnxEncoder:
    encoder = load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    return encoder


@pytest.mark.slow
@pytest.mark.parametrize("part", ["whole", "head"])
def test_two_learn_a_floor_as_one_does(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of the two is killed on the way."""
    known = replace(FLOOR, part=part)
    alone = learn_floor(
        shipped(), SPOTS_M, floor_echoes, known, seed=0, checkpoint=tmp_path / "alone"
    )
    planted(monkeypatch, tmp_path, number=1, step=3, times=1)
    two = learn_floor_by_several(
        shipped(), SPOTS_M, floor_echoes, known,
        trainers=2, seed=0, checkpoint=tmp_path / "two",
    )  # fmt: skip
    np.testing.assert_allclose(two.losses, alone.losses, rtol=1e-4)
    samples = floor_echoes(50).samples
    np.testing.assert_allclose(two.encoder.embed(samples), alone.encoder.embed(samples), atol=2e-3)
    assert two.encoder.card is not None
    assert two.encoder.card.finetunings[-1].echoes == 24 * FLOOR.steps
    assert len(list(tmp_path.glob("death-*"))) == 1
