"""The study of fine-tuning, in miniature: what is told after it is of what it gave."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.base.values import Echoes
from elfslam.learn.parameters import FinetuneParameters
from studies import finetuning
from studies.finetuning import AFTER, BEFORE, CLOSURES
from studies.study import StudyContext


class Deaf:
    """Random unit vectors, whatever is heard."""

    identity = "deaf"
    still = 1.0

    def __init__(self) -> None:
        self._generator = np.random.default_rng(0)

    def embed(self, samples: F32) -> F32:
        rows = self._generator.standard_normal((len(samples), 128))
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


def test_before_is_the_shipped_encoder_and_after_what_fine_tuning_gave(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A fine-tuning that makes the encoder deaf is planted."""
    asked: list[tuple[int, int]] = []

    def deafened(
        encoder: object, echoes: Echoes, known: FinetuneParameters, seed: int, say: object
    ) -> SimpleNamespace:
        asked.append((known.steps, seed))
        assert len(echoes.t_s) > 100
        return SimpleNamespace(encoder=Deaf())

    monkeypatch.setattr(finetuning, "finetuned", deafened)
    found = finetuning.measure_finetuning(
        StudyContext(), worlds=("studio",), seeds=(108,), rounds=2,
        parameters=FinetuneParameters(steps=7),
    )  # fmt: skip
    assert asked == [(7, 108)]
    value = {(each.method, each.metric): each.value for each in found}
    assert value[BEFORE, "AUC"] > 0.9
    assert value[AFTER, "AUC"] < 0.75
    recall = "recall at 1 % false positives"
    assert value[BEFORE, recall] > 0.5
    assert value[AFTER, recall] < 0.1
    assert value[BEFORE, CLOSURES] >= 5
