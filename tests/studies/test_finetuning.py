"""The study of fine-tuning, in miniature: the row after it is of what fine-tuning gave."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.base.values import Echoes
from elfslam.learn.parameters import FinetuneParameters
from studies import finetuning
from studies.finding import Given


class Deaf:
    """Random unit vectors, whatever is heard."""

    identity = "deaf"
    still = 1.0

    def __init__(self) -> None:
        self._generator = np.random.default_rng(0)

    def embed(self, samples: F32) -> F32:
        rows = self._generator.standard_normal((len(samples), 128))
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


def test_a_row_before_and_one_of_what_fine_tuning_gave(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fine-tuning that makes the encoder deaf is planted."""
    asked: list[tuple[int, int]] = []

    def deafened(
        encoder: object, echoes: Echoes, known: FinetuneParameters, seed: int, say: object
    ) -> SimpleNamespace:
        asked.append((known.steps, seed))
        assert len(echoes.t_s) > 100
        return SimpleNamespace(encoder=Deaf())

    monkeypatch.setattr(finetuning, "finetuned", deafened)
    shares: list[float | None] = []
    before, after = finetuning.measure_finetuning(
        Given(announce=lambda what, share: shares.append(share)),
        worlds=("studio",),
        seeds=(108,),
        rounds=2,
        parameters=FinetuneParameters(steps=7),
    )
    assert asked == [(7, 108)]
    assert (before["encoder"], after["encoder"]) == ("pre-trained", "fine-tuned")
    assert before["same place (pairs)"] == after["same place (pairs)"]
    assert float(str(before["AUC"])) > 0.9
    assert float(str(after["AUC"])) < 0.75
    assert float(str(before["recall at 1 %"])) > 0.5
    assert float(str(after["recall at 1 %"])) < 0.1
    assert float(str(before["closures"])) >= 5
    assert shares == [0.0]
