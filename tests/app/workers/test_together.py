"""Processes that do one work: each its part, one that dies again, and errors that come back."""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from planted_work import count_up, fail_together

from elfslam.app.workers import together as module
from elfslam.app.workers.together import Ended, Work, sit, together
from elfslam.app.workers.versions import Version
from elfslam.base.errors import StoreError, WorkerError


def batches(step: int) -> Generator[list[int]]:
    """Of ten numbers each."""
    for each in range(step, 100):
        yield list(range(10 * each, 10 * each + 10))


def part(batch: list[int], number: int, count: int) -> list[int]:
    return batch[number::count]


def told(folder: Path, **planted: Any) -> list[tuple[int, int]]:
    heard: list[tuple[int, int]] = []
    known = {"keep": True, "dies": 1, "times": 0} | planted
    together(Work(partial(count_up, folder=folder, **known), batches, part), 2, hear=heard.append)
    return heard


EVEN = [sum(range(0, 10 * step, 2)) for step in range(1, 6)]


def test_each_has_its_part_of_every_batch(tmp_path: Path) -> None:
    assert told(tmp_path) == list(enumerate(EVEN))
    odd = sum(range(1, 50, 2))
    assert (tmp_path / "total-1").read_text() == str(odd)


@pytest.mark.parametrize("dies", [0, 1])
def test_one_that_dies_begins_again_from_what_was_kept(tmp_path: Path, dies: int) -> None:
    heard = told(tmp_path, dies=dies, times=2)
    assert len(list(tmp_path.glob("death-*"))) == 2
    assert dict(heard) == dict(enumerate(EVEN)), "the same sums as undisturbed"
    assert len(heard) <= 5 + 2, "one step in flight each time"


def test_who_dies_again_and_again_is_given_up(tmp_path: Path) -> None:
    with pytest.raises(WorkerError, match=r"number 1 was killed \(SIGKILL\), 3 deaths") as found:
        told(tmp_path, keep=False, times=9)
    assert len(list(tmp_path.glob("death-*"))) == 3
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("error", [StoreError("torn"), ValueError("planted")])
def test_what_one_raises_is_raised_here(error: Exception) -> None:
    """Unlike what others raise because of it; with a bare error either may be heard first."""
    with pytest.raises((type(error), RuntimeError)) as found:
        together(Work(partial(fail_together, error=error), batches, part), 2, hear=print)
    assert isinstance(error, ValueError) or found.type is StoreError


class Line:
    """A connection that keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    def send(self, message: Any) -> None:
        self.sent.append(message)


def test_a_process_of_another_version_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "end_with_the_driver", lambda: None)
    line, worked = Line(), []
    wanted = Version("0", "0" * 16, "3", "2")
    sit(worked.append, wanted, 0, 2, "file:///nowhere", line, line)  # type: ignore[arg-type]
    (ended,) = line.sent
    assert isinstance(ended, Ended)
    assert isinstance(ended.error, WorkerError)
    assert "install the same version there" in str(ended.error)
    assert worked == []
