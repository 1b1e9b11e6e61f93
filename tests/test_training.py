"""`elfslam pretrain` by several: the same echoes whoever makes them, and refusals in one line."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.app.simulated_training import open_stream, pairs_in
from elfslam.cli.app import run
from elfslam.learn.parameters import PretrainParameters

TINY = ("steps=2", "pairs=4", "rooms=2", "width=4", "warmup_steps=1")
SETTINGS = [word for setting in TINY for word in ("--set", f"pretrain.{setting}")]


def command(out: Path, *options: str) -> int:
    return run(["pretrain", str(out), *SETTINGS, *options])


def test_nobody_to_work_for_it_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(tmp_path / "new" / "one.onnx", "--on", "nobody") == 2
    said = capsys.readouterr().err.strip()
    assert "on nobody: wanted a number of processes, ray or ray://" in said
    assert "\n" not in said
    assert list(tmp_path.iterdir()) == []


def test_the_echoes_of_a_step_are_the_same_wherever_they_are_made() -> None:
    pairs_of = pairs_in(PretrainParameters(pairs=4, rooms=2), 7)
    with open_stream("1") as here, open_stream("2") as elsewhere:
        streams = [list(stream(pairs_of, 3, 6)) for stream in (here, elsewhere)]
    for step, batch in streams[1]:
        assert np.array_equal(batch.first, pairs_of(step).first)
        assert np.array_equal(batch.xy_m, pairs_of(step).xy_m)
    assert [step for step, _ in streams[0]] == [step for step, _ in streams[1]] == [3, 4, 5]
    assert not np.array_equal(streams[0][0][1].first, streams[0][1][1].first)
