"""Children end with whoever began them, be they in the middle of a call into C or not begun."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from planted_work import tidy

from elfslam.app.workers import open_workers
from elfslam.app.workers.child import ORPHANED, START, Child, end_children
from tests.waiting import until

pytestmark = pytest.mark.real

DRIVER = """
from planted_work import {task}
from elfslam.app.workers import open_workers
if __name__ == "__main__":
    with open_workers("2") as workers:
        for pid in workers.{each}({task}, iter(int, 1)):
            print(pid, flush=True)
"""
EACH, IN_ORDER, DEAF = ("each", "stay"), ("in_order", "stay"), ("each", "stay_in_c")


def children(driver: int) -> list[str]:
    threads = Path(f"/proc/{driver}/task").glob("*/children")
    return [child for file in threads for child in file.read_text().split()]


def at_work(driver: int, task: str) -> list[str]:
    """The children of a driver that have come to a task: both say so in their names."""
    names = {each: Path(f"/proc/{each}/comm").read_text().strip() for each in children(driver)}
    return [each for each, name in names.items() if name == task]


def alive(processes: list[str]) -> list[str]:
    return [each for each in processes if Path(f"/proc/{each}").exists()]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM], ids=["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize(("each", "task"), [EACH, IN_ORDER, DEAF])
def test_workers_end_with_it(each: str, task: str, number: signal.Signals, tmp_path: Path) -> None:
    """Who goes on would begin the same units again while they still work on them."""
    script = tmp_path / "driver.py"
    script.write_text(DRIVER.format(each=each, task=task))
    with subprocess.Popen([sys.executable, script]) as driver:
        until(lambda: len(at_work(driver.pid, task)) == 2, "two processes at work")
        begun = children(driver.pid)
        driver.send_signal(number)
        assert driver.wait() == -number
    assert len(begun) == 2, "nothing besides the two is begun"
    until(lambda: not alive(begun), "the end of both", patience_s=10)


def test_a_child_of_nobody_ends_before_it_begins() -> None:
    theirs, held = os.pipe()
    os.close(held)
    begun = subprocess.run([sys.executable, "-c", START, "nothing"], stdin=theirs, check=False)
    os.close(theirs)
    assert begun.returncode in (ORPHANED, -signal.SIGKILL)


def test_a_child_does_not_hold_what_another_waits_for() -> None:
    """Each has a pipe of its own: one that stays keeps no other alive."""
    with Child("planted_work") as stays, Child("planted_work") as ends:
        ends.release()
        assert ends.wait() in (ORPHANED, -signal.SIGKILL)
        assert stays.poll() is None


def test_a_child_is_ended_with_the_block_and_may_be_talked_to(tmp_path: Path) -> None:
    with Child("planted_work", stdout=subprocess.PIPE) as child:
        with pytest.raises(subprocess.TimeoutExpired):
            child.communicate(timeout=0.1)
        assert os.getpgid(child.pid) == child.pid
    assert child.returncode == -signal.SIGKILL
    assert end_children([child]) is None, "twice is as once"


def test_a_worker_that_is_given_up_tidies_up(tmp_path: Path) -> None:
    """What it has half written is not left lying about."""
    left = tmp_path / "partial"
    with open_workers("2") as workers:
        found = workers.each(tidy, [str(tmp_path / "done"), str(left)])
        next(found)
        until(left.exists, "the beginning")
        found.close()
    assert not left.exists()
