"""How much must be heard, in small: encoders are kept, and more of a walk is more to learn from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.app import simulated_training as pretraining
from elfslam.base.progress import silent
from elfslam.learn.parameters import ScratchParameters
from studies import amounts
from studies.amounts import ERROR, FINETUNED, PRETRAINED, RECALL, TrainedWalk, measure_amounts
from studies.finding import Finding, Given
from studies.simulated_walk import SimulatedWalk


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("amounts")


@pytest.fixture(scope="module")
def found(folder: Path) -> Finding:
    with pytest.MonkeyPatch.context() as patch:
        few = replace(ScratchParameters(), steps=2, pairs=16)
        patch.setattr(amounts, "ScratchParameters", lambda: few)
        patch.setattr(amounts, "ROUNDS", 2)
        return measure_amounts(
            Given(kept=folder / "amounts.partial"), echoes=(512,), minutes=(), worlds=("studio",),
            seeds=(100,),
        )  # fmt: skip


def test_a_row_for_each_amount_and_measure(found: Finding) -> None:
    known = [(row["varied"], row["at"], row["measure"]) for row in found.rows]
    assert known == [(PRETRAINED, 512, ERROR), (PRETRAINED, 512, RECALL)]
    error, recall = found.rows
    assert 0.0 < float(str(error["mean"])) < 3.0
    assert 0.0 <= float(str(recall["mean"])) < 0.8, "one batch teaches little"


def test_the_page_has_the_losses_from_both_starts(found: Finding) -> None:
    assert found.page is not None
    (losses,) = (panel for panel in found.page.panels if panel.title == "Loss on one walk")
    fresh, trained = (trace.y for trace in losses.body.data)  # type: ignore[union-attr]
    assert len(fresh) == len(trained) == 2
    assert np.mean(trained) < np.mean(fresh)


def test_an_encoder_is_trained_once(
    found: Finding, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert found.rows
    monkeypatch.setattr(pretraining, "pretrain_on_simulated_echoes", None)
    again = amounts._trained(512, folder / "encoders", silent)
    assert again.content == (folder / "encoders" / "512.onnx").read_bytes()


def test_fine_tuning_hears_the_first_minutes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = []

    def listen(encoder, echoes, known, seed, announce):  # type: ignore[no-untyped-def]
        heard.append(echoes)
        raise InterruptedError

    monkeypatch.setattr(amounts, "finetuned", listen)
    with pytest.raises(InterruptedError):
        amounts._measured(
            TrainedWalk(FINETUNED, 0.5, SimulatedWalk("studio", 100, 2)), None, silent
        )
    assert 29.0 < np.ptp(heard[0].t_s) <= 30.0
