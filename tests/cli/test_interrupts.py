"""Ctrl-C ends the command with 130 and in silence, at any moment, and leaves nothing half-done."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from elfslam.cli.app import run
from tests.waiting import until

ELFSLAM = "from elfslam.cli import main; main()"
HEEDED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""Whoever runs the tests in the background ignores Ctrl-C, and so would what they begin."""
pytestmark = pytest.mark.real
AT = """
import builtins, os, signal, sys
real = builtins.__import__
def importing(name, *more, **named):
    if name == "{module}":
        builtins.__import__ = real
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("as a compiled module does that is interrupted in its beginnings")
    return real(name, *more, **named)
def printing(name, *more, **named):
    if name == "{module}":
        builtins.__import__ = real
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            sys.excepthook(*sys.exc_info())  # as PyErr_Print does
    return real(name, *more, **named)
def syncing(descriptor, sync=os.fsync):
    os.fsync = sync
    os.kill(os.getpid(), signal.SIGINT)
{plant}
"""
WITHIN = {
    "an import": ("numpy", "builtins.__import__ = importing"),
    "an import that turns it into another error": (
        "onnxruntime",
        "builtins.__import__ = importing",
    ),
    "a library that prints it and goes on": ("numpy", "builtins.__import__ = printing"),
    "the writing": ("", "os.fsync = syncing"),
}
MOMENTS = max(1, int(os.environ.get("HOSTILE_CASES", "200")) // 150)
LATEST_S = {"parameters": 4.0, "map {walk} {out}": 8.0, "map {walks} {out} --on 2": 8.0}


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walks") / "walk"
    assert run(["simulate", "studio", str(folder), "--rounds", "2"]) == 0
    return folder


def begun(script: str, arguments: list[str], folder: Path) -> subprocess.Popen[str]:
    """The command in a process group of its own, as a shell begins it at its prompt."""
    return subprocess.Popen(
        [sys.executable, "-c", HEEDED + script, *arguments], cwd=folder, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.parametrize(("module", "plant"), WITHIN.values(), ids=WITHIN)
def test_within(module: str, plant: str, walk: Path, tmp_path: Path) -> None:
    script = AT.format(module=module, plant=plant) + ELFSLAM
    process = begun(script, ["map", str(walk), "deep/run"], tmp_path)
    assert (*process.communicate(), process.returncode) == ("", "", 130)
    assert list(tmp_path.iterdir()) == []


def test_twice_is_as_once(walk: Path, tmp_path: Path) -> None:
    """As `timeout` and some shells do it: tidying up is not interrupted."""
    plant = "os.fsync = syncing; remove = os.unlink\n"
    plant += "def removing(path, **named):\n    os.kill(os.getpid(), signal.SIGINT)\n"
    plant += "    os.unlink = remove\n    remove(path, **named)\nos.unlink = removing\n"
    script = AT.format(module="", plant=plant) + ELFSLAM
    process = begun(script, ["map", str(walk), "run"], tmp_path)
    assert (*process.communicate(), process.returncode) == ("", "", 130)
    assert list(tmp_path.iterdir()) == []


def test_who_is_to_ignore_it_does(tmp_path: Path) -> None:
    """A shell without job control starts what ends in & so."""
    script = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    script += AT.format(module="numpy", plant="builtins.__import__ = importing") + ELFSLAM
    process = begun(script, ["phyphox", "out"], tmp_path)
    process.communicate()
    assert process.returncode == 0
    assert (tmp_path / "out").is_file()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_whoever_works_for_it_ends_too(number: signal.Signals, walk: Path, tmp_path: Path) -> None:
    """SIGTERM is as Ctrl-C, but that the process dies of it: so supervisors know a stop."""
    process = begun(ELFSLAM, ["map", str(walk.parent), "runs", "--on", "2"], tmp_path)
    until(lambda: children(process.pid), "somebody who works")
    began = children(process.pid)
    process.send_signal(number)
    assert process.communicate() == ("", "")
    assert process.returncode == (130 if number == signal.SIGINT else -number)
    assert not [each for each in began if Path(f"/proc/{each}").exists()]
    assert list(tmp_path.iterdir()) == []


def children(parent: int) -> list[str]:
    threads = Path(f"/proc/{parent}/task").glob("*/children")
    return [child for file in threads for child in file.read_text().split()]


def wait_until_it_imports(process: subprocess.Popen[str]) -> None:
    """Before, the interpreter itself hears the signal."""
    maps = Path(f"/proc/{process.pid}/maps")
    while process.poll() is None and "numpy" not in maps.read_text():
        time.sleep(0.001)


def moments() -> list[tuple[str, float, int]]:
    """Commands, when they are interrupted after their imports began, and how often."""
    draw, numbers = random.Random(20), range(MOMENTS)
    return [
        (line, draw.uniform(0, latest_s), 1 + number % 2)
        for line, latest_s in LATEST_S.items()
        for number in numbers
    ]


@pytest.mark.hostile
@pytest.mark.parametrize(("line", "after_s", "times"), moments())
def test_at_any_moment(line: str, after_s: float, times: int, walk: Path, tmp_path: Path) -> None:
    """Who had all done by then may have said so, or ends as if nothing had been."""
    arguments = line.format(walk=walk, walks=walk.parent, out="out").split()
    process = begun(ELFSLAM, arguments, tmp_path)
    wait_until_it_imports(process)
    time.sleep(after_s)
    for _ in range(times):
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate()
    assert process.returncode in (0, 130)
    assert process.returncode == 0 or said == "" or said.startswith("mapped ")
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")}
    assert not [name for name in left if Path(name).name.startswith(".")]
    assert not left or {"out/run.json", "out/walk/run.json"} & left
