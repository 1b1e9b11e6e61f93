"""Repeats: each done once, whatever happens in between."""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from pathlib import Path

import pytest

from elfslam.app.workers import Result, Task, unit_key
from elfslam.base.errors import StoreError
from studies.results import Record
from studies.study import SampledError, StudyContext, finished


def square(task: int) -> list[Record]:
    return [Record("square", "area", float(task * task))]


class Backwards:
    """Workers that finish in another order."""

    count = 3

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        for index, task in reversed(list(enumerate(tasks))):
            yield index, do(task)


def test_numbers_come_in_the_order_of_the_tasks(tmp_path: Path) -> None:
    kept, shares = tmp_path / "new" / "kept", list[float | None]()
    context = StudyContext(None, lambda _, share: shares.append(share), kept, Backwards())
    found = finished(square, [3, 1, 2], context)
    assert found == [square(3), square(1), square(2)]
    assert shares == [0.0, 1 / 3, 2 / 3, 1.0]
    units = json.loads(kept.read_text())
    assert units[unit_key(square, 3)] == {"task": "3", "records": [asdict(square(3)[0])]}
    assert [unit["task"] for unit in units.values()] == ["2", "1", "3"]


def test_equal_tasks_are_one_unit() -> None:
    assert finished(square, [2, 3, 2], StudyContext()) == [square(2), square(3), square(2)]


def test_a_run_cut_off_goes_on_where_it_was(tmp_path: Path) -> None:
    kept, asked, allowed = tmp_path / "kept", list[int](), {1, 3}

    def counted(task: int) -> list[Record]:
        asked.append(task)
        if task not in allowed:
            raise KeyboardInterrupt
        return square(task)

    with pytest.raises(KeyboardInterrupt):
        finished(counted, [1, 2, 3], StudyContext(kept=kept))
    allowed.add(2)
    assert finished(counted, [1, 2, 3], StudyContext(kept=kept)) == [square(at) for at in (1, 2, 3)]
    assert asked == [1, 2, 2, 3]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("{", "cannot be read"),
        ("3", "cannot be read"),
        ('{"ab12": {"task": "7", "records": []}}', "has 7 of another run; delete it to start over"),
        ('{"7": {"square": 49.0}}', "cannot be read"),
    ],
)
def test_what_is_not_of_this_run_is_refused(tmp_path: Path, content: str, complaint: str) -> None:
    kept = tmp_path / "kept"
    kept.write_text(content)
    with pytest.raises(StoreError, match=complaint):
        finished(square, [1], StudyContext(kept=kept))
    assert kept.read_text() == content


def test_a_sample_is_spread_over_the_tasks_and_keeps_nothing(tmp_path: Path) -> None:
    asked: list[int] = []

    def noted(task: int) -> list[Record]:
        asked.append(task)
        return square(task)

    context = StudyContext(kept=tmp_path / "kept", sample=2)
    with pytest.raises(SampledError) as found:
        finished(noted, range(8), context)
    assert (asked, found.value.repeats) == ([2, 6, 2, 6], 8)
    assert not (tmp_path / "kept").exists()
