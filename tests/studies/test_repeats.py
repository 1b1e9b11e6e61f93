"""Repeats: each done once, whatever happens in between."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import pytest

from elfslam.base.errors import StoreError
from elfslam.studies.repeats import Numbers, by_world, finished


def silent(what: str, share: float | None) -> None:
    """Hears nothing."""


def square(task: int) -> Numbers:
    return {"square": float(task * task)}


@pytest.mark.parametrize("workers", [1, 3])
def test_numbers_come_in_the_order_of_the_tasks(tmp_path: Path, workers: int) -> None:
    kept, shares = tmp_path / "new" / "kept", list[float | None]()
    found = finished(
        square, [3, 1, 2], lambda _, share: shares.append(share), kept=kept, workers=workers
    )
    assert found == [{"square": 9.0}, {"square": 1.0}, {"square": 4.0}]
    assert shares == [0.0, 1 / 3, 2 / 3, 1.0]
    assert json.loads(kept.read_text()) == {"3": found[0], "1": found[1], "2": found[2]}


def test_a_run_cut_off_goes_on_where_it_was(tmp_path: Path) -> None:
    kept, asked = tmp_path / "kept", list[int]()

    def failing(task: int) -> Numbers:
        if task == 2:
            raise KeyboardInterrupt
        return square(task)

    with pytest.raises(KeyboardInterrupt):
        finished(failing, [1, 2, 3], silent, kept=kept, workers=1)

    def counted(task: int) -> Numbers:
        asked.append(task)
        return square(task)

    found = finished(counted, [1, 2, 3], silent, kept=kept, workers=1)
    assert found == [square(task) for task in (1, 2, 3)]
    assert 1 not in asked
    assert 2 in asked


def test_nothing_is_kept_where_no_file_is_named(tmp_path: Path) -> None:
    assert finished(square, [5], silent, kept=None, workers=1) == [{"square": 25.0}]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("{", "cannot be read"),
        ("3", "cannot be read"),
        ('{"7": {"square": 49.0}}', "has 7 of another run; delete it to start over"),
    ],
)
def test_what_is_not_of_this_run_is_refused(tmp_path: Path, content: str, complaint: str) -> None:
    kept = tmp_path / "kept"
    kept.write_text(content)
    with pytest.raises(StoreError, match=complaint):
        finished(square, [1], silent, kept=kept, workers=1)
    assert kept.read_text() == content


def test_numbers_are_gathered_by_world_in_the_order_of_their_tasks() -> None:
    tasks = [Walk("studio", 1), Walk("lounge", 1), Walk("studio", 2)]
    gathered = by_world(tasks, [{"a": 1.0}, {"a": 2.0}, {"a": 3.0}])
    assert gathered == {"studio": [{"a": 1.0}, {"a": 3.0}], "lounge": [{"a": 2.0}]}


class Walk(NamedTuple):
    world: str
    seed: int
