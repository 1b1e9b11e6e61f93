"""`elfslam pretrain` by several: the same echoes whoever makes them, and refusals in one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elfslam.app.simulated_training import open_stream, pairs_in
from elfslam.cli.app import run
from elfslam.learn.parameters import PretrainParameters
from elfslam.stages.feature import read_card

TINY = ("steps=2", "pairs=4", "rooms=2", "width=4", "warmup_steps=1")
SETTINGS = [word for setting in TINY for word in ("--set", f"pretrain.{setting}")]


def command(out: Path, *options: str) -> int:
    return run(["pretrain", str(out), *SETTINGS, *options])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--on", "nobody"), "--on nobody: wanted a number of processes, ray or ray://"),
        (("--on", "ray://127.0.0.1:9"), "no cluster answers"),
    ],
)
def test_bad_numbers_are_refused_in_one_line(
    options: tuple[str, ...],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "ray" in words + options[1]:
        pytest.importorskip("ray", reason="Ray is not installed")
    assert command(tmp_path / "new" / "one.onnx", *options) == 2
    said = capsys.readouterr().err.strip()
    assert words in said
    assert "\n" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.real
def test_two_processes_of_torchrun_write_one_encoder_that_says_so(tmp_path: Path) -> None:
    both, one = tmp_path / "both.onnx", tmp_path / "one.onnx"
    program = "import sys; from elfslam.cli import main; sys.argv[0] = 'elfslam'; main()"
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    launched = [*torchrun, "--nproc-per-node", "2", "--no-python", sys.executable, "-c", program]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([*launched, "pretrain", str(both), *SETTINGS], check=True, env=environment)
    assert command(one) == 0
    shared, alone = (read_card(str(file)) for file in (both, one))
    assert shared is not None
    assert alone is not None
    assert shared.pretraining is not None
    assert alone.pretraining is not None
    assert shared.pretraining.arithmetic.endswith("2 processes")
    assert shared.pretraining.loss == pytest.approx(alone.pretraining.loss, abs=2e-3)
    assert not both.with_suffix(".checkpoint").exists()


def test_the_echoes_of_a_step_are_the_same_wherever_they_are_made() -> None:
    pairs_of = pairs_in(PretrainParameters(pairs=4, rooms=2), 7)
    with open_stream("1") as here, open_stream("2") as elsewhere:
        streams = [list(stream(pairs_of, 3, 6)) for stream in (here, elsewhere)]
    for step, batch in streams[1]:
        assert np.array_equal(batch.first, pairs_of(step).first)
        assert np.array_equal(batch.xy_m, pairs_of(step).xy_m)
    assert [step for step, _ in streams[0]] == [step for step, _ in streams[1]] == [3, 4, 5]
    assert not np.array_equal(streams[0][0][1].first, streams[0][1][1].first)
