"""Results in order: the same bits whoever makes them, few ahead, and again after a kill."""

import os
import time
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path

import pytest
from planted_work import die, large, noise, noise_after_a_kill, process, refuse, square

from elfslam.app.workers import Workers
from elfslam.app.workers.on_ray import check_version, code_digest, done_by_the_same, own_version
from elfslam.app.workers.processes import AHEAD
from elfslam.base.errors import WorkerError

pytestmark = pytest.mark.real

RAY = "ray"
ELSEWHERE = pytest.mark.parametrize("workers", ["2", RAY], indirect=True)


def test_the_same_bits_in_order(workers: Workers) -> None:
    made = list(workers.in_order(noise, range(3, 15)))
    assert [one.tobytes() for one in made] == [noise(k).tobytes() for k in range(3, 15)]
    assert list(workers.in_order(noise, [])) == []


def test_what_a_task_raises_is_raised_where_it_would_have_come(workers: Workers) -> None:
    found = workers.in_order(refuse, range(6))
    assert [next(found) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="no 3 here"):
        next(found)


@ELSEWHERE
def test_a_killed_worker_costs_what_it_worked_on(workers: Workers, tmp_path: Path) -> None:
    made = list(workers.in_order(partial(noise_after_a_kill, folder=tmp_path), range(8)))
    assert [one.tobytes() for one in made] == [noise(k).tobytes() for k in range(8)]
    assert len(list(tmp_path.glob("3-*"))) == 2


@ELSEWHERE
def test_a_task_that_kills_whoever_takes_it_is_given_up(workers: Workers) -> None:
    with pytest.raises(WorkerError, match="died over"):
        list(workers.in_order(die, [1]))


@pytest.mark.parametrize("workers", ["2"], indirect=True)
def test_few_are_made_ahead_of_who_takes_them(workers: Workers) -> None:
    taken: list[int] = []
    found = workers.in_order(process, (taken.append(k) or k for k in count()))
    pids = {next(found) for _ in range(6)}
    time.sleep(0.2)
    assert len(taken) <= 6 + AHEAD * 2
    assert os.getpid() not in pids
    found.close()


@pytest.mark.parametrize("workers", [RAY], indirect=True)
def test_a_cluster_makes_few_ahead_too(workers: Workers, tmp_path: Path) -> None:
    """Each result is large, so that few fit in what the stream may take of the store."""
    found = workers.in_order(partial(large, folder=tmp_path), range(200))
    assert [next(found)[0, 0] for _ in range(2)] == [0.0, 1.0]
    time.sleep(1.0)
    assert len(list(tmp_path.iterdir())) < 60
    found.close()


def test_the_same_version_works() -> None:
    assert done_by_the_same(own_version(), square, 3) == 9


@pytest.mark.parametrize("name", ["elfslam", "code", "python", "numpy"])
def test_another_version_is_refused_before_it_works(name: str) -> None:
    wanted = replace(own_version(), **{name: "another"})
    with pytest.raises(WorkerError, match=f"got {name} .*, wanted another; install the same"):
        done_by_the_same(wanted, square, 3)


def test_the_digest_of_code_is_of_names_and_contents(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    file = tmp_path / "room" / "line.py"
    file.write_text("x = 1\n")
    known = code_digest(tmp_path)
    (tmp_path / "notes.txt").write_text("not code")
    assert code_digest(tmp_path) == known
    file.write_text("x = 2\n")
    changed = code_digest(tmp_path)
    file.rename(tmp_path / "room" / "lines.py")
    assert len({known, changed, code_digest(tmp_path)}) == 3


def test_versions_say_what_differs() -> None:
    check_version(own_version(), own_version())
    with pytest.raises(WorkerError, match="install the same version there"):
        check_version(own_version(), replace(own_version(), code="0" * 16))
