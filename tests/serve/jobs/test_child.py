"""The process of a job ends with whoever began it, be it a new interpreter or a fork."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from elfslam.serve.jobs.folder import TASK
from tests.waiting import until

pytestmark = pytest.mark.real

SERVER = """
import sys
from pathlib import Path
from elfslam.serve.jobs.child import begin_anew
from elfslam.serve.jobs.preforked import Loaded
folder, begin = Path(sys.argv[1]), {begin}
with (folder / "log").open("wb") as log, begin(folder, log, log.fileno()) as process:
    print(process.wait())
"""


def descendants(parent: str) -> list[str]:
    threads = Path(f"/proc/{parent}/task").glob("*/children")
    children = [child for file in threads for child in file.read_text().split()]
    return [*children, *(each for child in children for each in descendants(child))]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM], ids=["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize(("begin", "count"), [("begin_anew", 1), ("Loaded().begin", 2)])
def test_who_works_on_a_job_ends_with_the_server(
    begin: str, count: int, number: signal.Signals, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / TASK)  # nobody writes there: the work waits for its task
    with subprocess.Popen([sys.executable, "-c", SERVER.format(begin=begin), tmp_path]) as server:
        until(lambda: len(descendants(str(server.pid))) == count, "who works")
        began = descendants(str(server.pid))
        server.send_signal(number)
    until(lambda: not [each for each in began if Path(f"/proc/{each}").exists()], "their end")
