"""Processes and clusters: the same results as here, errors that come back, workers that die."""

import os
import pickle
import socket
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from planted_work import die, die_once, process, refuse, square, threads

from elfslam.app import workers as pools
from elfslam.app.workers import Workers, open_workers, silent_elsewhere, unit_key, why_away
from elfslam.base.errors import InputError, WorkerError

pytestmark = pytest.mark.real

ELSEWHERE = pytest.mark.parametrize("workers", ["2", "ray"], indirect=True)


def test_every_task_is_done_once(workers: Workers) -> None:
    assert sorted(workers.each(square, range(20))) == [(k, k * k) for k in range(20)]
    assert list(workers.each(square, [])) == []


def test_tasks_are_taken_as_they_are_needed(workers: Workers) -> None:
    """An endless row of tasks is none too many: a few are taken ahead, whoever stops is heard."""
    taken = []
    found = workers.each(square, (taken.append(k) or k for k in count()))
    assert {next(found)[0] for _ in range(5)} <= set(range(5 + 6 * workers.count))
    found.close()
    assert len(taken) <= 5 + 6 * workers.count


def test_a_task_has_one_thread_wherever_it_is_done(workers: Workers) -> None:
    assert [used for _, used in workers.each(threads, range(2))] == [1, 1]


def test_what_a_task_raises_is_raised_here(workers: Workers) -> None:
    with pytest.raises(ValueError, match="no 3 here"):
        list(workers.each(refuse, range(20)))
    assert sorted(workers.each(square, [2])) == [(0, 4)], "others can go on"


@ELSEWHERE
def test_work_elsewhere_is_done_elsewhere(workers: Workers) -> None:
    assert os.getpid() not in {found for _, found in workers.each(process, range(8))}


@ELSEWHERE
def test_a_killed_worker_costs_the_task_it_worked_on(workers: Workers, tmp_path: Path) -> None:
    done = sorted(workers.each(partial(die_once, folder=tmp_path), range(8)))
    assert done == [(k, k) for k in range(8)]
    begun = [file.name.split("-")[0] for file in tmp_path.iterdir()]
    assert sorted(begun) == sorted([*"01234567", "3"])


@ELSEWHERE
def test_a_task_that_kills_whoever_takes_it_is_given_up(workers: Workers) -> None:
    with pytest.raises(WorkerError, match="died over"):
        list(workers.each(die, [1]))


@pytest.mark.parametrize("on", ["0", "-1", "two", "rays", "ray:/x", ""])
def test_who_is_nobody_is_refused(on: str) -> None:
    with (
        pytest.raises(InputError, match="wanted a number of processes, ray or ray://"),
        open_workers(on),
    ):
        pass


def test_a_cluster_that_is_not_there_is_refused() -> None:
    pytest.importorskip("ray", reason="Ray is not installed")
    with pytest.raises(InputError, match="no cluster answers"), open_workers("ray://127.0.0.1:9"):
        pass


@pytest.mark.parametrize(
    "on", ["0", "-1", "two", "rays", "ray://", "ray://:10001", "ray://host:x", "ray://me:hunter2@h"]
)
def test_who_is_nobody_is_refused_of_choosing(on: str) -> None:
    with pytest.raises(InputError, match=r"wanted a number of processes, ray or ray://") as said:
        pools.check_on(on)
    assert "hunter2" not in str(said.value)


def test_a_cluster_is_away_where_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        place = f"ray://127.0.0.1:{listening.getsockname()[1]}"
        assert why_away(place) is None
    assert why_away(place) == "Connection refused"
    assert why_away(None) is why_away("2") is why_away("ray") is None


@dataclass(frozen=True)
class Walk:
    world: str
    seed: int


def measure(walk: Walk, rounds: int = 1, announce: object = None) -> int:
    return walk.seed * rounds


def other(walk: Walk) -> int:
    return 0


WALK = Walk("studio", 1)


def test_the_same_inputs_have_the_same_key() -> None:
    assert unit_key(measure, WALK) == unit_key(measure, Walk("studio", 1))
    assert len(unit_key(measure, WALK)) == 24


@pytest.mark.parametrize(
    ("do", "task"),
    [
        (measure, Walk("studio", 2)),
        (measure, Walk("lounge", 1)),
        (other, WALK),
        (partial(measure, rounds=2), WALK),
        (partial(measure, rounds=[other]), WALK),
        (partial(measure, rounds={"a": measure}), WALK),
    ],
)
def test_another_input_has_another_key(do: Any, task: Walk) -> None:
    assert unit_key(do, task) != unit_key(measure, WALK)


def test_functions_count_by_name_and_not_by_where_they_lie() -> None:
    """An address would make the same run another one."""
    known = unit_key(partial(measure, rounds={"a": other}), WALK)
    assert known != unit_key(partial(measure, rounds={"a": measure}), WALK)
    assert known != unit_key(partial(measure, rounds={"b": other}), WALK)


def test_who_hears_of_it_is_no_input() -> None:
    told = partial(measure, announce=silent_elsewhere(print))
    assert unit_key(told, WALK) == unit_key(partial(measure), WALK)


def test_an_announcement_is_heard_here_and_nowhere_else(capsys: pytest.CaptureFixture[str]) -> None:
    here = silent_elsewhere(print)
    elsewhere = pickle.loads(pickle.dumps(here))
    elsewhere("walking", 0.1)
    here("mapping", 0.5)
    assert capsys.readouterr().out == "mapping 0.5\n"
    assert silent_elsewhere(here) is here
