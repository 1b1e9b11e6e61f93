"""Tests that waited in vain get one more chance, alone; those that found a wrong value do not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.real
ROOT = Path(__file__).resolve().parents[1]
CONFTEST = """
from tests.conftest import once_more, pytest_configure
def pytest_addoption(parser):
    once_more.add_option(parser)
"""
LATE_ONCE = """
from pathlib import Path
from tests.waiting import until
def test_late():
    begun = Path(__file__).with_name("begun")
    was_begun = begun.exists()
    begun.touch()
    until(lambda: was_begun, "another run", patience_s=0.01)
"""
NEVER = """
import subprocess, sys
def test_never():
    subprocess.run([sys.executable, "-c", "import signal; signal.pause()"], timeout=0.01)
"""
WRONG = """
from pathlib import Path
def test_wrong():
    with Path(__file__).with_name("runs").open("a") as runs:
        runs.write("x")
    assert 0.2 < 0.1, "no TimeoutError"
"""


def run(folder: Path, *options: str, **tests: str) -> tuple[int, str]:
    """The exit code and the output of tests planted in a folder."""
    (folder / "conftest.py").write_text(CONFTEST)
    for name, text in tests.items():
        (folder / f"test_{name}.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-q", "--rootdir", str(folder), "-c", "/dev/null"]
    done = subprocess.run(
        [*command, *options, str(folder)], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    return done.returncode, done.stdout


def test_a_test_that_waited_in_vain_is_run_once_more_and_named(tmp_path: Path) -> None:
    code, said = run(tmp_path, "--once-more", "-n", "2", late=LATE_ONCE)
    assert code == 0
    assert "waited in vain, run once more, alone" in said
    assert "passed test_late.py::test_late" in said


def test_what_waits_in_vain_again_fails_and_wrong_values_have_one_chance(tmp_path: Path) -> None:
    code, said = run(tmp_path, "--once-more", late=LATE_ONCE, never=NEVER, wrong=WRONG)
    assert code == 1
    assert "FAILED AGAIN test_never.py::test_never" in said
    assert "passed test_late.py::test_late" in said
    assert (tmp_path / "runs").read_text() == "x"
