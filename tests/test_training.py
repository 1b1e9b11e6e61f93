"""`elfslam pretrain` by several: the same echoes whoever makes them, and refusals in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.app.simulated_training import open_stream, pairs_in
from elfslam.cli.app import run
from elfslam.learn.parameters import PretrainParameters

TINY = ("steps=2", "pairs=4", "rooms=2", "width=4", "warmup_steps=1")


def command(out: Path, *options: str) -> int:
    settings = [word for setting in TINY for word in ("--set", f"pretrain.{setting}")]
    return run(["pretrain", str(out), *settings, *options])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--trainers", "0"), "trainers: got 0, wanted a number that pretrain.pairs (4)"),
        (("--trainers", "3"), "trainers: got 3, wanted a number that"),
        (("--trainers", "4"), "two times or more; change one"),
        (("--trainers", "two"), "valid integer"),
        (("--on", "nobody"), "--on 'nobody': wanted a number of processes, ray or ray://"),
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


@pytest.mark.slow
def test_two_trainers_write_an_encoder_that_says_so(
    tmp_path: Path,
) -> None:
    from elfslam.line.feature import read_card

    out = tmp_path / "one.onnx"
    assert command(out, "--trainers", "2") == 0
    known = read_card(str(out))
    assert known is not None
    assert known.pretraining is not None
    assert known.pretraining.arithmetic.endswith("2 trainers")
    assert not out.with_suffix(".checkpoint").exists()


def test_the_echoes_of_a_step_are_the_same_wherever_they_are_made() -> None:
    pairs_of = pairs_in(PretrainParameters(pairs=4, rooms=2), 7)
    with open_stream("1") as here, open_stream("2") as elsewhere:
        streams = [list(stream(pairs_of, 3, 6)) for stream in (here, elsewhere)]
    for step, batch in streams[1]:
        assert np.array_equal(batch.first, pairs_of(step).first)
        assert np.array_equal(batch.xy_m, pairs_of(step).xy_m)
    assert [step for step, _ in streams[0]] == [step for step, _ in streams[1]] == [3, 4, 5]
    assert not np.array_equal(streams[0][0][1].first, streams[0][1][1].first)
