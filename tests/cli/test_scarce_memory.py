"""With little memory to have, every verb says so in one line and ends: none waits for ever."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.real
MAIN = "from elfslam.cli import main; main()"
LONGEST_S = 120.0
"""What ends, ends long before."""
VERB_LINES = {
    "simulate": "simulate studio {out}",
    "map": "map {walk} {out}",
    "locate": "locate {walk} {run} {out}",
    "merge": "merge {run} {run} {out}",
    "demo": "demo {out}",
    "import": "import auto {walk} {out}",
    "export": "export {run} {out} --to tum",
}


def ended(line: str, kib: int, limit: int = resource.RLIMIT_AS) -> tuple[int, str]:
    """The exit code of the command and what it says, with so much memory allowed."""
    allowed = kib * 1024
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *line.split()],
        preexec_fn=lambda: resource.setrlimit(limit, (allowed, allowed)),
        capture_output=True, text=True, timeout=LONGEST_S, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


def refused(line: str, **how: int) -> None:
    code, said = ended(line, **how)
    assert (code, said.count("\n")) == (2, 1), said
    assert said.startswith("elfslam: needs more memory than there is (got ")


@pytest.mark.parametrize("kib", [300_000, 800_000])
def test_a_walk_that_cannot_be_simulated_is_none(kib: int, tmp_path: Path) -> None:
    refused(f"simulate studio {tmp_path / 'walk'}", kib=kib)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("verb", [verb for verb in VERB_LINES if verb != "simulate"])
def test_every_verb_refuses(verb: str, tmp_path: Path) -> None:
    names = {name: tmp_path / name for name in ("walk", "run", "out")}
    refused(VERB_LINES[verb].format(**names), kib=400_000)


def test_a_limit_of_data_is_one() -> None:
    refused("parameters", kib=200_000, limit=resource.RLIMIT_DATA)


def test_with_little_more_than_is_wanted_a_walk_is_simulated_and_mapped(tmp_path: Path) -> None:
    cores_kib = 100_000 * 64
    walk, run = tmp_path / "walk", tmp_path / "run"
    assert ended(f"simulate studio {walk} --rounds 2", 900_000 + cores_kib)[0] == 0
    assert ended(f"map {walk} {run}", 900_000 + cores_kib)[0] == 0
