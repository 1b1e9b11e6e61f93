"""Training the shipped encoder, in miniature."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.learn.settings import PretrainParameters
from elfslam.line.feature import load_encoder
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
