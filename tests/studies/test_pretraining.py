"""Training the shipped encoder, in miniature."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.base.errors import ParameterError, StoreError
from elfslam.learn.settings import PretrainParameters
from elfslam.line.feature import load_encoder
from elfslam.studies import pretraining
from elfslam.studies.pretraining import pretrain_on_simulated_echoes

SMALL = PretrainParameters(steps=3, pairs=8, rooms=2, width=4, warmup_steps=1, checkpoint_steps=2)


@pytest.mark.slow
def test_the_same_seed_trains_the_same_encoder(tmp_path: Path) -> None:
    shares: list[float | None] = []
    for name in ("one", "two"):
        loss = pretrain_on_simulated_echoes(
            tmp_path / f"{name}.onnx",
            SMALL,
            seed=3,
            announce=lambda what, share: shares.append(share),
        )
        assert loss > 0
    one, two = (load_encoder(str(tmp_path / f"{name}.onnx")) for name in ("one", "two"))
    assert one.identity == two.identity
    assert shares[:3] == pytest.approx([1 / 3, 2 / 3, 1.0])
    assert {file.suffix for file in tmp_path.iterdir()} == {".onnx"}


def silent(what: str, share: float | None) -> None:
    """Announce nothing."""


def never(*arguments: object, **named: object) -> None:
    raise AssertionError("the training must not start")


@pytest.mark.parametrize(
    ("name", "parameters", "error", "words"),
    [
        ("new/one.onnx", replace(SMALL, pairs=9), ParameterError, "multiple of pretrain.rooms"),
        ("new/one.checkpoint", SMALL, StoreError, r"ends in \.onnx"),
    ],
)
def test_what_cannot_be_trained_is_refused_before_anything_is_made(
    name: str,
    parameters: PretrainParameters,
    error: type[Exception],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pretraining, "pretrain", never)
    with pytest.raises(error, match=words):
        pretrain_on_simulated_echoes(tmp_path / name, parameters, seed=0, announce=silent)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("checkpoint", "left"), [(False, []), (True, ["new", "deep", "a.pt"])])
def test_a_training_that_fails_leaves_a_folder_only_for_its_checkpoint(
    checkpoint: bool, left: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "new" / "deep"

    def fail(*arguments: object, **named: object) -> None:
        assert folder.is_dir()
        if checkpoint:
            (folder / "a.pt").touch()
        raise RuntimeError("planted")

    monkeypatch.setattr(pretraining, "pretrain", fail)
    with pytest.raises(RuntimeError, match="planted"):
        pretrain_on_simulated_echoes(folder / "one.onnx", SMALL, seed=0, announce=silent)
    assert [path.name for path in sorted(tmp_path.rglob("*"))] == left
