"""What is promised to whoever gives this program a file or a server: each promise and its tests.

    python -m tests.hostile.promises [NUMBER ...]

prints a table (case, wanted, got).
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from dataclasses import dataclass

import pytest

from elfslam.app.console import print_rows


@dataclass(frozen=True)
class Promise:
    """A case, what is wanted of it, and the files of tests that hold it, below `tests/`."""

    case: str
    wanted: str
    tests: tuple[str, ...]


PROMISES = (
    Promise(
        "an output that exists",
        "refused without --force; inputs and owned files always",
        ("cli/test_outputs.py", "data/test_atomic_files.py"),
    ),
    Promise(
        "hostile plans and images",
        "parsed in children, 422 with the limit named, fair turns",
        ("serve/parsing", "serve/maps/test_floor_plans.py", "data/test_plan_pictures.py"),
    ),
    Promise(
        "a parent that is ended",
        "its workers end with it, whatever ended it",
        ("app/workers/test_child.py", "serve/jobs/test_executors.py", "cli/test_interrupts.py"),
    ),
    Promise("400 MB of address space", "one line, at once", ("cli/test_scarce_memory.py",)),
    Promise(
        "a store without its database, two holders, a held lock",
        "refused before a write; 503 after five seconds",
        (
            "serve/store/test_holding.py",
            "serve/store/test_opening.py",
            "serve/store/test_database.py",
            "serve/store/test_blobs.py",
            "serve/store/test_hostile_databases.py",
            "serve/store/test_hostile_disks.py",
        ),
    ),
    Promise(
        "secrets in addresses",
        "never printed; what cannot be served is refused",
        ("base/test_urls.py", "app/workers/test_workers.py", "serve/store/test_sending.py"),
    ),
    Promise(
        "both lengths in one request",
        "400, and the connection is closed",
        ("serve/network/test_running.py", "serve/network/test_connections.py"),
    ),
    Promise("control characters", "escaped by the one place that prints", ("app/test_console.py",)),
    Promise(
        "odd starts: locks, keys, names, LANG=C",
        "one line; no key is rewritten",
        ("cli/test_names.py", "serve/network/test_running.py", "serve/test_command.py"),
    ),
    Promise(
        "`map RECORDING .`, an empty OUT", "refused, nothing written", ("cli/test_outputs.py",)
    ),
    Promise(
        "who asks, before what",
        "401 before 422; numbers and hosts are strict",
        (
            "serve/receiving/test_uploads.py",
            "serve/sharing/test_rights.py",
            "serve/network/test_addresses.py",
            "serve/people/test_users.py",
        ),
    ),
    Promise(
        "the Python door: wrong types, 1e300, UTM",
        "one error that names what, got, wanted",
        (
            "app/test_api.py",
            "base/test_arguments.py",
            "base/test_arrays.py",
            "stages/test_floor_plan_alignment.py",
            "stages/test_motion.py",
            "slam/test_pipeline.py",
        ),
    ),
    Promise("phyphox without gravity", "never guessed by words", ("data/test_phyphox.py",)),
    Promise("a clock put back", "both parts kept, the jump named", ("data/test_log_files.py",)),
    Promise("Sensor Logger: commas, case, Annotation.csv", "read", ("data/test_sensorlogger.py",)),
    Promise(
        "one list of readers",
        "auto takes what a named importer takes",
        ("data/test_importing.py", "data/test_foreign_walks.py", "data/test_ronin.py"),
    ),
    Promise(
        "plans of several levels, projected coordinates",
        "a level is chosen; metres, or said so",
        ("data/test_plan_geojson.py", "data/test_floor_plans.py"),
    ),
    Promise(
        "sound: channels, scales, rates",
        "the channel with the chirps; resampled",
        ("data/test_audio_files.py", "stages/test_echo.py"),
    ),
    Promise(
        "microphones and interruptions of phones",
        "the one that hears most; said where refused",
        ("serve/pages/phone/test_microphones.py", "serve/pages/phone/test_interrupted_walks.py"),
    ),
)


class Outcomes:
    """A plugin of pytest that keeps how each test ended, by its node."""

    def __init__(self) -> None:
        self.ended: dict[str, str] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep a test's end: where it was called, or where it failed or was skipped before."""
        if report.when == "call" or report.outcome != "passed":
            self.ended[report.nodeid] = report.outcome

    def got(self, promise: Promise) -> str:
        """What came of a promise, in a cell; the first that failed by name."""
        places = tuple(f"tests/{each}" for each in promise.tests)
        mine = {node: how for node, how in self.ended.items() if node.startswith(places)}
        counts = ", ".join(f"{number} {how}" for how, number in Counter(mine.values()).items())
        failed = next((node for node, how in mine.items() if how == "failed"), "")
        return f"{counts}: {failed}" if failed else counts or "no test"


def main(wanted: list[str]) -> int:
    """Run the tests of the promises with these numbers, or of all; 1 where one is not held."""
    chosen = {k: each for k, each in enumerate(PROMISES, 1) if not wanted or str(k) in wanted}
    files = sorted({f"tests/{name}" for each in chosen.values() for name in each.tests})
    outcomes = Outcomes()
    code = pytest.main(["-q", "--no-header", "--no-cov", "-p", "no:xdist", *files], [outcomes])
    rows: list[dict[str, object]] = [
        {"": number, "case": each.case, "wanted": each.wanted, "got": outcomes.got(each)}
        for number, each in chosen.items()
    ]
    print_rows(rows, title="What is promised", as_json=False)
    return int(code != 0)


if __name__ == "__main__":
    os.environ.setdefault("HOSTILE_CASES", "40")
    sys.exit(main(sys.argv[1:]))
