"""A child keeps to each of its bounds, says which it was, and ends with its server."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.base.errors import InputError
from elfslam.serve.parsing.child import Bounds
from elfslam.serve.parsing.children import Children
from elfslam.serve.problems import Problem

ROOT = Path(__file__).resolve().parents[3]
PARSER = "tests.serve.parsing.costly_parser"
BOUNDS = Bounds(
    processor_s=1, wall_s=300, memory_bytes=2**27, file_bytes=2**20, advice="make it less"
)
SERVER = """
import sys
from elfslam.serve.parsing.children import Children
from tests.serve.parsing.test_children import BOUNDS, PARSER
Children().parse(PARSER, BOUNDS, what="wait", place=sys.argv[1])
"""


@pytest.fixture(autouse=True)
def found_by_children(monkeypatch: pytest.MonkeyPatch) -> None:
    places = (str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", ""))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, places)))


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    """A named pipe that a child writes its number to."""
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def has_ended(process: int) -> bool:
    """Whether a process ends, waited for; what is there no more has."""
    try:
        descriptor = os.pidfd_open(process)
    except ProcessLookupError:
        return True
    try:
        return select.select([descriptor], [], [], 120)[0] != []
    finally:
        os.close(descriptor)


def test_what_is_found_is_told() -> None:
    assert Children().parse(PARSER, BOUNDS, what="this") == "this"


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("compute", "needs more than 1 s of processor time; make it less"),
        ("grow", "needs more than 128 MB of memory; make it less"),
        ("crash", "needs more than 128 MB of memory, or is damaged; make it less"),
        ("write", "becomes a file of more than 1 MB; make it less"),
    ],
)
def test_each_bound_is_a_refusal_that_names_it(what: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        Children().parse(PARSER, BOUNDS, what=what)
    assert str(refused.value).startswith(words)


def test_what_waits_for_nothing_is_ended() -> None:
    with pytest.raises(InputError, match=r"takes longer than 0.5 s; make it less"):
        Children().parse(PARSER, replace(BOUNDS, wall_s=0.5), what="wait")


def test_a_refusal_names_no_place_of_this_machine(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        Children().parse(PARSER, BOUNDS, what="refuse", place=str(tmp_path / "plan"))
    assert str(refused.value) == "is no plan"


def test_a_mistake_of_ours_is_no_refusal() -> None:
    with pytest.raises(Problem) as failed:
        Children().parse(PARSER, BOUNDS, what="mistake")
    assert (failed.value.status_code, "a bug of ours" in failed.value.detail) == (503, True)


@pytest.fixture
def waiting(pipe: Path) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A process that had a child parse, and the number of that child, which waits."""
    with subprocess.Popen([sys.executable, "-c", SERVER, str(pipe)]) as server:
        try:
            yield server, int(pipe.read_text())
        finally:
            server.kill()


def test_a_child_ends_with_a_server_that_was_killed(
    waiting: tuple[subprocess.Popen[bytes], int],
) -> None:
    server, child = waiting
    server.send_signal(signal.SIGKILL)
    assert has_ended(child)


def test_a_server_that_stops_waits_for_no_child(pipe: Path) -> None:
    children = Children()
    with ThreadPoolExecutor() as threads:
        parsed = threads.submit(children.parse, PARSER, BOUNDS, what="wait", place=str(pipe))
        child = int(pipe.read_text())
        children.close()
        with pytest.raises(Problem, match="the server stops") as stopped:
            parsed.result()
    assert stopped.value.status_code == 503
    assert has_ended(child)
    with pytest.raises(Problem, match="the server stops"):
        children.parse(PARSER, BOUNDS, what="this")
