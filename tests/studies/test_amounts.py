"""How much training takes, in small: encoders are kept, and a trained start has less to lose."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.app import simulated_training as pretraining
from elfslam.base.values import silent
from elfslam.learn.parameters import PretrainParameters
from elfslam.stages.feature import OnnxEncoder
from studies import amounts
from studies.amounts import FINETUNED, LOSS, PRETRAINED, RECALL, STARTS, STUDY, TrainedWalk
from studies.cached import SimulatedWalk
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("amounts")


@pytest.fixture(scope="module")
def found(folder: Path) -> list[Record]:
    return list(STUDY.measure(StudyContext(kept=folder / "amounts.partial"), **STUDY.fast))


def test_one_batch_teaches_little(found: list[Record]) -> None:
    value = {each.metric: each.value for each in found if each.method == PRETRAINED}
    assert 0.0 < value[MEDIAN_ALIGNED] < 3.0
    assert 0.0 <= value[RECALL] < 0.8


def test_the_loss_begins_lower_from_what_was_trained(found: list[Record]) -> None:
    fresh, trained = (
        [each.value for each in found if (each.method, each.metric) == (start, LOSS)]
        for start in STARTS
    )
    assert len(fresh) == len(trained) == 2
    assert np.mean(trained) < np.mean(fresh)


def test_an_encoder_is_trained_once(
    found: list[Record], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert found
    monkeypatch.setattr(pretraining, "pretrain_on_simulated_echoes", None)
    again = amounts._trained(512, folder / "encoders", PretrainParameters(), silent)
    assert isinstance(again, OnnxEncoder)
    assert again.content == (folder / "encoders" / "512.onnx").read_bytes()


def test_fine_tuning_learns_from_the_first_minutes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    given = []

    def listen(encoder, echoes, known, seed, announce):
        given.append(echoes)
        raise InterruptedError

    monkeypatch.setattr(amounts, "finetuned", listen)
    with pytest.raises(InterruptedError):
        amounts._measured(
            TrainedWalk(FINETUNED, 0.5, SimulatedWalk("studio", 100, 2)), lambda echoes: None
        )
    assert 29.0 < np.ptp(given[0].t_s) <= 30.0
