"""The same weights whoever is killed, in a small version."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.app.simulated_training import pairs_in
from elfslam.app.workers import open_workers
from elfslam.base.errors import InputError
from elfslam.learn.parameters import PretrainParameters
from studies.pretraining_kills import (
    DRIVER,
    NOBODY,
    STREAM,
    TRAINER,
    WAYS,
    Way,
    measure_pretraining_kills,
    pairs_or_death,
)

SMALL = PretrainParameters(steps=6, pairs=8, rooms=2, width=4, warmup_steps=2, checkpoint_steps=2)
ALONE, BESIDE, TWO, RAY = WAYS


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "killed"), [(ALONE, DRIVER), (TWO, TRAINER), (RAY, STREAM)], ids=str
)
def test_a_kill_changes_no_bit(way: Way, killed: str) -> None:
    if way is RAY:
        pytest.importorskip("ray", reason="Ray is not installed")
    rows = measure_pretraining_kills(
        None,
        lambda *_: None,
        ways=[replace(way, killed=(NOBODY, killed))],
        parameters=SMALL,
        kill_step=5,
        timed=None,
    )
    assert [row["killed"] for row in rows] == [NOBODY, killed]
    assert rows[0]["weights"] == rows[1]["weights"]
    assert rows[1]["same"] is True
    assert rows[0]["again"] == 0
    assert rows[0]["lost (s)"] is None
    assert rows[1]["again"] in ((0,) if killed == STREAM else (1, 2, 3))
    assert rows[0]["rate"] == 1.0


def test_the_study_kills_each_kind_of_process() -> None:
    assert BESIDE.killed == (NOBODY, STREAM, DRIVER)
    assert {victim for way in WAYS for victim in way.killed} == {NOBODY, STREAM, TRAINER, DRIVER}


def test_a_batch_kills_once_and_is_then_the_same(tmp_path: Path) -> None:
    known, dead = pairs_in(SMALL, 5), tmp_path / "dead"
    dead.touch()
    made = pairs_or_death(3, pairs_of=known, step=3, dead=dead)
    assert np.array_equal(made.first, known(3).first)


def test_it_is_no_work_to_be_given_away() -> None:
    with open_workers("2") as two, pytest.raises(InputError, match="compares who works"):
        measure_pretraining_kills(None, lambda *_: None, workers=two)
