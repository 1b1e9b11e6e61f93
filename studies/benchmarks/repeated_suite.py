"""A suite of tests several times in a row, on quiet cores or beside other work: is it always green?

Usage, from the root of the project:

    python -m studies.benchmarks.repeated_suite [--suite test] [--runs 10] [--load 0]

Prints of each run as it ends its seconds, the machine's load (of the last quarter of an hour, this
run in it), pytest's last line and the tests that failed. `--load` processes compute meanwhile.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

from elfslam.app.console import print_rows, say

Row = dict[str, object]
MOST_LINES, LONGEST_LINE = 20, 300
"""Of what was wrong in a run."""


def main() -> None:
    """Run the suite as often as asked, and print how each run ended."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--suite", default="test", help="a target of the Makefile")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--load", type=int, default=0, help="processes that compute meanwhile")
    asked = parser.parse_args()
    with busy(asked.load):
        rows = [run_once(asked.suite, number) for number in range(1, asked.runs + 1)]
    green = sum(row["exit"] == 0 for row in rows)
    print_rows(rows, title=f"make {asked.suite}, load {asked.load}", as_json=False)
    seconds = median(float(str(row["seconds"])) for row in rows)
    say(f"{green} of {len(rows)} green, median {seconds:.0f} s")


def run_once(suite: str, number: int) -> Row:
    """One run: its seconds, its exit status, and what pytest said last."""
    begun_s = time.monotonic()
    done = subprocess.run(["make", suite], capture_output=True, text=True, check=False)
    ends = [line.strip("= ") for line in done.stdout.splitlines() if " passed in " in line]
    row: Row = {
        "run": number,
        "seconds": round(time.monotonic() - begun_s),
        "load": round(os.getloadavg()[-1], 1),
        "exit": done.returncode,
        "pytest": ends[0] if ends else "",
    }
    say(f"run {number}: exit {done.returncode} after {row['seconds']} s")
    for line in failures(done.stdout) if done.returncode else []:
        say(f"  {line}")
    return row


def failures(output: str) -> list[str]:
    """What was wrong and which test failed; the last ten lines where none is named."""
    lines = output.splitlines()
    named = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    wrong = [line[:LONGEST_LINE] for line in lines if line.startswith("E  ")][:MOST_LINES]
    return [*wrong, *named] if named else lines[-10:]


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that compute for as long as this lasts."""
    workers = [multiprocessing.Process(target=compute, daemon=True) for _ in range(count)]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        for worker in workers:
            worker.terminate()
            worker.join()


def compute() -> None:
    """Work without end."""
    value = 1
    while True:
        value = value * 1_103_515_245 % 2_147_483_647


if __name__ == "__main__":
    main()
